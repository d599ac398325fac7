"""Finds the person of given measures: the most ordinary one among people like a preset.

min |W⁻¹ d|²  subject to  m(c₀ + d) = asked,   c₀ the preset, W the spread of people like it.

Gauss-Newton: every tape is laid, its points kept as shares of edges, and its length linearised in the coefficients;
the step is the smallest change that meets the linearised measures.  Then the tapes are laid anew, until the true
measures are met.  |W⁻¹ d| says how rare the person is; beyond one in ten thousand the model is not believed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.sparse import identity
from scipy.special import gammaincinv

from fabcraft.body.body import Body, PartSkin, part_skin
from fabcraft.body.measures import MEASURES, sided
from fabcraft.body.model import HumanModel
from fabcraft.body.parts import cut_of
from fabcraft.body.tape import Tape

TOLERANCE_MM = 0.02
"""Measures nearer than this are met."""
ROUNDS = 15
_ADULT_MM = 1700.0
"""Below this height the local changes, which are in millimetres, spread in proportion."""
HOPELESS = 30.0
"""Farther from the preset, in standard deviations, the search is given up."""
RARITY = 1e-4
"""Share of the people like the preset that are rarer than the model will go."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The person found."""

    coefficients: Float64[np.ndarray, " K"]
    reached_mm: Mapping[str, float]
    """Every asked measure as the tape reads it."""
    rarity: float
    """Distance from the preset in standard deviations, all coefficients together."""
    miss_mm: float
    """Largest difference between an asked and a reached measure."""

    @property
    def believable(self) -> bool:
        """Whether the measures are met by a person who is not too rare."""
        return self.miss_mm < 0.5 and self.rarity <= rarest(len(self.reached_mm))


def rarest(count: int) -> float:
    """Largest believable distance when `count` measures were asked: the chi distribution's tail of `RARITY`."""
    return float(np.sqrt(2.0 * gammaincinv(count / 2.0, 1.0 - RARITY)))


