"""What a scan shows and where: every part that it may be is laid onto it, and the one that lies best is bent to it.

A whole body is found first as a whole; then its head, hands and feet are found again, each by its own fit, since
what is worn is worn there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import cKDTree

from fabcraft.body.human import HumanModel, human_model
from fabcraft.body.scan_fit import Marks, PartFit, Surface, fitted, held_by, settled
from fabcraft.body.scan_part import Kind, PartModel, part_model
from fabcraft.body.scan_search import SIZE_RANGE, Cloud, Looked, best_start, placements
from fabcraft.body.scan_units import Guess
from fabcraft.geometry.align import Similarity, fit_similarity

MATCHED_AT_LEAST = 0.7
"""Share of the fitted zone that must lie on the scan."""
_CLOSE_SECOND = 1.4
"""Kinds whose first misfit is below this many times the best are looked at closely, three at most."""
_SURE = 0.9
"""When this share of the first kind's zone lies on the scan, only its other side is looked at."""
_DOUBT = 1.15
"""The other side is named as possible when its misfit is below this many times the chosen one's."""
_ROUGH = 4
"""Placements from which the shape is fitted roughly."""
_BODY_PARTS: tuple[Kind, ...] = ("head", "hand_left", "hand_right", "foot_left", "foot_right")


@dataclass(frozen=True, eq=False)
class Found:
    """What a scan shows."""

    guess: Guess
    fits: tuple[PartFit, ...]
    """In mm in the scan's frame; a whole body, then its parts, of which a later one knows better."""
    person: bool
    """Whether it lies well enough to be a person; False for a figure that only landmarks describe."""
    doubt: Kind | None = None
    """The other side, when it lies nearly as well."""

    @property
    def main(self) -> PartFit:
        """The fit of the whole."""
        return self.fits[0]


@dataclass(frozen=True, eq=False)
class _Start:
    """A part as a person of some age."""

    part: PartModel
    origin: Float64[np.ndarray, " K"]
    looked: Looked


def find(
    cloud: Cloud,
    rim: Bool[np.ndarray, " N"],
    guesses: Sequence[Guess],
    parts: Mapping[Kind, PartModel],
    rotations: Mapping[Kind, Float64[np.ndarray, "N 3 3"]],
    marks: Mapping[str, np.ndarray],
) -> Found:
    """The best guess with its fit.

    cloud, marks : as the scan was read; rim : points at a border.  rotations : to be tried for each kind, part to scan.
    """
    model = human_model()
    starts = {guess.kind: _starts(model, parts[guess.kind]) for guess in guesses}
    scaled = {guess.factor: Cloud(guess.factor * cloud.points, cloud.normals) for guess in guesses}
    if marks:
        return min(
            (_by_marks(guess, starts[guess.kind], scaled[guess.factor], rim, marks) for guess in guesses),
            key=lambda found: (not found.person, found.guess.factor != 1.0, found.main.misfit),
        )
    chosen = list(guesses)
    if len(chosen) > 1:
        few = {factor: scan.thinned(500) for factor, scan in scaled.items()}
        first = {
            guess: min(
                best_start(start.looked, few[guess.factor], rotations[guess.kind])
                for start in starts[guess.kind]
            )
            for guess in guesses
        }
        chosen = sorted(guesses, key=first.__getitem__)[:3]
        chosen = [guess for guess in chosen if first[guess] < _CLOSE_SECOND * first[chosen[0]]]
    fits: list[tuple[Guess, tuple[PartFit, Surface]]] = []
    for guess in chosen:
        if (
            fits
            and fits[0][1][0].matched > _SURE
            and fits[0][0].kind.split("_")[0] != guess.kind.split("_")[0]
        ):
            continue
        scan = scaled[guess.factor]
        fits.append((guess, _fitted(starts[guess.kind], scan, rim, rotations[guess.kind])))
    fits.sort(key=lambda pair: pair[1][0].misfit)
    guess, (fit, surface) = fits[0]
    person = fit.matched >= MATCHED_AT_LEAST
    base = guess.kind.partition("_")[0]
    doubt = next(
        (
            other.kind
            for other, (second, _) in fits[1:]
            if other.kind.startswith(base) and second.misfit < _DOUBT * fit.misfit
        ),
        None,
    )
    if not person:
        return Found(guess, (fit,), False, doubt)
    whole = settled(fit, surface)
    if guess.kind != "body":
        return Found(guess, (whole,), True, doubt)
    return Found(guess, (whole, *_parts_of(model, whole, surface)), True)


