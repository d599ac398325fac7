"""Ready for the plate: turned, hollowed, labelled, split and arranged, as far as that is asked, in this order."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import manifold3d
import numpy as np
from jaxtyping import Bool, Int64

from fabcraft.check.report import Finding, Severity
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.edges import components
from fabcraft.mesh import Mesh, concatenate
from fabcraft.profile import PrinterProfile
from fabcraft.solid.hollow import HOLE_MM, WALL_MM, hollow
from fabcraft.solid.label import label
from fabcraft.solid.orient import onto_bed, oriented
from fabcraft.solid.plate_settings import PlateSettings, filled
from fabcraft.solid.split import FILAMENT_MM, fits, split
from fabcraft.template.own import looks_at

SKIN_MM = 4.0
"""Faces that look at skin no farther away than this are the skin side."""
_SAME_MM = 0.01
"""A face nearer to the surface as it was is a part of it."""
_UNDER = -0.9
"""z of the normals of the underside."""
_APART_MM = 0.5
_MOST_BODIES = 60
"""More bodies than this are a chain or a mail, and stay as they lie."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What goes to the printer."""

    pieces: tuple[Mesh, ...]
    """On the bed, mm; on further plates to the right of the first."""
    route: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def whole(self) -> Mesh:
        """All pieces in one mesh."""
        return self.pieces[0] if len(self.pieces) == 1 else concatenate(self.pieces, self.pieces[0].name)


def prepare(
    mesh: Mesh,
    profile: PrinterProfile,
    settings: PlateSettings,
    skin: Bool[np.ndarray, " F"] | None = None,
    words: Mapping[str, str] | None = None,
    pair: bool = False,
) -> Prepared:
    """The closed `mesh` as the settings ask, on the bed.

    What is too large as it lies is arranged part by part, each turned if it fits in another pose, though nobody asked.
    skin : faces that touch the wearer.  words : what the label's placeholders stand for.  pair : the part at x > 0 is L.
    Raises `InputError` for a label that cannot be filled, `SolidError` when a part cannot be made.
    """
    placed = onto_bed(mesh, profile)
    groups = _apart(mesh) if settings.asked or not placed.fits else []
    hopeless = len(groups) == 1 and not fits(mesh, profile)
    if not settings.asked and (placed.fits or hopeless):
        return Prepared((placed.mesh,), (f"laid on the bed {placed.words}",))
    work = _Work(profile, settings, dict(words or {}))
    skin = np.zeros(len(mesh.faces), dtype=bool) if skin is None else skin
    laid = mesh
    if not settings.orient:
        laid = placed.mesh
        work.route.append(f"laid on the bed {placed.words}")
    pieces: list[Mesh] = []
    for group in groups:
        side = ("L" if mesh.corners[group][..., 0].mean() > 0.0 else "R") if pair else ""
        one = laid.submesh(group)
        if len(groups) > 1:
            known = {"L": "left", "R": "right", "": f"{len(pieces) + 1}"}[side]
            one = replace(one, name=f"{mesh.name or 'part'}, {known}")
        pieces += work.done(one, skin[group], side)
    spread = settings.orient or settings.arrange or len(pieces) > len(groups) or not placed.fits
    if spread:
        from fabcraft.solid.arrange import arrange  # brings scipy.signal, a second of imports

        found = arrange(pieces, profile)
        pieces = list(found.meshes)
        work.numbers["plates"] = float(found.count)
        work.route.append(
            f"{len(pieces)} part{'s' * (len(pieces) > 1)} arranged on {found.count} plate{'s' * (found.count > 1)}"
        )
        if found.count > 1:
            work.say(
                "plates",
                f"The {len(pieces)} parts need {found.count} plates: the file holds them all, those of the further plates "
                "to the right of the bed.",
            )
    return Prepared(tuple(pieces), tuple(work.route), tuple(work.findings), work.numbers)


