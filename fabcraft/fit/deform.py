"""`deform`: any mesh, closed or a sheet, towards any guidance, while it keeps fitting a body.

One similarity (the rest mesh's box centre, longest side = 2) for object, body, contacts and guidance; millimetres in and
out. Unknowns: per-face restricted Jacobians and a translation, from doing nothing. The loop (`descend`) sums terms of the
shape, the body and the guidance, each at its pace (`DeformSettings.pace`); where faces have been stretched they may be
refined on the way. A soft penalty promises nothing, so the object is settled as a whole, pushed out and measured exactly.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.fit.body_terms import ContactSet, contact_term, penetration_term, seat
from fabcraft.fit.descend import Descended, Descent, Stop, Variables, Ways, descend
from fabcraft.fit.determinism import same_every_time
from fabcraft.fit.losses import Term
from fabcraft.fit.mirror import Mirror, symmetric
from fabcraft.fit.presets import PRESETS, DeformSettings, ablations
from fabcraft.fit.remesh import carried, refine, slivers
from fabcraft.fit.settle import clear, reseated, settle_rigidly
from fabcraft.fit.shape_terms import lock_weights, shape_terms
from fabcraft.fit.views import Guide, ViewBank, guidance_chunks, prepare
from fabcraft.fit.walls import kept_apart
from fabcraft.geometry.device import device_of
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.operators import edge_faces
from fabcraft.geometry.poisson import PoissonSystem, nearest_links
from fabcraft.mesh import Mesh

PROMISE_MM = 0.05
"""Deepest that a settled object may be inside the body."""

Watch = Callable[[int, dict[str, float], Mesh], None]
"""Called at every step with its number, the weighted terms and the mesh so far, mm."""


@dataclass(frozen=True, eq=False)
class Deformed:
    """A deformed mesh, and how it came about. A number that could not be measured is None."""

    mesh: Mesh
    """mm."""
    history: dict[str, list[float]] = field(repr=False)
    """Weighted value of every term at every step, and `total`."""
    stopped: Stop
    pen_max_mm: float | None
    """Deepest place inside the body, exact, over vertices and 20 000 samples."""
    pen_rms_mm: float | None
    contact_rms_mm: float | None
    contact_p95_mm: float | None
    settled_mm: float
    """How far it was moved as a whole after the loop."""
    pushed_mm: float
    """Largest push of the settling, locked faces brought back with it."""
    remeshed: int
    """How many times it was refined."""

    @property
    def clear_of_body(self) -> bool:
        """Whether the promise is kept: nowhere deeper than 0.05 mm inside the body, as far as there is one."""
        return self.pen_max_mm is None or self.pen_max_mm <= PROMISE_MM


@dataclass(frozen=True, eq=False)
class _Object:
    """What a stage of the loop deforms."""

    mesh: Mesh
    """mm; the rest of this stage."""
    origin: Float64[np.ndarray, "V 3"]
    """Where its vertices were before anything was deformed, mm."""
    lock: Float64[np.ndarray, " F"]
    contacts: ContactSet | None


@dataclass(frozen=True, eq=False)
class _Scene:
    """What stays the same over the stages."""

    frame: Frame
    body: SurfaceDistance | None
    guidance: tuple[Guide, ...]
    bank: ViewBank
    mirror: Mirror | None
    settings: DeformSettings
    device: torch.device


@same_every_time()
def deform(
    rest: Mesh,
    *,
    body: SurfaceDistance | None = None,
    contacts: ContactSet | None = None,
    guidance: Sequence[Guide] = (),
    settings: DeformSettings | None = None,
    locked: Bool[np.ndarray, " _"] | None = None,
    mirror: Mirror | None = None,
    watch: Watch | None = None,
) -> Deformed:
    """Deform a placed `rest` mesh towards the guidance, off the body and onto the contacts.

    guidance : made for the frame of `rest` (`Frame.of(rest)`) and, if it keeps targets by camera, for
        `ViewBank.around(rest, settings)`. One that compares with the rest shape (`prepare`) is shown it here.
    locked : faces that stay on the surface that they are part of, along which they may spread; one flag each.
    Raises `InputError` for a mesh that has no deformation: unused vertices, faces without area, and for flags that do not
    match the faces; `MissingError` for a CUDA device that is not there. Ctrl-C keeps the best so far, settles and
    measures it.
    """
    chosen = settings or PRESETS["standard"]
    device = device_of(chosen.device)
    scene = _Scene(
        Frame.of(rest), body, tuple(guidance), ViewBank.around(rest, chosen), mirror, chosen, device
    )
    now = _Object(rest, rest.vertices, _lock(rest, locked, chosen), contacts)
    if chosen.steps:
        prepare(scene.guidance, scene.bank, rest, device)
    now, history, stopped, remeshed = _descended(now, scene, watch)
    settled, moved_mm, pushed_mm = _settled(now, scene)
    measured = asdict(seat(settled, body, contacts))
    return Deformed(
        settled, history, stopped, **measured, settled_mm=moved_mm, pushed_mm=pushed_mm, remeshed=remeshed
    )


def ablate(
    rest: Mesh,
    *,
    body: SurfaceDistance,
    contacts: ContactSet,
    guidance: Sequence[Guide] = (),
    settings: DeformSettings | None = None,
) -> dict[str, Deformed]:
    """The paper's ablation: the loop's result with neither of the body's terms, each alone, and both."""
    return {
        name: deform(rest, body=body, contacts=contacts, guidance=guidance, settings=each)
        for name, each in ablations(settings or PRESETS["standard"]).items()
    }