def _starts(model: HumanModel, part: PartModel) -> list[_Start]:
    """The part of an adult and of a child."""
    adult = (model.presets["man"] + model.presets["woman"]) / 2
    found = []
    for origin in (adult.astype(np.float64), model.presets["child"].astype(np.float64)):
        points = part.points(origin)
        mesh = part.mesh(points)
        axis, length = part.axis(points)
        cloud = Cloud(mesh.vertices, mesh.vertex_normals).thinned(500)
        found.append(_Start(part, origin, Looked(cloud, axis, length)))
    return found


def _surface(part: PartModel, points: np.ndarray, scale: float, scan: Cloud, rim: np.ndarray) -> Surface:
    """The scan for a part of the size that its zone has at `points`."""
    return Surface.of(scan, rim, scale * float(np.ptp(points[part.zone], axis=0).max()))


def _fitted(
    starts: Sequence[_Start],
    scan: Cloud,
    rim: Bool[np.ndarray, " N"],
    rotations: Float64[np.ndarray, "N 3 3"],
) -> tuple[PartFit, Surface]:
    """The best fit of one part over ages and rotations."""
    few = scan.thinned(500)
    placed = [
        (misfit, place, start)
        for start in starts
        for misfit, place in placements(start.looked, few, rotations)
    ]
    placed.sort(key=lambda entry: entry[0])
    best = placed[0]
    part = best[2].part
    surface = _surface(part, part.points(best[2].origin), best[1].scale, scan, rim)
    rough = [fitted(part, surface, place, start.origin, 8) for _, place, start in placed[:_ROUGH]]
    near = min(rough, key=lambda fit: fit.misfit)
    return fitted(part, surface, near.place, near.coefficients, 14), surface


def _by_marks(
    guess: Guess,
    starts: Sequence[_Start],
    scan: Cloud,
    rim: Bool[np.ndarray, " N"],
    given: Mapping[str, np.ndarray],
) -> Found:
    """The fit that known landmarks (in the unit as read) begin."""
    part = starts[0].part
    names = [name for name in given if name in part.landmarks]
    marks = Marks(
        np.array([part.landmarks[name] for name in names]),
        guess.factor * np.stack([given[name] for name in names]),
    )
    begun = [
        (fit_similarity(start.part.points(start.origin)[marks.rows], marks.points), start) for start in starts
    ]
    place, start = min(begun, key=lambda pair: pair[0].rms)
    surface = _surface(part, part.points(start.origin), place.scale, scan, rim)
    fit = fitted(part, surface, place, start.origin, 14, marks)
    if fit.matched >= MATCHED_AT_LEAST and SIZE_RANGE[0] < fit.place.scale < SIZE_RANGE[1]:
        return Found(guess, (held_by(settled(fit, surface), marks),), True)
    alone = fitted(part, surface, place, start.origin, 0)
    return Found(guess, (held_by(alone, marks),), False)


def _parts_of(model: HumanModel, whole: PartFit, surface: Surface) -> list[PartFit]:
    """Head, hands and feet of a whole body, as far as they are found again."""
    at = _named(whole.part, whole.points)
    tree = cKDTree(surface.cloud.points)
    found = []
    for kind in _BODY_PARTS:
        part = part_model(model, kind)
        own = part.points(whole.coefficients)
        there = _named(part, own)
        start = fit_similarity(
            np.stack([there[name] for name in there]), np.stack([at[name] for name in there]), (0.9, 1.1)
        )
        size = float(np.ptp(own[part.zone], axis=0).max())
        near = np.unique(
            np.concatenate(tree.query_ball_point(start.points(own[: part.skin : 7]), 0.15 * size))
        )
        cloud = Cloud(surface.cloud.points[near.astype(int)], surface.cloud.normals[near.astype(int)])
        local = Surface.of(cloud, surface.rim[near.astype(int)], size)
        fit = fitted(part, local, start, whole.coefficients, 12)
        if fit.matched >= MATCHED_AT_LEAST:
            found.append(settled(fit, local))
    return found


def _named(part: PartModel, points: Float64[np.ndarray, "P 3"]) -> dict[str, np.ndarray]:
    """Landmarks and joints by name."""
    named = {name: points[row] for name, row in part.landmarks.items()}
    return named | dict(zip(part.joint_names, points[part.skin :], strict=True))


def similarity_of(fit: PartFit) -> Similarity:
    """Scan to body frame, without a change of size."""
    return Similarity(1.0, fit.place.rotation, fit.place.translation).inverse()
