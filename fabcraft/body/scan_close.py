"""The openings of a scan: what was cut off is cut level and closed, holes are filled as the skin around them goes on.

A neck, a forearm or a leg ends in an opening because the scan ends there, and a foot has none below because it stood:
those are closed by planes.  Any other opening is a hole, closed by a smooth patch (`scan_patch`).  Where a hole is too
large for its filling to be trusted, nothing may rest.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
from jaxtyping import Float64

from fabcraft.body.body import Plane, cut_within, rim_loops
from fabcraft.body.scan_fit import PartFit
from fabcraft.body.scan_patch import patched
from fabcraft.body.scan_pieces import remeshed
from fabcraft.body.scan_places import size_of
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh

_WIDE = 0.25
"""An opening is where the scan ends when it is this share of the part's size wide."""
_UNSURE = 0.22
"""A filling wider than this share of the part's size is not to be rested on."""
_SMALL, _NAMED = 0.04, 4
"""Holes narrower than this share of the part's size are only counted; so are those beyond this many."""
_MOST_MISSING, _MOST_ADDED = 0.3, 0.75
"""A scan with larger holes, as a share of its surface, is refused; a person's are filled as people are."""
_RIM_ABOVE = 0.002
"""The cut is this share of the part's size within the rim."""
_RAGGED = 0.2
"""At most this share of the part's size is lost to a ragged rim; above that the membrane across it closes it."""
_CROSSING = 0.05
"""Share of the faces that may cross others before the skin is made anew."""


@dataclass(frozen=True, eq=False)
class Closed:
    """A scan without openings."""

    mesh: Mesh
    unsure: Float64[np.ndarray, "N 3"]
    """Points of fillings that nothing may rest on."""
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _End:
    """Where a scan may end: beyond `limit`, against `inward`."""

    name: str
    limit: Float64[np.ndarray, "3"]
    inward: Float64[np.ndarray, "3"]


def closed(mesh: Mesh, fit: PartFit | None) -> Closed:
    """`mesh` (mm, body frame) closed; `fit` in the same frame tells its ends from holes, None: no ends.

    Raises `InputError` when too much is missing.
    """
    size = float(mesh.size_mm.max()) if fit is None else size_of(fit)
    ends = [] if fit is None else _ends(fit)
    levels: dict[str, float] = {}
    filled: list[tuple[float, str, bool]] = []
    unsure, missing = [np.zeros((0, 3))], 0.0
    for loop in rim_loops(mesh.faces):
        rim, faces, first = mesh.vertices[loop], len(mesh.faces), len(mesh.vertices)
        span, large = (width := _span(rim)), width > _UNSURE * size
        end = next((end for end in ends if span > _WIDE * size and _beyond(rim, end)), None)
        unseen = _unseen(mesh, fit) if fit is not None and end is None and large else None
        mesh = patched(mesh, loop, taut=end is not None, along=unseen)
        if end is not None:
            levels[end.name] = max(_level(rim, end, size), levels.get(end.name, -np.inf))
            continue
        missing += float(mesh.face_areas[faces:].sum())
        filled.append((span, _where(rim.mean(0), fit), unseen is not None))
        if large:
            unsure.append(np.concatenate([rim, mesh.vertices[first:]]))
            # a filling goes hardly farther than the scan
            for lowered in ends:
                if (lowest := float(((rim - lowered.limit) @ lowered.inward).min())) < 0:
                    levels.setdefault(lowered.name, lowest + min(_RAGGED * size, -0.5 * lowest))
    if missing > (_MOST_MISSING if fit is None else _MOST_ADDED) * float(mesh.area_mm2):
        raise InputError(
            f"{missing / mesh.area_mm2:.0%} of the surface of {mesh.name} is missing",
            "Scan it again from all sides, or crop it so that it ends in one cut.",
        )
    mesh, mended = _solid(mesh)
    planes: list[Plane] = [
        (end.limit + levels[end.name] * end.inward, end.inward) for end in ends if end.name in levels
    ]
    mesh = cut_within(mesh, planes)
    cuts = tuple(f"The open {name} was cut level and closed." for name in levels)
    return Closed(
        mesh, np.concatenate(unsure), (*_filled_notes(filled, size), *mended, *cuts, *_tunnels(mesh))
    )


def _level(rim: Float64[np.ndarray, "N 3"], end: _End, size: float) -> float:
    """The height above the limit at which an end is cut: within its rim, unless that is very ragged."""
    heights = (rim - end.limit) @ end.inward
    return float(min(heights.max(), heights.min() + _RAGGED * size)) + _RIM_ABOVE * size