def _descended(
    now: _Object, scene: _Scene, watch: Watch | None
) -> tuple[_Object, dict[str, list[float]], Stop, int]:
    """All stages of the loop; between two, the object may be refined."""
    settings = scene.settings
    history: dict[str, list[float]] = {}
    done, remeshed, stopped, edge_mm = 0, 0, Stop.STEPS, _median_edge(now.mesh)
    system, variables = _system(now, scene), Variables.rest(len(now.mesh.faces), 3, scene.device)
    descending = _stage(system, now, scene)
    positions = now.mesh.vertices
    for steps in _stages(settings):
        outcome = descending(variables, done, steps, watch)
        _append(history, outcome.history)
        done, stopped, variables = done + steps, outcome.stopped, outcome.variables
        positions = scene.frame.outside(outcome.positions)
        if stopped is not Stop.STEPS or done >= settings.steps:
            break
        refined = _refined(now, positions, scene, edge_mm)
        if refined is not None:
            moved = now.mesh.with_vertices(outcome.positions)
            now, before, remeshed = refined, system, remeshed + 1
            system = _system(now, scene)
            variables = Variables.rest(len(now.mesh.faces), 3, scene.device)
            if settings.carry_moments:
                variables = carried(outcome.variables, before, moved, system)
            descending, positions = _stage(system, now, scene), now.mesh.vertices
    return replace(now, mesh=now.mesh.with_vertices(positions)), history, stopped, remeshed


def _append(history: dict[str, list[float]], stage: dict[str, list[float]]) -> None:
    """The steps of another stage; a term that only one of them had counts 0 in the other."""
    before, more = len(history.get("total", [])), len(stage["total"])
    for name in {**history, **stage}:
        history.setdefault(name, [0.0] * before).extend(stage.get(name, [0.0] * more))


def _stages(settings: DeformSettings) -> list[int]:
    """How many steps each stage has: the object may be refined between two, but not in the fit phase."""
    if settings.remesh_every <= 0:
        return [settings.steps] if settings.steps else []
    starts = list(range(0, max(1, int(settings.fit_after * settings.steps)), settings.remesh_every))
    ends = [*starts[1:], settings.steps]
    return [end - start for start, end in zip(starts, ends, strict=True) if end > start]


def _system(now: _Object, scene: _Scene) -> PoissonSystem:
    points = scene.frame.inside(now.mesh.vertices)
    links = nearest_links(points, now.mesh.faces) if scene.settings.link_parts else None
    return PoissonSystem.of(points, now.mesh.faces, links)


