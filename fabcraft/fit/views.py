"""`ViewBank`: fixed cameras around an object, and the guidance that looks through them, chunk by chunk.

The cameras stand in the optimiser's frame (longest side = 2), so a picture's depth is in that unit. Targets can be made
once for the whole bank (`ViewBank.chunks` of any mesh in the frame); a step draws its views from it, the same for the same
seed. Pictures are made a few at a time and their gradient is taken to the vertices before the next few are made: what is
held in memory does not grow with their number. A chunk counts with its share of the views.
"""

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Int, Int64
from torch import Tensor

from fabcraft.fit.camera import Camera, bank, orbit, stack
from fabcraft.fit.descend import State
from fabcraft.fit.presets import DeformSettings
from fabcraft.fit.render import render
from fabcraft.fit.topology import Topology
from fabcraft.geometry.frame import Frame
from fabcraft.guidance.guidance import Guidance, Views
from fabcraft.mesh import Mesh

_NEIGHBOUR_DEG = 12.0


@runtime_checkable
class Guide(Guidance, Protocol):
    """A `Guidance` that can be told from other values at run time."""


@dataclass(frozen=True, eq=False)
class ViewBank:
    """Fixed cameras in the optimiser's frame; build it with `ViewBank.around`."""

    cameras: tuple[Camera, ...]
    views: int
    """Pictures a step."""
    chunk: int
    """Pictures at a time."""
    seed: int
    paired: bool
    """Cameras 2 i and 2 i + 1 are neighbours and are drawn together."""

    @staticmethod
    def around(rest: Mesh, settings: DeformSettings) -> "ViewBank":
        """Cameras around the bounding sphere of a mesh before it is deformed."""
        points = Frame.of(rest).inside(rest.vertices)
        radius = float(np.linalg.norm(points, axis=1).max())
        around = functools.partial(
            bank,
            centre=np.zeros(3),
            radius_mm=radius,
            fov_deg=settings.fov_deg,
            resolution=settings.pixels,
            seed=settings.seed,
        )
        if not settings.paired_views:
            return ViewBank(around(settings.bank), settings.views, settings.chunk, settings.seed, False)
        alone = around((settings.bank + 1) // 2)
        cameras = tuple(camera for one in alone for camera in (one, _neighbour(one)))
        return ViewBank(cameras, settings.views + settings.views % 2, settings.chunk, settings.seed, True)

    def at(self, step: int) -> Int64[np.ndarray, " K"]:
        """Which cameras of the bank a step looks through, ascending."""
        count = len(self.cameras)
        if self.views >= count:
            return np.arange(count)
        random = np.random.default_rng([self.seed, step])
        if not self.paired:
            return np.sort(random.choice(count, self.views, replace=False)).astype(np.int64)
        pairs = np.sort(random.choice(count // 2, self.views // 2, replace=False))
        return np.column_stack([2 * pairs, 2 * pairs + 1]).ravel().astype(np.int64)

    def chunks(
        self,
        positions: Float[Tensor, "V 3"],
        topology: Topology,
        outputs: Sequence[str],
        cameras: Int64[np.ndarray, " K"] | None = None,
        step: int = 0,
        steps: int = 1,
    ) -> Iterator[Views]:
        """Pictures of a mesh in the optimiser's frame through some or all cameras of the bank, a few at a time."""
        chosen = np.arange(len(self.cameras)) if cameras is None else cameras
        size = self.chunk + self.chunk % 2 if self.paired else self.chunk
        for start in range(0, len(chosen), size):
            part = chosen[start : start + size]
            yield self._views(positions, topology, outputs, part, step, steps)

    def _views(
        self,
        positions: Float[Tensor, "V 3"],
        topology: Topology,
        outputs: Sequence[str],
        part: Int64[np.ndarray, " K"],
        step: int,
        steps: int,
    ) -> Views:
        cameras = stack([self.cameras[index] for index in part])
        images = render(positions, topology, cameras, outputs=outputs)
        faces = topology.on(positions.device, len(positions)).faces
        forward = cameras.views[:, 2, :3]
        with torch.no_grad():
            pixels = cameras.project(positions.detach())[..., :2]
        return Views(
            step=step,
            steps=steps,
            camera=part,
            azimuth_deg=np.degrees(np.arctan2(-forward[:, 0], forward[:, 1])) % 360.0,
            elevation_deg=np.degrees(-np.arcsin(np.clip(forward[:, 2], -1.0, 1.0))),
            positions=positions,
            faces=faces,
            pixels=pixels,
            visible=_visible(images.face_id, faces, len(positions)),
            **{name: images.of(name) for name in outputs},
        )


@torch.no_grad()
def prepare(
    guidance: Sequence[Guide], views: ViewBank, rest: Mesh, device: torch.device | str = "cpu"
) -> None:
    """Show the rest shape, from every camera of the bank, to each guidance that has a `prepare` for it."""
    points = torch.from_numpy(Frame.of(rest).inside(rest.vertices)).float().to(device)
    topology = Topology.of(rest.faces)
    for one in guidance:
        shown = getattr(one, "prepare", None)
        if shown is None or not one.outputs:
            continue
        for seen in views.chunks(points, topology, one.outputs):
            shown(seen)


def guidance_chunks(
    guidance: Sequence[Guide], views: ViewBank, faces: Int[np.ndarray, "F 3"], settings: DeformSettings
) -> "GuidanceChunks":
    """The guidance as what `descend` takes for chunks, for one connectivity."""
    return GuidanceChunks(tuple(guidance), views, Topology.of(faces), settings)


@dataclass(frozen=True, eq=False)
class GuidanceChunks:
    """Weighted losses of every guidance at a state, chunk by chunk; a guidance without pictures is asked once."""

    guidance: tuple[Guide, ...]
    bank: ViewBank
    topology: Topology
    settings: DeformSettings

    def __call__(self, state: State) -> Iterator[Mapping[str, Tensor]]:
        """As `Ways.chunks` wants it."""
        active = [one for one in self.guidance if self._counts(one, state.step)]
        seeing = [one for one in active if one.outputs]
        blind = [one for one in active if not one.outputs]
        if blind:
            yield _weighted(blind, self._surface(state), 1.0)
        outputs = tuple(dict.fromkeys(name for one in seeing for name in one.outputs))
        if not outputs:
            return
        chosen = self.bank.at(state.step)
        steps = self.settings.steps
        for views in self.bank.chunks(state.positions, self.topology, outputs, chosen, state.step, steps):
            yield _weighted(seeing, views, len(views.camera) / len(chosen))

    def _counts(self, guidance: Guide, step: int) -> bool:
        """Whether any loss of a guidance has a weight now: what counts for nothing needs no pictures."""
        return any(weight * self.settings.pace(name, step) for name, weight in guidance.weights.items())

    def _surface(self, state: State) -> Views:
        """The surface alone, seen by no camera."""
        count = len(state.positions)
        return Views(
            step=state.step,
            steps=self.settings.steps,
            camera=np.zeros(0, np.int64),
            azimuth_deg=np.zeros(0),
            elevation_deg=np.zeros(0),
            positions=state.positions,
            faces=self.topology.on(state.positions.device, count).faces,
            pixels=state.positions.new_zeros(0, count, 2),
            visible=torch.zeros(0, count, dtype=torch.bool, device=state.positions.device),
        )


def _weighted(guidance: Sequence[Guide], views: Views, share: float) -> dict[str, Tensor]:
    """Losses by name, times weight and share; two guidances may use one name."""
    values: dict[str, Tensor] = {}
    for one in guidance:
        for name, loss in one.losses(views).items():
            value = share * one.weights.get(name, 0.0) * loss
            values[name] = values[name] + value if name in values else value
    return values


def _neighbour(camera: Camera) -> Camera:
    """A camera turned by 12 degrees about the z axis through the origin."""
    place = -camera.view[:3, :3].T @ camera.view[:3, 3]
    forward = camera.view[2, :3]
    azimuth = float(np.degrees(np.arctan2(-forward[0], forward[1]))) + _NEIGHBOUR_DEG
    elevation = float(np.degrees(-np.arcsin(np.clip(forward[2], -1.0, 1.0))))
    fov = float(np.degrees(2.0 * np.arctan(1.0 / camera.focal)))
    return orbit(np.zeros(3), float(np.linalg.norm(place)), azimuth, elevation, fov, camera.width)


def _visible(face_id: Tensor, faces: Int[Tensor, "F 3"], count: int) -> Tensor:
    """(K, V) bool: whether a face around the vertex owns a pixel of the view."""
    owning = torch.zeros(len(face_id), len(faces) + 1, dtype=torch.bool, device=face_id.device)
    owning.scatter_(1, face_id.flatten(1).long() + 1, True)  # place 0 is the background's
    view, face = owning[:, 1:].nonzero().unbind(1)
    seen = torch.zeros(len(face_id), count, dtype=torch.bool, device=face_id.device)
    seen[view[:, None], faces[face]] = True
    return seen
