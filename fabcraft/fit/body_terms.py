"""How an object sits on a body, as terms of the energy and as numbers: contacts and penetration, for any mesh.

Contacts are places on the skin that the object is to touch (CRAFT's V_c). `nearest`: each pulls the nearest place of the
object's surface (CRAFT, L_c, measured to the surface instead of to vertices), with what is around it, to its gap; `paired`:
each pulls one fixed place of the object to c + gap · n, n the skin's normal; squared, linear beyond 5 mm.
Penetration is the hinge max(0, δ − s)² on the clearance δ, an area mean over vertices and face centres, s > 0 outside
(CRAFT, L_p, where its threshold is read as a clearance so that nothing outside is pulled onto the skin).
Lengths are in the optimiser's frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import igl
import numpy as np
import torch
from jaxtyping import Float, Float64, Int, Int64
from scipy.spatial import cKDTree
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.fit.descend import State
from fabcraft.fit.losses import penetration_loss
from fabcraft.geometry.align import spread_points
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.sampling import area_samples, corner_weights
from fabcraft.mesh import Mesh

HUBER_MM = 5.0
_AROUND = 48
"""Vertices that a `nearest` contact moves together, about three edges around and through a thin wall or tube."""
_SLACK_MM = 0.2  # within this a distance may be carried on along its gradient


@dataclass(frozen=True, eq=False)
class ContactSet:
    """Places on the skin that the object is to touch, C of them.

    Set them about as close together as the object's edges: where guidance pulls the other way, sparse ones leave dimples.
    """

    points: Float64[np.ndarray, "C 3"]
    """On the skin, mm."""
    normals: Float64[np.ndarray, "C 3"]
    """Of the skin there, unit, outward."""
    gaps_mm: Float64[np.ndarray, " C"]
    """How far from the skin the object's surface is to be."""
    weights: Float64[np.ndarray, " C"]
    """How much each counts; their scale does not matter."""
    faces: Int[np.ndarray, " C"] | None = None
    """`paired`: the face of the object that each one pulls; None: `nearest`."""
    places: Float64[np.ndarray, "C 3"] | None = None
    """`paired`: corner weights on that face."""

    def __post_init__(self) -> None:
        if (
            len(self.points) == 0
            or not self.weights.sum() > 0.0
            or (self.faces is None) != (self.places is None)
        ):
            raise InputError(
                f"{len(self.points)} contacts with a total weight of {float(self.weights.sum()):g} were given",
                "Give at least one contact with a weight, and for paired ones both faces and places.",
            )

    @property
    def targets_mm(self) -> Float64[np.ndarray, "C 3"]:
        """Where the object's surface is to be, mm."""
        return self.points + self.gaps_mm[:, None] * self.normals

    def on(self, before: Mesh, after: Mesh) -> "ContactSet":
        """The same contacts for another triangulation of the same surface."""
        if self.faces is None or self.places is None:
            return self
        held = (self.places[:, :, None] * before.corners[self.faces]).sum(1)
        faces, places = _nearest_places(held, after.vertices, after.faces)
        return replace(self, faces=faces, places=places)


def contacts_between(
    mesh: Mesh, body: SurfaceDistance, reach_mm: float | None = None, count: int = 300, gap_mm: float = 0.0
) -> ContactSet:
    """Paired contacts where a placed object is near the body: what it touches now, it is to touch in the end.

    reach_mm : how near is near; 1.5 % of the longest side and at least 3 mm, if not given.
    Raises `InputError` when nothing of the object is that near.
    """
    reach = max(3.0, 0.015 * float(mesh.size_mm.max())) if reach_mm is None else reach_mm
    faces, places = area_samples(mesh.face_areas, 20 * count, np.random.default_rng(0))
    samples = (places[:, :, None] * mesh.corners[faces]).sum(1)
    found = body.closest(samples)
    # the far wall of a thin object is near the skin too, but looks away from it
    facing = (mesh.face_normals[faces] * body.mesh.face_normals[found.faces]).sum(1) < 0.0
    near = found.distances <= reach
    near &= facing if (near & facing).any() else True
    if not near.any():
        raise InputError(
            f"no part of {mesh.name or 'the object'} is within {reach:.1f} mm of the body",
            "Place it on the body first, or give a longer reach.",
        )
    kept = np.flatnonzero(near)
    kept = kept[spread_points(samples[kept], count)]
    normals = body.mesh.face_normals[found.faces[kept]]
    gaps, weights = np.full(len(kept), gap_mm), np.ones(len(kept))
    return ContactSet(found.points[kept], normals, gaps, weights, faces[kept], places[kept])


