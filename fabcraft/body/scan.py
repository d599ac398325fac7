"""`scan(path)`: somebody's scan, or a figure, becomes a `Body`: cleaned, upright, closed, landmarked; never bent.

file → pieces united → orderly → thinned → found (`scan_find`) → turned into the body frame → refined where things are
worn → closed (`scan_close`) → landmarks and regions taken from the fitted person.  What was assumed or mended is said
in `Body.notes`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fabcraft.body.body import Body
from fabcraft.body.model import HumanModel, human_model
from fabcraft.body.scan_clean import orderly, welded
from fabcraft.body.scan_close import closed
from fabcraft.body.scan_density import refined, seen, thinned, thinning_note
from fabcraft.body.scan_figure import figure_landmarks, figure_regions
from fabcraft.body.scan_find import Found, find, similarity_of
from fabcraft.body.scan_fit import PartFit
from fabcraft.body.scan_marks import has_enough, read_marks, require_enough
from fabcraft.body.scan_part import ASKED, Kind, PartModel, adult, part_model
from fabcraft.body.scan_pieces import assembled
from fabcraft.body.scan_places import joints_of, landmarks_on, regions_on, size_of
from fabcraft.body.scan_turn import file_frame, require_axes, rotations_of, turn_note
from fabcraft.body.scan_units import every_unit, file_mm, guesses, unit_note, words_of
from fabcraft.errors import InputError
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.read.mesh_file import read_mesh


@dataclass(frozen=True)
class ScanSettings:
    """What is known of a scan; what is left out is found."""

    units: str = ""
    """mm, cm, m or in."""
    kind: str = "auto"
    """auto, head, hand, foot or body; a hand or foot may be named by its side, as in hand_left."""
    up: str = ""
    """The file's axis to the top of the head or of the leg, or out of the back of the hand: x, y, z, -x, -y or -z."""
    front: str = ""
    """The file's axis that the face or the toes look along, or that the fingers point along."""
    landmarks: str = ""
    """A file of landmarks in the scan's own unit and frame: JSON, TOML or CSV, name to x, y, z."""


class NotFoundError(InputError):
    """Nothing that is worn on was found; carries what was, for a picture."""

    def __init__(self, message: str, next_step: str, found: Body) -> None:
        super().__init__(message, next_step)
        self.found = found
        """The scan with the landmarks where the best fit would have them."""


_NO_SETTINGS = ScanSettings()
_FINE, _COARSE = 0.012, 0.06
"""Longest edges where a thing may rest, and elsewhere, as shares of the part's size."""
_OFF_SURFACE = 0.03
"""Share of the scan's size by which a given landmark may be off its surface."""


def scan(path: Path | str, settings: ScanSettings = _NO_SETTINGS) -> Body:
    """The person, or the part of one, in a scan file (STL, OBJ, PLY, GLB, 3MF) as a body.

    Raises `InputError` for an unreadable file, a size that nobody has, a surface with too much missing, or settings
    that do not suit it; `NotFoundError` where nobody was found.
    """
    path = Path(path)
    if settings.kind not in ASKED:
        raise InputError(f"--body-kind '{settings.kind}' was asked", f"Choose one of: {', '.join(ASKED)}.")
    require_axes(settings.up, settings.front)
    model = human_model()
    marks = _marks(path, settings, model)
    raw, notes = welded(read_mesh(path, settings.units or None))
    raw, joined = assembled(raw)
    size = float(raw.size_mm.max())
    kinds = _kinds(settings, marks, model)
    options = every_unit(path, settings.units, kinds) if marks else guesses(size, path, settings.units, kinds)
    thin = thinned(raw)
    surface, repairs = orderly(thin)
    _require_near(surface, marks)
    parts = {kind: part_model(model, kind) for kind in dict.fromkeys(guess.kind for guess in options)}
    frames = {kind: _frame(part, model) for kind, part in parts.items()}
    turns = {kind: rotations_of(frame, settings.up, settings.front, path) for kind, frame in frames.items()}
    cloud, rim = seen(surface)
    found = find(cloud, rim, options, parts, turns, marks)
    said = (
        unit_note(path, found.guess.unit, found.guess.factor * size, settings.units),
        *notes,
        *joined,
        *thinning_note(raw, thin, found.guess.factor),
        *repairs,
        turn_note(
            found.main.state.place.rotation, frames[found.guess.kind], settings.up, settings.front, path
        ),
        _shown(found),
    )
    if not found.person and not marks:
        raise NotFoundError(*_nobody(path, found, settings), _as_found(surface, found, said))
    return _body(surface, found, marks, said)


def _as_found(surface: Mesh, found: Found, said: tuple[str, ...]) -> Body:
    """The scan as it is in the body frame, with the landmarks of the fit."""
    home = similarity_of(found.main)
    part, points = found.main.part, home.points(found.main.points)
    upright = surface.with_vertices(home.points(found.guess.factor * surface.vertices))
    landmarks = {name: points[row] for name, row in part.landmarks.items()}
    return Body(surface.name, upright, landmarks, {}, "scan", notes=said)