def _stage(
    system: PoissonSystem, now: _Object, scene: _Scene
) -> Callable[[Variables, int, int, Watch | None], Descended]:
    """One stage as a function of where it starts, the steps done before, its own, and who watches."""
    settings, frame, mesh = scene.settings, scene.frame, now.mesh
    terms = shape_terms(system, settings.weights, now.lock, frame.inside(now.origin), scene.device)
    terms += _body_terms(now, scene)
    ways = Ways(
        chunks=guidance_chunks(scene.guidance, scene.bank, mesh.faces, settings) if scene.guidance else None,
        pace=settings.pace,
        admit=symmetric(scene.mirror, system, frame, scene.device) if scene.mirror is not None else None,
    )

    def descending(start: Variables, done: int, steps: int, watch: Watch | None) -> Descended:
        def seen(step: int, values: dict[str, float], positions: Tensor) -> None:
            if watch is not None:
                watch(step, values, mesh.with_vertices(frame.outside(positions.double().cpu().numpy())))

        rates = (settings.learning_rate, settings.translation_rate, settings.final_share)
        memory = (0.9, settings.square_memory)
        descent = Descent(steps, *rates, clip=settings.clip, betas=memory, before=done, whole=settings.steps)
        return descend(system, terms, descent, start, seen, ways)

    return descending


def _body_terms(now: _Object, scene: _Scene) -> list[Term]:
    """What has a weight and something to measure."""
    weights, terms = scene.settings.weights, []
    if scene.body is not None and weights.penetration > 0.0:
        clearance = np.full(len(now.mesh.vertices), scene.settings.clearance_mm)
        function = penetration_term(scene.body, now.mesh, clearance, scene.frame, scene.device)
        terms.append(Term("penetration", weights.penetration, function))
    if now.contacts is not None and weights.contact > 0.0:
        function = contact_term(now.contacts, now.mesh.faces, scene.frame, scene.device)
        terms.append(Term("contact", weights.contact, function))
    return terms


def _refined(
    now: _Object, positions: Float64[np.ndarray, "V 3"], scene: _Scene, edge_mm: float
) -> _Object | None:
    """The object as it is now, refined where it was stretched; None when too little was."""
    moved = now.mesh.with_vertices(positions)
    if slivers(moved).any():  # no system to go on with: the terms may still open them
        return None
    found = refine(moved, now.origin, now.lock > 0.0, edge_mm, scene.settings.remesh_stretch)
    if found.split < max(4, len(moved.faces) // 200) or slivers(found.mesh).any():
        return None
    lock = np.zeros(len(found.mesh.faces))
    lock[: len(now.lock)] = now.lock  # locked faces keep their number; the others have no lock
    contacts = now.contacts.on(moved, found.mesh) if now.contacts is not None else None
    return _Object(found.mesh, found.origin, np.where(found.locked, lock, 0.0), contacts)


def _lock(
    rest: Mesh, locked: Bool[np.ndarray, " _"] | None, settings: DeformSettings
) -> Float64[np.ndarray, " F"]:
    """How much each face is locked, 0..1."""
    flags = np.zeros(len(rest.faces), dtype=bool) if locked is None else locked
    if len(flags) != len(rest.faces):
        raise InputError(
            f"{len(flags)} flags for {len(rest.faces)} faces say what is locked", "Give one for each face."
        )
    return lock_weights(rest, flags, settings.locked_falloff * float(rest.size_mm.max()))


def _settled(now: _Object, scene: _Scene) -> tuple[Mesh, float, float]:
    """Its locked faces back where they were built, settled as a whole, then pushed out; and how far each moved it, mm."""
    mesh = now.mesh
    if not scene.settings.settle:
        return mesh, 0.0, 0.0
    wanted = np.full(len(mesh.vertices), scene.settings.clearance_mm)
    spread = min(5.0, 0.1 * float(mesh.size_mm.max()))
    seated, back = reseated(mesh, now.origin, now.lock, spread)
    if scene.body is None:
        return seated, 0.0, back
    settled = settle_rigidly(seated, scene.body, wanted)
    made, most = clear(settled.mesh, scene.body, wanted, spread)
    if scene.settings.wall_mm > 0.0:
        made, apart = kept_apart(made, now.origin, scene.body, scene.settings.wall_mm, spread)
        if apart > 0.0:
            made, _ = reseated(made, now.origin, now.lock, spread)
            made, again = clear(made, scene.body, wanted, spread)
            most = max(most, apart, again)
    return made, float(np.linalg.norm(settled.shift_mm)), max(back, most)


def _median_edge(mesh: Mesh) -> float:
    edges, _ = edge_faces(mesh.faces)
    return float(np.median(np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)))
