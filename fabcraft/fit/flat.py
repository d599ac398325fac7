"""The flat stage: the template's front view becomes the drawn shape, in the plane, remeshed as it stretches.

The sheet ends half a wall inside the finished rim (print-prep rounds the rim with that radius), so the wanted contour is
the drawn outline moved inwards, and the openings outwards, by half a wall. Rim vertices are drawn along by a monotone
match; the rendered silhouette does the rest. At the end the rim is laid exactly on the smoothed contour, the inside
following harmonically: no ripple is left to print.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from fabcraft.errors import InputError
from fabcraft.fit.camera import Camera, front
from fabcraft.fit.contour_match import match
from fabcraft.fit.descend import Descent, State, Stop, Variables, descend
from fabcraft.fit.lay import lay, remeshed_between
from fabcraft.fit.losses import (
    Term,
    collapse_loss,
    image_loss,
    jacobian_loss,
    point_loss,
    singular_values,
    smoothness_loss,
)
from fabcraft.fit.neighbours import Neighbours
from fabcraft.fit.render import Topology, render
from fabcraft.geometry.contour import (
    counter_clockwise,
    inside,
    level_contours,
    resample,
    signed_distance_image,
    smooth,
)
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.poisson import PoissonSystem
from fabcraft.geometry.triangulate import PlaneMesh

Frame = tuple[Float64[np.ndarray, "2"], float]
"""Middle, mm, and scale of the optimiser's frame."""
Seen = Callable[[int, dict[str, float], Tensor], None]

ROUNDS = 4
"""The steps are shared out among this many rounds; the sheet may be remeshed between two."""
RATE = 6e-2
"""Learning rate of the first round; a third of it leaves a bunny's ears 15 mm short after 120 steps."""


@dataclass(frozen=True)
class FlatWeights:
    """Weights of the flat stage (optimiser's frame: longest template side = 2)."""

    contour: float = 60.0
    """Rim vertices to their matched place on the drawn contours."""
    silhouette: float = 20.0
    """Rendered against drawn silhouette, mean absolute difference."""
    jacobian: float = 0.02
    smoothness: float = 0.05
    collapse: float = 20.0


@dataclass(frozen=True, eq=False)
class FlatFit:
    """The flat sheet at the end, with what led there."""

    sheet: PlaneMesh
    history: dict[str, list[float]]
    remeshed: int
    """How many times the sheet was remeshed."""
    stopped: Stop
    laid_mm: float
    """How far the rims were from the contours when the steps ended: the most that laying them on moved a rim vertex."""
    from_contours: bool
    """The fitted mesh could not be laid on the contours, and was made from them alone: the direct baseline's outline."""


def rim_targets(
    solid: np.ndarray, plane: Plane, openings: int, half_wall_mm: float, smooth_mm: float = 1.2
) -> list[Float64[np.ndarray, "_ 2"]]:
    """The contours that the sheet's rims should take, (x, z) mm: the outline, then the openings from left to right.

    solid : (H, W) bool on `plane`, what the finished object should cover. Raises `InputError` when the shape, less half
    a wall all round, has no single piece with that many openings.
    """
    loops = level_contours(signed_distance_image(solid, plane.pixel_mm), half_wall_mm, soften=1.0)
    contours = [smooth(plane.to_mm(loop), smooth_mm, corner_reach=4.0) for loop in loops]
    if not contours:
        raise InputError(
            f"nothing of the drawn shape is wider than the wall of {2 * half_wall_mm:.1f} mm",
            "Draw it larger.",
        )
    outer = contours[0]
    # islands that a narrow neck parts from the rest lie outside the outline; openings lie inside it
    holes = [hole for hole in contours[1:] if inside(hole.mean(0)[None], [outer])[0]][:openings]
    if len(holes) < openings:
        raise InputError(
            f"the drawn shape leaves {len(holes)} openings with material around them; {openings} are needed",
            "Draw the eyes further from the outline and from each other.",
        )
    return [
        counter_clockwise(outer),
        *sorted((counter_clockwise(h) for h in holes), key=lambda h: h[:, 0].mean()),
    ]


