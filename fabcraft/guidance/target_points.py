"""`TargetPoints`: points that the object's surface should pass through, e.g. of a guidance mesh, without any encoder.

Chamfer distance, squared (L_CD of CRAFT). With P the object's samples and Q the targets:
`both`: mean over P of min |p − q|² + mean over Q of min |q − p|²;
`targets`: the second alone, for targets that know only one side of the object (a relief from one drawing says nothing about
the back), so that what has no counterpart is not pulled;
`object`: the first alone. A trimmed side leaves its worst pairs out. The pairs come from k-d trees (the one of the targets
is built once) and only matched pairs carry a gradient, so identical points are at distance exactly 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Float64, Int
from scipy.spatial import cKDTree
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.geometry.frame import Frame
from fabcraft.geometry.sampling import area_samples
from fabcraft.guidance.guidance import Views
from fabcraft.mesh import Mesh

Sides = Literal["both", "targets", "object"]


@dataclass(frozen=True, eq=False)
class TargetPoints:
    """A chamfer term towards fixed points; build it with `TargetPoints.of`, or from points of your own."""

    points: Float64[np.ndarray, "Q 3"]
    """In the optimiser's frame of the object."""
    sides: Sides = "both"
    trim: float = 1.0
    """Share of the nearest pairs that counts on each side, in (0, 1]."""
    samples: int = 2000
    """Places drawn on the object at every step."""
    seed: int = 0
    weights: Mapping[str, float] = field(default_factory=lambda: {"chamfer": 25.0})
    outputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.points) == 0 or not 0.0 < self.trim <= 1.0 or self.samples < 1:
            raise InputError(
                f"{len(self.points)} target points, {self.samples} samples and a trim of {self.trim} were given",
                "Give at least one point and one sample, and a trim above 0 and at most 1.",
            )
        object.__setattr__(self, "_tree", cKDTree(self.points))

    @staticmethod
    def of(
        target: Mesh,
        rest: Mesh,
        *,
        count: int = 2000,
        sides: Sides = "both",
        trim: float = 1.0,
        weight: float = 25.0,
        seed: int = 0,
    ) -> "TargetPoints":
        """`count` points of an aligned guidance mesh (mm), for an object that starts as `rest`."""
        faces, places = area_samples(target.face_areas, count, np.random.default_rng(seed))
        points = (places[:, :, None] * target.corners[faces]).sum(1)
        placed = Frame.of(rest).inside(points)
        return TargetPoints(placed, sides, trim, count, seed, {"chamfer": weight})

    def describe(self) -> str:
        """One line for the report."""
        toward = {"both": "both ways", "targets": "from the targets", "object": "from the object"}[self.sides]
        kept = "" if self.trim == 1.0 else f", the nearest {100.0 * self.trim:.0f} %"
        return f"{len(self.points)} surface points, {toward}{kept}"

    def losses(self, views: Views) -> dict[str, Tensor]:
        """`chamfer`, squared, in the optimiser's frame."""
        placed = self._samples(views)
        now, tree = placed.detach().double().cpu().numpy(), self.__dict__["_tree"]
        goal = torch.from_numpy(self.points).to(placed)
        loss = placed.new_zeros(())
        if self.sides in ("both", "object"):
            distances, nearest = tree.query(now)
            near = _nearest(distances, self.trim)
            loss = loss + _apart(placed, near, goal, nearest[near])
        if self.sides in ("both", "targets"):
            distances, nearest = cKDTree(now).query(self.points)
            near = _nearest(distances, self.trim)
            loss = loss + _apart(placed, nearest[near], goal, near)
        return {"chamfer": loss}

    def _samples(self, views: Views) -> Float[Tensor, "S 3"]:
        """Places on the object as it is now, evenly by area, others at every step."""
        corners = views.positions[views.faces]
        with torch.no_grad():
            across = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            areas = across.double().norm(dim=1).cpu().numpy()
        faces, places = area_samples(areas, self.samples, np.random.default_rng([self.seed, views.step]))
        weights = torch.from_numpy(places).to(corners)
        return (weights[:, :, None] * corners[torch.from_numpy(faces).to(corners.device)]).sum(1)


def _apart(
    points: Float[Tensor, "S 3"],
    these: Int[np.ndarray, " N"],
    goal: Float[Tensor, "Q 3"],
    those: Int[np.ndarray, " N"],
) -> Tensor:
    """Mean squared distance of matched points."""
    here, there = (torch.from_numpy(index).to(points.device) for index in (these, those))
    return ((points[here] - goal[there]) ** 2).sum(1).mean()


def _nearest(distances: Float64[np.ndarray, " N"], share: float) -> Int[np.ndarray, " K"]:
    """Indices of the smallest `share` of the distances, ascending."""
    count = max(1, round(share * len(distances)))
    return np.sort(np.argsort(distances, kind="stable")[:count])