class _Work:
    """One run: what is asked, and the route, findings and numbers that come up on the way."""

    def __init__(self, profile: PrinterProfile, settings: PlateSettings, words: dict[str, str]) -> None:
        self.profile, self.settings, self.words = profile, settings, words
        self.route: list[str] = []
        self.findings: list[Finding] = []
        self.numbers: dict[str, float] = {}

    def say(self, check: str, advice: str, severity: Severity = "note") -> None:
        """Add a finding."""
        self.findings.append(Finding(check=check, severity=severity, advice=advice))

    def done(self, mesh: Mesh, skin: Bool[np.ndarray, " F"], side: str) -> list[Mesh]:
        """One part, ready: itself, or what it was split into, and the pins."""
        if self.settings.orient or (not self._lies_in(mesh) and fits(mesh, self.profile)):
            found = oriented(mesh, self.profile, skin if skin.any() else None)
            mesh = found.mesh
            self.route.append(found.words if self.profile.process in ("fdm", "sla") else "turned to lie low")
            self._add("support_before_mm3", found.before.volume_mm3)
            self._add("support_mm3", found.after.volume_mm3)
        before, name = SurfaceDistance(mesh), mesh.name
        if self.settings.hollow or self.settings.hollow_wall_mm:
            mesh = self._hollowed(mesh, before, skin)
        if self.settings.label:
            mesh = self._labelled(mesh, before, skin, side)
        if not self.settings.split or fits(mesh, self.profile):
            return [replace(mesh, name=name)]
        parts = split(replace(mesh, name=name), self.profile)
        self._add("split_parts", float(len(parts.parts)))
        self.route.append(f"{name} cut into {len(parts.parts)} parts")
        for cut in parts.cuts:
            self._told(cut.pin_mm, len(cut.places), cut.depth_mm)
        return [*(self._on_its_own(one) for one in parts.parts), *parts.pins]

    def _hollowed(self, mesh: Mesh, before: SurfaceDistance, skin: Bool[np.ndarray, " F"]) -> Mesh:
        asked = self.settings.hollow_wall_mm
        if self.profile.process == "fdm" and not asked:
            self.say(
                "hollow",
                "Not hollowed: filament prints are filled with a sparse grid anyway. Give a wall to do it.",
            )
            return mesh
        wall = asked or max(WALL_MM, self.profile.wall_mm)
        found = hollow(
            mesh,
            wall,
            self.profile.drain_hole_mm or HOLE_MM,
            lambda points: skin[before.closest(points).faces],
        )
        if not found.cavities:
            self.say(
                "hollow", f"Not hollowed: nothing is thick enough to leave a wall of {wall:g} mm and drain."
            )
            return mesh
        self._add("hollow_saved_mm3", found.numbers["hollow_saved_mm3"])
        self.numbers["hollow_wall_mm"] = min(
            found.numbers["hollow_wall_mm"], self.numbers.get("hollow_wall_mm", np.inf)
        )
        self._add("drain_holes", float(len(found.holes)))
        self.route.append(
            f"hollowed: {found.cavities} cavit{'y' if found.cavities == 1 else 'ies'}, a wall of {wall:g} mm, "
            f"{len(found.holes)} drain holes of {found.numbers['drain_hole_mm']:g} mm, "
            f"{found.numbers['hollow_saved_mm3'] / 1000.0:.1f} cm³ saved"
        )
        return found.mesh

    def _labelled(self, mesh: Mesh, before: SurfaceDistance, skin: Bool[np.ndarray, " F"], side: str) -> Mesh:
        text = filled(self.settings.label, self.words | ({"side": side} if side else {}))
        near = before.closest(mesh.corners.mean(1))
        outer = near.distances < _SAME_MM
        under = outer & (mesh.face_normals[:, 2] < _UNDER)
        found = label(mesh, text, self.profile, outer & skin[near.faces])
        if not found.done and under.any():
            below = label(mesh, text, self.profile, under)
            found = below if below.done or not skin.any() else found
        if not found.done:
            self.say(
                "label",
                f"{found.said[:1].upper()}{found.said[1:]}. Give a shorter one, or a thicker wall.",
                "warn",
            )
            return mesh
        self.numbers["label_wall_mm"] = min(found.wall_mm, self.numbers.get("label_wall_mm", np.inf))
        self.route.append(found.said)
        return found.mesh

    def _told(self, pin_mm: float, count: int, depth_mm: float) -> None:
        if not count:
            self.say("split", "A cut has no room for pins: its faces are glued as they are.", "warn")
        elif self.profile.process == "fdm" and pin_mm == FILAMENT_MM:
            length = 2.0 * (depth_mm - self.profile.clearance_fit_mm)
            self.say("split", f"{count} pins across a cut are cut from filament, {length:.0f} mm long.")
        else:
            self.say(
                "split", f"{count} loose pins of {pin_mm:g} mm join the parts at a cut; they are in the file."
            )

    def _on_its_own(self, part: Mesh) -> Mesh:
        """A part of a split object in a pose that fits: the one with the least support."""
        return oriented(part, self.profile).mesh

    def _lies_in(self, mesh: Mesh) -> bool:
        """Whether it fits the build volume as it lies, or turned by a right angle."""
        room, size = np.array(self.profile.build_mm), mesh.size_mm
        return bool(size[2] <= room[2] and (np.sort(size[:2]) <= np.sort(room[:2])).all())

    def _add(self, name: str, value: float) -> None:
        self.numbers[name] = self.numbers.get(name, 0.0) + value


def on_skin(mesh: Mesh, body: SurfaceDistance, pair: bool = False) -> Bool[np.ndarray, " F"]:
    """Faces of an object where it is worn that look at skin near by; `pair`: the body is that of one of the two."""
    found = looks_at(mesh, body, SKIN_MM)
    if pair:
        other = Mesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces[:, ::-1].copy())
        found |= looks_at(other, body, SKIN_MM)
    return found


def size_words(parameters: Mapping[str, float | str], measures: Mapping[str, float | str]) -> dict[str, str]:
    """What {size} stands for: a size that was given of the template or of the wearer; nothing when none was."""
    given = [parameters["size"]] if "size" in parameters else [*measures.values()]
    words = [one if isinstance(one, str) else f"{one:g}" for one in given]
    return {"size": words[0]} if words else {}


def _apart(mesh: Mesh) -> list[Int64[np.ndarray, " K"]]:
    """Faces of what can be laid apart: bodies whose hulls meet (links, hinges, voids in a wall) stay together."""
    shells = components(mesh.faces)
    count = int(shells.max()) + 1
    group = np.zeros(count, dtype=np.int64)
    if 1 < count <= _MOST_BODIES:
        group = np.arange(count)
        corners = [mesh.vertices[np.unique(mesh.faces[shells == one])] for one in range(count)]
        hulls = [manifold3d.Manifold.hull_points(points) for points in corners]
        for one in range(count):
            for other in range(one):
                joined = group[one] == group[other]
                if not joined and hulls[one].min_gap(hulls[other], _APART_MM) < _APART_MM:
                    group[group == group[one]] = group[other]
    return [np.flatnonzero(group[shells] == one).astype(np.int64) for one in np.unique(group)]