class MovingDistance:
    """Signed distances of points that move a little at a time, differentiable, almost exact.

    An exact distance is kept with its gradient and carried on linearly; it is asked anew only for a point that has moved
    farther than 0.2 mm, and than it was clear of what it is asked to keep: until then it cannot have met the body.
    """

    def __init__(self, distance: SurfaceDistance, frame: Frame) -> None:
        self._distance, self._frame = distance, frame
        self._where = np.zeros((0, 3))
        self._signed = np.zeros(0)
        self._gradient = np.zeros((0, 3))

    def __call__(
        self, points: Float[Tensor, "N 3"], keep_mm: Float64[np.ndarray, " N"]
    ) -> Float[Tensor, " N"]:
        """Signed distances in the optimiser's frame, of points in it; exact near `keep_mm` and below."""
        now = self._frame.outside(points.detach().double().cpu().numpy())
        if len(now) != len(self._where):
            self._where = now.copy()
            self._signed, self._gradient = self._distance.signed_with_gradient(now)
        moved = np.linalg.norm(now - self._where, axis=1)
        stale = np.flatnonzero(moved > np.maximum(_SLACK_MM, self._signed - keep_mm))
        if len(stale):
            self._where[stale] = now[stale]
            self._signed[stale], self._gradient[stale] = self._distance.signed_with_gradient(now[stale])
        scale = self._frame.scale
        kept = torch.from_numpy(self._frame.inside(self._where)).to(points)
        ahead = ((points - kept) * torch.from_numpy(self._gradient.copy()).to(points)).sum(1)
        return torch.from_numpy(self._signed * scale).to(points) + ahead


def penetration_term(
    distance: SurfaceDistance,
    rest: Mesh,
    clearance_mm: Float64[np.ndarray, " V"],
    frame: Frame,
    device: torch.device | str = "cpu",
) -> Callable[[State], Tensor]:
    """The hinge on the clearance, per vertex of `rest`, over its vertices and face centres, weighted by rest area."""
    moving = MovingDistance(distance, frame)
    faces = torch.from_numpy(rest.faces.astype(np.int64)).to(device)
    areas = rest.face_areas
    owned = np.bincount(rest.faces.ravel(), np.repeat(areas / 3.0, 3), minlength=len(rest.vertices))
    weights = torch.from_numpy(np.concatenate([owned, areas]) * frame.scale**2).float().to(device)
    keep_mm = np.concatenate([clearance_mm, clearance_mm[rest.faces].mean(1)])
    keep = torch.from_numpy(keep_mm * frame.scale).float().to(device)

    def penetration(state: State) -> Tensor:
        points = torch.cat([state.positions, state.positions[faces].mean(1)])
        return penetration_loss(moving(points, keep_mm), keep, weights)

    return penetration


