"""The head as the maker of hats and helmets sees it: its middle, its section without the ears, its size.

Round the head, the azimuth is 0 in front and pi behind, alike on both sides.  What is worn is symmetric to x = 0.
Hat sizes name the head's circumference: S, M, L in steps of 20 mm, and what `body.sizes` knows.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from fabcraft.body.body import Body
from fabcraft.body.sizes import asked
from fabcraft.body.tape import girth
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.template.catalogue import Settings
from fabcraft.template.template import DonningPath

Points = Float64[np.ndarray, "N 3"]

LANDMARKS = ("glabella", "opisthocranion", "menton", "eye_left", "eye_right", "ear_tip_left", "tragion_left")
HEAD_MM = 200.0
"""Length of a median man's head (ANSUR II), which the numbers of helmets and visors are made for."""
LEAST_WALL_MM = 1.6
_LETTERS = {"XS": 530.0, "S": 550.0, "M": 570.0, "L": 590.0, "XL": 610.0, "XXL": 630.0}
_STEPS = 180
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Head:
    """The part of a body that wears it, and its measures."""

    part: Body
    at: Mapping[str, Float64[np.ndarray, "3"]]
    """Joints and landmarks of the wearer, mm."""
    middle: Float64[np.ndarray, "3"]
    """Between glabella and opisthocranion, in the plane x = 0, mm."""
    scale: float
    """Its size over a median man's."""
    ears: tuple[float, float]
    """Azimuths between which an ear stands."""
    round_mm: float
    """Its circumference."""

    def azimuth(self, points: Points) -> Float64[np.ndarray, " N"]:
        """0 in front, pi behind."""
        away = points - self.middle
        return np.arctan2(np.abs(away[:, 0]), -away[:, 1])

    def sized(self, points: Points, round_mm: float) -> Points:
        """Points of the head on one that is `round_mm` round."""
        wider = round_mm / self.round_mm
        return self.middle + (points - self.middle) * [wider, wider, 1.0]


@dataclass(frozen=True, eq=False)
class Line:
    """A line round the head: a height for every azimuth."""

    head: Head
    height: CubicSpline
    """z, mm, over the azimuth."""

    @staticmethod
    def through(head: Head, knots: Sequence[tuple[float, float]], soften: float) -> "Line":
        """A smooth line near (azimuth, z), level in front and behind, without overshoot.

        soften : sigma, in radians, of what rounds its bends.
        """
        azimuths, heights = zip(*knots, strict=True)
        line = PchipInterpolator(
            [-azimuths[1], *azimuths, 2.0 * np.pi - azimuths[-2]], [heights[1], *heights, heights[-2]]
        )
        half = line(np.linspace(0.0, np.pi, _STEPS + 1))
        around = gaussian_filter1d(np.append(half, half[-2:0:-1]), soften / np.pi * _STEPS, mode="wrap")
        turn = np.linspace(0.0, 2.0 * np.pi, 2 * _STEPS + 1)
        return Line(head, CubicSpline(turn, np.append(around, around[0]), bc_type="periodic"))

    def lowered(self, by_mm: float) -> "Line":
        """The line moved down."""
        return Line(
            self.head, CubicSpline(self.height.x, self.height(self.height.x) - by_mm, bc_type="periodic")
        )

    def above(self, points: Points) -> Float64[np.ndarray, " N"]:
        """How far points are above the line, mm; square to it where it slopes."""
        azimuth = self.head.azimuth(points)
        radius = np.hypot(*(points - self.head.middle)[:, :2].T)
        steep = self.height(azimuth, 1) / np.maximum(radius, 0.3 * HEAD_MM * self.head.scale)
        return (points[:, 2] - self.height(azimuth)) / np.sqrt(1.0 + steep**2)