class Fitter:
    """The search from one preset; keeps the subdivided parts, whose faces no shape changes."""

    def __init__(self, model: HumanModel, start: Float64[np.ndarray, " K"]) -> None:
        self.model, self.start = model, start.astype(np.float64)
        self._skins: dict[str, _Skin] = {}
        self._spread = model.spread.copy()
        self._spread[model.common :] *= min(1.0, self._read("height", self.start) / _ADULT_MM)

    def fit(self, asked: Mapping[str, float], near: Float64[np.ndarray, " K"] | None = None) -> Fit:
        """The most ordinary person with these measures, mm; `near` : coefficients to begin the search at.

        asked : names of `measures.MEASURES`, with a side where left and right are to differ.
        """
        targets = self._targets(asked)
        free = self._spread.copy()
        if not any(sided(name)[1] for name in asked):
            free[len(free) - self.model.differences :] = 0.0  # the sides stay mirror images
        goal = np.array(list(targets.values()))
        change = np.zeros(len(free)) if near is None else near - self.start
        used = free > 0.0
        for _ in range(ROUNDS):
            values, slopes = self._readings(targets, self.start + change)
            if not len(goal) or np.abs(goal - values).max() < TOLERANCE_MM:
                break
            scaled = slopes * free
            wanted = goal - values + slopes @ change
            damping = 1e-9 * np.trace(scaled @ scaled.T) * np.eye(len(goal))
            change = free * (scaled.T @ np.linalg.solve(scaled @ scaled.T + damping, wanted))
            rarity = float(np.linalg.norm(change[used] / free[used]))
            if rarity > HOPELESS:  # no person any more, which a tape could not be laid on
                return Fit(self.start + change, dict.fromkeys(asked, np.nan), rarity, np.inf)
        else:
            values, _ = self._readings(targets, self.start + change)
        reached = dict(zip(targets, values.tolist(), strict=True))
        return Fit(
            self.start + change,
            {name: reached[self._key(name, reached)] for name in asked},
            float(np.linalg.norm(change[used] / free[used])),
            float(np.abs(goal - values).max()) if len(goal) else 0.0,
        )

    def reach(self, asked: Mapping[str, float], name: str) -> tuple[float, float]:
        """Smallest and largest `name`, mm, of a believable person with the others as asked.

        The measure is driven both ways until the person becomes too rare; (nan, nan) when the others alone are.
        """
        others = {key: value for key, value in asked.items() if key != name}
        base = self.fit(others)
        if base.rarity > rarest(len(asked)) or base.miss_mm >= 0.5:
            return float("nan"), float("nan")
        middle = self._read(name, base.coefficients)
        low, high = (self._driven(others, name, base, middle, way) for way in (-1.0, 1.0))
        return low, high

    def _driven(self, others: Mapping[str, float], name: str, base: Fit, middle: float, way: float) -> float:
        """The farthest believable value of `name` on the way from `middle` down (-1) or up (1).

        Rarity² grows about as the square of the way: from the farthest person known to be believable the next
        value is guessed by that law, and only a person that was found counts.
        """
        limit, near = rarest(len(others) + 1), base.coefficients
        good, bad, step = middle, np.inf, 0.05 * middle
        for _ in range(8):
            value = middle + way * (abs(good - middle) + step)
            fit = self.fit({**others, name: value}, near)
            gone = abs(value - middle)
            if fit.believable:
                good, near = value, fit.coefficients
                growth = (limit**2 - base.rarity**2) / max(fit.rarity**2 - base.rarity**2, 1e-6)
                step = min(gone * (np.sqrt(growth) - 1.0), 0.9 * (bad - gone), gone)
            else:
                bad = gone
                step = 0.5 * (bad - abs(good - middle))
            if step < 0.002 * middle:
                break
        return good

    def _targets(self, asked: Mapping[str, float]) -> dict[str, float]:
        """The asked measures of single sides: a plain name of a pair is the left one, or both if sides differ."""
        differ = any(sided(name)[1] for name in asked)
        targets = {}
        for name, value in asked.items():
            measure, side = sided(name)
            if not MEASURES[measure].paired or side:
                targets[name] = value
            else:
                targets |= {f"{name}_{side}": value for side in (("left", "right") if differ else ("left",))}
        return targets

    @staticmethod
    def _key(name: str, reached: Mapping[str, float]) -> str:
        return name if name in reached else f"{name}_left"

    def _read(self, name: str, coefficients: Float64[np.ndarray, " K"]) -> float:
        return float(self._readings(self._targets({name: 0.0}), coefficients)[0][0])

    def _readings(
        self, names: Mapping[str, float], coefficients: Float64[np.ndarray, " K"]
    ) -> tuple[Float64[np.ndarray, " M"], Float64[np.ndarray, "M K"]]:
        """(measures, their derivatives with respect to the coefficients)."""
        points = self.model.points(coefficients.astype(np.float32))
        person = self.model.body_at(points, "the person")
        parts: dict[str, Body] = {}
        values, slopes = [], []
        for name in names:
            measure, side = sided(name)
            part = MEASURES[measure].part.replace("*", side)
            if part not in self._skins:
                self._skins[part] = _skin(self.model, person, part)
            skin = self._skins[part]
            if part not in parts:
                parts[part] = skin.at(person)
            tape = MEASURES[measure].read(parts[part], side)
            values.append(tape.length_mm)
            slopes.append(self._slope(tape, skin))
        return np.array(values), np.array(slopes).reshape(len(values), len(coefficients))

    def _slope(self, tape: Tape, skin: "_Skin") -> Float64[np.ndarray, " K"]:
        """d length / d c: the pull of every point, carried to the vertices and joints of the model."""
        pull = np.zeros((skin.matrix.shape[0], 3))
        np.add.at(pull, tape.edges[:, 0], (1.0 - tape.shares)[:, None] * tape.pull)
        np.add.at(pull, tape.edges[:, 1], tape.shares[:, None] * tape.pull)
        coarse = skin.matrix.T @ pull
        used = np.flatnonzero(np.abs(coarse).any(1))
        slope = np.tensordot(self.model.basis[:, skin.old_of_new[used]], coarse[used], 2)
        first = len(self.model.mean) - len(self.model.joint_names)
        for joint, along in tape.joints.items():
            slope = slope + self.model.basis[:, first + self.model.joint_names.index(joint)] @ along
        return slope.astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Skin(PartSkin):
    """A part's subdivision with the fine vertex of every landmark on it."""

    landmarks: Mapping[str, int]

    def at(self, person: Body) -> Body:
        """The part of `person`, smoothed, neither cut nor capped; for measuring."""
        fine = self.fine.with_vertices(self.matrix @ person.mesh.vertices[self.old_of_new])
        places = {key: fine.vertices[index] for key, index in self.landmarks.items()}
        places |= {key: person.landmarks[key] for key in ("eye_left", "eye_right")}
        return Body(person.name, fine, places, {}, "human", person.joints)


def _skin(model: HumanModel, person: Body, name: str) -> _Skin:
    """The frozen skin of a part, or of the whole body when it has no name."""
    if name:
        skin = part_skin(person, cut_of(name, person.name, person.joints, person.landmarks))
    else:
        every = np.arange(len(person.mesh.vertices))
        skin = PartSkin(person.mesh, every, identity(len(every), format="csr"), person.mesh)
    place: Int64[np.ndarray, " V"] = np.full(len(person.mesh.vertices), -1)
    place[skin.old_of_new] = np.arange(len(skin.old_of_new))
    on = {key: int(place[index]) for key, index in model.landmarks.items() if place[index] >= 0}
    return _Skin(skin.coarse, skin.old_of_new, skin.matrix, skin.fine, on)