def fit_flat(
    start: PlaneMesh,
    targets: list[Float64[np.ndarray, "_ 2"]],
    edge_mm: float,
    steps: int,
    pixels: int,
    weights: FlatWeights | None = None,
    watch: Callable[[PlaneMesh, int], None] | None = None,
    device: torch.device | str = "cpu",
) -> FlatFit:
    """Deform `start` (x, z in mm) until its rims are `targets`; a quarter of the steps between remeshings."""
    weights = weights or FlatWeights()
    frame = 0.5 * (start.points.min(0) + start.points.max(0)), 2.0 / float(np.ptp(start.points, axis=0).max())
    dense = [resample(target, 0.5 * edge_mm) for target in targets]
    camera, coverage = _silhouette_target(start, targets, pixels)
    wanted = coverage.to(device)
    sheet, remeshed, stopped = start, 0, Stop.STEPS
    history: dict[str, list[float]] = {}
    each = -(-steps // ROUNDS)
    for index in range(ROUNDS):
        try:
            flat = np.column_stack([(sheet.points - frame[0]) * frame[1], np.zeros(len(sheet.points))])
            system = PoissonSystem.of(flat, sheet.faces)
            terms = _terms(system, sheet, dense, frame, camera, wanted, weights)
            rate = RATE * (1.0 - index / ROUNDS) + 4e-3
            descent = Descent(each, rate, 0.5 * rate, final_share=0.5, betas=(0.9, 0.98))
            seen = _watcher(watch, sheet, frame, index * each)
            outcome = descend(system, terms, descent, Variables.rest(len(sheet.faces), 2, device), seen)
            for name, values in outcome.history.items():
                history.setdefault(name, []).extend(values)
            sheet = PlaneMesh(outcome.positions / frame[1] + frame[0], sheet.faces, sheet.loops)
            stopped = outcome.stopped
            if index == ROUNDS - 1 or stopped in (Stop.INTERRUPTED, Stop.NOT_FINITE):
                break
            first, second = singular_values(torch.from_numpy(system.restricted(outcome.positions)))
            if float(first.max()) > 1.4 or float(second.min()) < 0.7:
                sheet = remeshed_between(sheet, dense, edge_mm)
                remeshed += 1
        except KeyboardInterrupt:  # between the steps: while it factorises or remeshes
            stopped = Stop.INTERRUPTED
            break
    laid = lay(sheet, dense, edge_mm)
    return FlatFit(laid.sheet, history, remeshed + laid.remeshed, stopped, laid.moved_mm, laid.from_contours)


def _watcher(
    watch: Callable[[PlaneMesh, int], None] | None, sheet: PlaneMesh, frame: Frame, before: int
) -> Seen | None:
    """What `descend` calls at every step: `watch` with the sheet in millimetres, every tenth step."""
    if watch is None:
        return None

    def seen(step: int, values: dict[str, float], positions: Tensor) -> None:
        if step % 10 == 9:
            points = positions.double().cpu().numpy() / frame[1] + frame[0]
            watch(PlaneMesh(points, sheet.faces, sheet.loops), before + step + 1)

    return seen


def _silhouette_target(start: PlaneMesh, targets: list[np.ndarray], pixels: int) -> tuple[Camera, Tensor]:
    """A front camera that sees start and goal, and the wanted coverage in it."""
    everything = np.concatenate([start.points, *targets])
    plane = Plane.around(everything, float(np.ptp(everything, axis=0).max()) / pixels, 4.0)
    import cv2

    factor = 8
    image = np.zeros((plane.height * factor, plane.width * factor), dtype=np.uint8)
    for target, value in zip(targets, [255] + [0] * (len(targets) - 1), strict=True):
        corners = np.round((plane.to_pixels(target) * factor - 0.5) * 16.0).astype(np.int32)
        cv2.fillPoly(image, [corners.reshape(-1, 1, 2)], value, shift=4)
    coverage = image.reshape(plane.height, factor, plane.width, factor).mean((1, 3)) / 255.0
    return front(plane), torch.from_numpy(coverage.astype(np.float32))


def _terms(
    system: PoissonSystem,
    sheet: PlaneMesh,
    dense: list[np.ndarray],
    frame: Frame,
    camera: Camera,
    wanted: Tensor,
    weights: FlatWeights,
) -> list[Term]:
    (middle, scale), device = frame, wanted.device
    areas = torch.from_numpy(system.areas).float().to(device)
    frames = torch.from_numpy(np.ascontiguousarray(system.frames[:, :2, :])).float().to(device)
    origin = torch.from_numpy(middle).float().to(device)
    neighbours = Neighbours.of(sheet.faces, device)
    topology = Topology.of(sheet.faces)
    loops = [torch.from_numpy(loop.astype(np.int64)).to(device) for loop in sheet.loops]
    matched: dict[str, list[Tensor]] = {}

    def contour(state: State) -> Tensor:
        if state.step % 10 == 0:
            now = state.positions.detach().double().cpu().numpy() / scale + middle
            matched["targets"] = [
                torch.from_numpy((match(now[loop], goal) - middle) * scale).float().to(device)
                for loop, goal in zip(sheet.loops, dense, strict=True)
            ]
        parts = [
            point_loss(state.positions[loop], goal)
            for loop, goal in zip(loops, matched["targets"], strict=True)
        ]
        return torch.stack(parts).sum()

    def silhouette(state: State) -> Tensor:
        flat = state.positions / scale + origin
        vertices = torch.stack([flat[:, 0], torch.zeros_like(flat[:, 0]), flat[:, 1]], 1)
        image = render(vertices, topology, [camera], outputs=("mask",)).of("mask")[0]
        return image_loss(image, wanted) * (wanted.numel() / wanted.sum())

    return [
        Term("contour", weights.contour, contour),
        Term("silhouette", weights.silhouette, silhouette),
        Term("jacobian", weights.jacobian, lambda state: jacobian_loss(state.restricted, frames, areas)),
        Term(
            "smoothness",
            weights.smoothness,
            lambda state: smoothness_loss(state.restricted, frames, neighbours),
        ),
        Term("collapse", weights.collapse, lambda state: collapse_loss(state.restricted, areas)),
    ]