def _filled_notes(filled: list[tuple[float, str, bool]], size: float) -> list[str]:
    """(width, place, whether the fitted person was followed) of every hole, in sentences, the widest first."""
    notes = []
    filled = sorted(filled, key=lambda hole: -hole[0])
    for span, where, followed in filled[:_NAMED]:
        if span > _UNSURE * size:
            how = "as the fitted person is there" if followed else "as the skin around it goes on"
            notes.append(
                f"An opening {span:.0f} mm wide at {where} was closed {how}; what was there is not known, so "
                "nothing may rest on it."
            )
        elif span > _SMALL * size:
            notes.append(f"A hole {span:.0f} mm wide at {where} was filled as the skin around it goes on.")
    others = len(filled) - len(notes)
    return [*notes, f"Other holes that were filled: {others}."] if others else notes


def _tunnels(mesh: Mesh) -> tuple[str, ...]:
    """A note about the handles of a closed surface."""
    handles = 1 - (len(mesh.vertices) - len(mesh.faces) // 2) // 2
    return (
        (f"The scan has {handles} tunnels (between fingers, behind an ear, in hair), which were left.",)
        if handles > 0
        else ()
    )


def _unseen(mesh: Mesh, fit: PartFit) -> SurfaceDistance | None:
    """The fitted skin where the scan has none, no lower than the scan goes; None where there is next to nothing."""
    skin = fit.part.mesh(fit.points)
    away = SurfaceDistance(mesh).closest(skin.vertices).distances
    apart = (away > 0.02 * size_of(fit)) & np.all(
        [(skin.vertices - end.limit) @ end.inward > _lowest(mesh, end) for end in _ends(fit)], axis=0
    )
    faces = apart[skin.faces].all(1)
    return SurfaceDistance(skin.submesh(faces)) if faces.sum() > 50 else None


def _lowest(mesh: Mesh, end: _End) -> float:
    """How far the scan goes beyond the limit of an end, as a height; 0 where it does not reach it."""
    return min(0.0, float(((mesh.vertices - end.limit) @ end.inward).min()))


def _span(points: Float64[np.ndarray, "N 3"]) -> float:
    """Largest extent of points, mm, to a few per cent."""
    middle = points - points.mean(0)
    return float(np.ptp(middle @ np.linalg.svd(middle, full_matrices=False)[2][0]))


def _ends(fit: PartFit) -> list[_End]:
    """Where a scan of this part may end."""
    part, points = fit.part, fit.points
    at = {name: points[row] for name, row in part.landmarks.items()}
    at |= dict(zip(part.joint_names, points[part.skin :], strict=True))
    up = np.array([0.0, 0.0, 1.0])
    side = "_" + part.kind.partition("_")[2]
    if part.kind == "head":
        return [_End("neck", at["menton"], up)]
    if part.kind.startswith("hand"):
        along = at["wrist" + side] - at["lowerarm" + side]
        return [_End("forearm", at["wrist" + side], along / np.linalg.norm(along))]
    sole = points[: part.skin, 2].min()
    floor = _End("sole", np.array([0.0, 0.0, sole + 0.05 * size_of(fit)]), up)
    if part.kind.startswith("foot"):
        return [_End("leg", at["foot" + side], -up), floor]
    return [_End("sole", np.array([0.0, 0.0, sole + 20.0]), up)]


def _beyond(rim: Float64[np.ndarray, "N 3"], end: _End) -> bool:
    """Whether an opening lies beyond the limit, nearly all of it."""
    return bool(np.quantile((rim - end.limit) @ end.inward, 0.9) < 0)


def _where(point: Float64[np.ndarray, "3"], fit: PartFit | None) -> str:
    """The place in words: the nearest landmark, or the coordinates."""
    if fit is None or not fit.part.landmarks:
        return "({:.0f}, {:.0f}, {:.0f})".format(*point)
    names = list(fit.part.landmarks)
    rows = fit.points[[fit.part.landmarks[name] for name in names]]
    return "the " + names[int(np.linalg.norm(rows - point, axis=1).argmin())].replace("_", " ")


def _solid(mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """(a manifold that rarely crosses itself; a note when it had to be made anew on a grid)."""
    status = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(mesh.vertices), mesh.faces.astype(np.uint64))
    ).status()
    if status == manifold3d.Error.NoError and (share := _crossing_share(mesh)) <= _CROSSING:
        return mesh, ()
    why = (
        "was no manifold"
        if status != manifold3d.Error.NoError
        else f"crossed itself at {share:.1%} of its triangles"
    )
    return remeshed(mesh), (f"The skin {why}; it was made anew on a grid.",)


def _crossing_share(mesh: Mesh) -> float:
    """Share of the faces that cross another face."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(np.array(mesh.vertices), np.array(mesh.faces)))
    meshes.compute_selection_by_self_intersections_per_face()
    return float(np.asarray(meshes.current_mesh().face_selection_array(), dtype=bool).mean())