def contact_term(
    contacts: ContactSet,
    faces: Int[np.ndarray, "F 3"],
    frame: Frame,
    device: torch.device | str = "cpu",
) -> Callable[[State], Tensor]:
    """Weighted mean of the squared distance, linear beyond 5 mm, of every contact's place of the object to its target.

    A `nearest` one asks for the gap alone: what is that far from the skin may lie beside it as well as before it.
    """
    pairs = None if contacts.faces is None or contacts.places is None else (contacts.faces, contacts.places)
    wanted = frame.inside(contacts.points if pairs is None else contacts.targets_mm)
    targets = torch.from_numpy(wanted).float().to(device)
    weights = torch.from_numpy(contacts.weights / contacts.weights.sum()).float().to(device)
    gaps = torch.from_numpy(contacts.gaps_mm * frame.scale).float().to(device)[:, None]
    looks = torch.from_numpy(contacts.normals).float().to(device)
    knee = HUBER_MM * frame.scale
    index = np.ascontiguousarray(faces, dtype=np.int64)

    def contact(state: State) -> Tensor:
        now = state.positions.detach().double().cpu().numpy()
        owner, places = pairs or _nearest_places(wanted, now, index)
        corners = state.positions[torch.from_numpy(index[owner]).to(device)]
        held = (torch.from_numpy(places).to(corners)[:, :, None] * corners).sum(1)
        if pairs is not None:
            return (weights * huber(((held - targets) ** 2).sum(1), knee)).sum()
        away = torch.nn.functional.normalize(held.detach() - targets, dim=1, eps=1e-12)
        outside = ((away * looks).sum(1) > 0.0)[:, None]  # from within the skin, the way is along its normal
        asked = targets + gaps * torch.where(outside, away, looks)
        # where the place is, moved as its surroundings move: pulled alone, it would be drawn out to a thorn
        around = cKDTree(now).query(held.detach().double().cpu().numpy(), min(_AROUND, len(now)))[1]
        middles = state.positions[torch.from_numpy(around.astype(np.int64)).to(device)].mean(1)
        held = held.detach() + (middles - middles.detach())
        return (weights * huber(((held - asked) ** 2).sum(1), knee)).sum()

    return contact


def huber(squared: Float[Tensor, " N"], knee: float) -> Float[Tensor, " N"]:
    """d² below the knee, 2 knee d − knee² beyond, from d²; 0 and flat where two points coincide."""
    beyond = 2.0 * knee * torch.sqrt(squared.clamp_min(knee * knee)) - knee * knee
    return torch.where(squared < knee * knee, squared, beyond)


@dataclass(frozen=True)
class Seat:
    """How an object sits, mm; what could not be measured is None."""

    pen_max_mm: float | None
    """Deepest place of the object inside the body, over vertices and 20 000 samples."""
    pen_rms_mm: float | None
    """Root mean square depth over the samples, 0 outside."""
    contact_rms_mm: float | None
    """Root mean square difference of a contact's distance to the object and its gap."""
    contact_p95_mm: float | None


def seat(mesh: Mesh, body: SurfaceDistance | None, contacts: ContactSet | None) -> Seat:
    """Exact distances of a mesh at rest on the body; the same numbers for the same mesh."""
    deepest = spread = rms = p95 = None
    if body is not None:
        signed = body.signed(verification_points(mesh))
        deepest = max(0.0, -float(signed.min()))
        inside = np.minimum(signed[len(mesh.vertices) :], 0.0)
        spread = float(np.sqrt((inside**2).mean()))
    if contacts is not None:
        miss = np.abs(SurfaceDistance(mesh).closest(contacts.points).distances - contacts.gaps_mm)
        rms, p95 = float(np.sqrt((miss**2).mean())), float(np.percentile(miss, 95))
    return Seat(deepest, spread, rms, p95)


def verification_points(mesh: Mesh, count: int = 20_000) -> Float64[np.ndarray, "N 3"]:
    """All vertices, then `count` places spread evenly by area; the same for the same mesh, mm."""
    faces, places = area_samples(mesh.face_areas, count, np.random.default_rng(20_000))
    return np.concatenate([mesh.vertices, (places[:, :, None] * mesh.corners[faces]).sum(1)])


def _nearest_places(
    points: Float64[np.ndarray, "N 3"], vertices: Float64[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Int64[np.ndarray, " N"], Float64[np.ndarray, "N 3"]]:
    """Face and corner weights of the nearest place of a surface to each point."""
    tree, corners = igl.AABB(), np.ascontiguousarray(vertices)
    index = np.ascontiguousarray(faces, dtype=np.int64)
    tree.init(corners, index)
    _, owner, nearest = tree.squared_distance(corners, index, np.ascontiguousarray(points))
    owner = np.asarray(owner).reshape(-1).astype(np.int64)
    return owner, corner_weights(nearest.reshape(-1, 3), corners[index[owner]])
