"""What a scan shows and where: every part that it may be is laid onto it, and the one that lies best is bent to it.

A whole body is found first as a whole; then its head, hands and feet are found again, each by its own fit, since
what is worn is worn there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from fabcraft.body.model import HumanModel, human_model
from fabcraft.body.scan_body import parts_of
from fabcraft.body.scan_fit import PartFit, fitted, held_by, judged, settled, stretched_to
from fabcraft.body.scan_part import Kind, PartModel, adult
from fabcraft.body.scan_search import SIZE_RANGE, Cloud, Looked, best_start, placements
from fabcraft.body.scan_step import Marks, Surface, at_rest
from fabcraft.body.scan_units import Guess
from fabcraft.geometry.align import Similarity, fit_similarity

MATCHED_AT_LEAST = 0.7
"""Share of the fitted zone that must lie on the scan."""
_CLOSE_SECOND = 1.4
"""Kinds whose first misfit is below this many times the best are looked at closely, three at most."""
_SURE = 0.9
"""When this share of the first kind's zone lies on the scan, only its other side is looked at."""
_CERTAIN = 0.96
"""When this share lies on the scan after a rough fit, no other placement is tried."""
_DOUBT = 1.15
"""The other side is named as possible when its misfit is below this many times the chosen one's."""
_ROUGH = 4
"""Placements from which the shape is fitted roughly."""


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
    origin: Float64[np.ndarray, " L"]
    looked: Looked


def find(
    cloud: Cloud,
    rim: Bool[np.ndarray, " N"],
    guesses: Sequence[Guess],
    parts: Mapping[Kind, PartModel],
    rotations: Mapping[Kind, Float64[np.ndarray, "_ 3 3"]],
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
    chosen, sparse = list(guesses), cloud.thinned(500)
    few = {factor: Cloud(factor * sparse.points, sparse.normals) for factor in scaled}
    if len(chosen) > 1:
        first = {
            guess: min(
                best_start(start.looked, few[guess.factor], rotations[guess.kind])
                for start in starts[guess.kind][: None if guess.kind == "body" else 1]
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
        seen = scaled[guess.factor], few[guess.factor]
        fits.append((guess, _fitted(starts[guess.kind], *seen, rim, rotations[guess.kind])))
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
    return Found(guess, (whole, *parts_of(model, whole, surface)), True)


def _starts(model: HumanModel, part: PartModel) -> list[_Start]:
    """The part of an adult and of a child."""
    found = []
    for person in (adult(model), model.presets["child"].astype(np.float64)):
        origin = part.reduction @ person
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
    few: Cloud,
    rim: Bool[np.ndarray, " N"],
    rotations: Float64[np.ndarray, "_ 3 3"],
) -> tuple[PartFit, Surface]:
    """The best fit of one part over ages and rotations.  few : the scan in few points."""
    placed = [
        (misfit, place, start)
        for start in starts
        for misfit, place in placements(start.looked, few, rotations)
    ]
    placed.sort(key=lambda entry: entry[0])
    best = placed[0]
    part = best[2].part
    surface = _surface(part, part.points(best[2].origin), best[1].scale, scan, rim)
    rough: list[PartFit] = []
    for _, place, start in placed[:_ROUGH]:
        rough.append(fitted(part, surface, at_rest(part, place, start.origin), 8))
        if rough[-1].matched > _CERTAIN:
            break
    return fitted(part, surface, min(rough, key=lambda fit: fit.misfit).state, 14), surface


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
    state = at_rest(part, place, start.origin)
    fit = fitted(part, surface, state, 14, marks)
    if fit.matched >= MATCHED_AT_LEAST and SIZE_RANGE[0] < place.scale < SIZE_RANGE[1]:
        return Found(guess, (held_by(settled(fit, surface), marks),), True)
    return Found(guess, (stretched_to(judged(part, replace(state, place=place), surface), marks),), False)


def similarity_of(fit: PartFit) -> Similarity:
    """Scan to body frame, without a change of size."""
    place = fit.state.place
    return Similarity(1.0, place.rotation, place.translation).inverse()