def _body(surface: Mesh, found: Found, marks: Mapping[str, np.ndarray], said: tuple[str, ...]) -> Body:
    """The scan in the body frame, closed, with its places."""
    home = similarity_of(found.main)
    fits = tuple(replace(fit, points=home.points(fit.points)) for fit in found.fits)
    upright = surface.with_vertices(home.points(found.guess.factor * surface.vertices))
    skin = closed(_finer(upright, fits), fits[0] if found.person else None)
    given = {name: home.points(found.guess.factor * point[None])[0] for name, point in marks.items()}
    given = _on_surface(skin.mesh, given)
    if found.person or found.guess.kind != "head":
        regions, lacking = regions_on(skin.mesh, fits, skin.unsure, person=found.person)
        landmarks = landmarks_on(skin.mesh, skin.planes, fits, given, person=found.person)
    else:
        regions, lacking = figure_regions(skin.mesh, fits[0])
        landmarks = figure_landmarks(skin.mesh, fits[0], given)
    missing = (f"The scan does not show: {', '.join(lacking).replace('_', ' ')}.",) if lacking else ()
    return Body(
        surface.name,
        skin.mesh,
        landmarks,
        regions,
        "scan",
        joints_of(fits),
        (*said, *skin.notes, *missing, *_estimated(landmarks, skin.unsure, size_of(fits[0]))),
    )


def _estimated(landmarks: Mapping[str, np.ndarray], unsure: np.ndarray, size: float) -> tuple[str, ...]:
    """A note about the landmarks that lie on fillings."""
    if not len(unsure):
        return ()
    away = cKDTree(unsure).query(np.stack(list(landmarks.values())))[0]
    names = [name for name, distance in zip(landmarks, away, strict=True) if distance < 0.02 * size]
    return (
        (f"Estimated, since they were not scanned: {', '.join(names).replace('_', ' ')}.",) if names else ()
    )


def _marks(path: Path, settings: ScanSettings, model: HumanModel) -> dict[str, np.ndarray]:
    """The given landmarks in the frame and unit that the scan is read into."""
    if not settings.landmarks:
        return {}
    given = read_marks(settings.landmarks, (*model.landmarks, "eye_left", "eye_right"))
    turn = file_frame(path)
    return {name: file_mm(path, settings.units) * turn @ point for name, point in given.items()}


def _kinds(settings: ScanSettings, marks: Mapping[str, np.ndarray], model: HumanModel) -> tuple[Kind, ...]:
    """The kinds asked for that have all the given landmarks."""
    asked = ASKED[settings.kind]
    if not marks:
        return asked
    having = [kind for kind in asked if set(marks) <= set(part_model(model, kind).landmarks)]
    if not having:
        raise InputError(
            f"no kind of scan has all the landmarks {', '.join(marks)}",
            "Give those of one part: a head, a hand, a foot, or a whole body.",
        )
    enough = [kind for kind in having if has_enough(marks, kind)]
    if not enough:
        require_enough(marks, having[0], Path(settings.landmarks))
    return tuple(enough)


def _frame(part: PartModel, model: HumanModel) -> tuple[np.ndarray, np.ndarray]:
    return part.frame(part.points(part.reduction @ adult(model)))


def _shown(found: Found) -> str:
    """What was found, and how well."""
    fit, name = found.main, words_of(found.guess.kind)
    if not found.person:
        return f"It was taken as {name} by the given landmarks; its shape is nobody's, so places between them are rough."
    said = f"It shows {name}: {fit.matched:.0%} of the fitted one lies on it, {fit.rms:.1f} mm away (rms)."
    if found.doubt is not None:
        said += f" It may as well be {words_of(found.doubt)}; if so, pass --body-kind {found.doubt}."
    return said


def _nobody(path: Path, found: Found, settings: ScanSettings) -> tuple[str, str]:
    """(what was found, what to do)."""
    told = {
        "kind": settings.kind if settings.kind != "auto" else "",
        "up": settings.up,
        "front": settings.front,
    }
    flags = [f"--body-{name} {value}" for name, value in told.items() if value]
    more = (
        f"leave out {' and '.join(flags)}, unless sure of it, so that it is found"
        if flags
        else "say more with --body-kind, --body-up and --body-front"
    )
    return (
        f"nobody was found in {path.name}: the best guess is {words_of(found.guess.kind)}, of which only "
        f"{found.main.matched:.0%} lies on the scan",
        f"Crop it to a head, a hand, a foot or a body; {more}; or name its landmarks in a file (--body-landmarks).",
    )


def _finer(mesh: Mesh, fits: Sequence[PartFit]) -> Mesh:
    """`mesh` with short edges where something may rest."""
    for fit in fits[1:] or fits:
        rows = [region.vertex_indices for region in fit.part.regions.values() if region.weight > 0]
        rows = [*rows, np.array([row for row in fit.part.landmarks.values() if row < fit.part.skin])]
        size = size_of(fit)
        mesh = refined(mesh, fit.points[np.unique(np.concatenate(rows))], _FINE * size, _COARSE * size)
    return mesh


def _require_near(mesh: Mesh, given: Mapping[str, np.ndarray]) -> None:
    """Raises `InputError` for a given landmark that is far from the skin."""
    limit = float(mesh.size_mm.max())
    points = {name: point for name, point in given.items() if not name.startswith("eye_")}
    if not points:
        return
    away = SurfaceDistance(mesh).closest(np.stack(list(points.values()))).distances / limit
    name, share = max(zip(points, away.tolist(), strict=True), key=lambda pair: pair[1])
    if share > _OFF_SURFACE:
        raise InputError(
            f"the landmark {name} lies {share:.0%} of the scan's size away from its surface",
            "Landmarks are in the scan's own unit and frame, as its program shows them.",
        )


def _on_surface(mesh: Mesh, given: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Given landmarks put onto the skin; the eye centres stay."""
    if not given:
        return {}
    near = SurfaceDistance(mesh).closest(np.stack(list(given.values()))).points
    return {
        name: point if name.startswith("eye_") else near[index]
        for index, (name, point) in enumerate(given.items())
    }