def head_of(part: Body, at: Mapping[str, Float64[np.ndarray, "3"]]) -> Head:
    """The measures of a head part whose landmarks `LANDMARKS` are `at` these places."""
    middle = 0.5 * (at["glabella"] + at["opisthocranion"]) * [0.0, 1.0, 1.0]
    length = float(at["opisthocranion"][1] - at["glabella"][1])
    scale = part.scale if part.kind == "character" else length / HEAD_MM
    head = Head(part, at, middle, scale, (0.0, 0.0), 0.0)
    names = [f"{place}_left" for place in ("ear_tip", "ear_root_back", "tragion", "ear_outermost")]
    ear = [at[name] for name in names if name in at]
    if "ear_left" in part.regions:
        ear.extend(part.mesh.vertices[part.regions["ear_left"].vertex_indices])
    azimuths = head.azimuth(np.array(ear))
    eyes = 0.5 * (at["eye_left"] + at["eye_right"])[2]
    # as people measure a head: the largest level girth, 30 to 60 mm above the eyes of a grown head
    top = float(part.mesh.vertices[:, 2].max())
    heights = np.minimum(
        eyes + np.arange(30.0, 61.0, 6.0) * scale, 0.2 * eyes + 0.8 * top
    )  # flat heads end below
    levels = [middle * [1.0, 1.0, 0.0] + height * _UP for height in np.unique(heights)]
    round_mm = max(girth(part.mesh, level, _UP).length_mm for level in levels)
    return replace(head, ears=(float(azimuths.min()), float(azimuths.max())), round_mm=round_mm)


def skin_of(mesh: Mesh, chosen: Bool[np.ndarray, " V"]) -> Points:
    """The corners of every face that has a chosen vertex: their hull holds all skin between the chosen ones."""
    return mesh.vertices[np.unique(mesh.faces[chosen[mesh.faces].any(1)])]


def hat_mm(size: float | str) -> float:
    """Circumference that a hat size names: a number is the circumference in mm; "M", "hat57", "US 7 1/8", "UK 7".

    Raises `InputError` for another name.
    """
    name = str(size).strip()
    if name.upper() in _LETTERS:
        return _LETTERS[name.upper()]
    fraction = re.fullmatch(r"([A-Za-z]+) ?([0-9]) ([1-7])/([248])", name)
    if fraction:
        name = f"{fraction[1]}{int(fraction[2]) + int(fraction[3]) / int(fraction[4]):g}"
    return asked({"head": name.replace(" ", "")})[0].mm


def fitting_mm(head: Head, size: float | str | None, kind: str) -> float:
    """Circumference that a `kind` is made for: the head's own, or the size that was asked.

    Raises `InputError` for a size that is too small for the head.
    """
    wanted = head.round_mm if size is None else hat_mm(size)
    if wanted < head.round_mm - 1.0:
        raise InputError(
            f"a {kind} for a head of {wanted:.0f} mm round was asked, but this one has {head.round_mm:.0f} mm",
            f"Choose hat{np.ceil(head.round_mm / 10):.0f} ({10 * np.ceil(head.round_mm / 10):.0f} mm) or larger.",
        )
    return wanted


def wall_mm(head: Head, chosen: Settings, person_mm: float) -> float:
    """The wall that was asked, or the usual one: a character's is 2 % of its head."""
    by_size = max(LEAST_WALL_MM, 0.02 * float(head.part.mesh.size_mm[2]))
    return float(chosen.get("wall", by_size if head.part.kind == "character" else person_mm))


def lifted_off(part: Body, rim: Points, axis: Float64[np.ndarray, "3"], why: str) -> DonningPath:
    """The way off along `axis`, from the seat until everything of the rim is past the head, denser near the seat."""
    travel = float((part.mesh.vertices @ axis).max() - (rim @ axis).min()) + 5.0
    poses = np.tile(np.eye(4), (36, 1, 1))
    poses[:, :3, 3] = travel * np.linspace(0.0, 1.0, len(poses))[:, None] ** 1.6 * axis
    return DonningPath(poses, 0.3, why)


def least_facing_axis(part: Body, names: Sequence[str]) -> Float64[np.ndarray, "3"]:
    """The upward direction in the plane x = 0 along which the places `names` of the skin are least undercut.

    It has the largest least cosine with their normals, within 20 degrees of upright.
    """
    normals = part.mesh.vertex_normals
    facing = [normals[part.regions[name].vertex_indices].mean(0) for name in names if name in part.regions]
    tilts = np.radians(np.arange(-20.0, 20.5, 1.0))
    axes = np.stack([0.0 * tilts, np.sin(tilts), np.cos(tilts)], axis=1)
    if not facing:
        return _UP
    return axes[int(np.argmax((axes @ np.array(facing).T).min(1)))]
