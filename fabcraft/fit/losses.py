"""The terms of the fit: pure functions of tensors to a 0-d tensor.

Everything is a mean (over area, samples or pixels), never a sum, so that a weight means the same on another mesh.
Lengths are in the optimiser's frame (longest template side = 2). R (F, D, 2) is the restricted Jacobian J W of a face,
D = 3 in space and D = 2 for a map into the plane.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fabcraft.fit.neighbours import Neighbours


@dataclass(frozen=True)
class Term:
    """One summand of the energy: `weight` times `function(state)`."""

    name: str
    weight: float
    function: Callable[..., Tensor]


def jacobian_loss(
    restricted: Float[Tensor, "F D 2"], rest: Float[Tensor, "F D 2"], areas: Float[Tensor, " F"]
) -> Tensor:
    """Area mean of ‖J W − W‖² (Frobenius): how far the map is from doing nothing. CRAFT's α-term, squared."""
    return _area_mean(((restricted - rest) ** 2).sum((1, 2)), areas)


def smoothness_loss(
    restricted: Float[Tensor, "F D 2"], frames: Float[Tensor, "F E 2"], neighbours: Neighbours
) -> Tensor:
    """Mean over neighbouring faces of ‖J_f − J_g‖², J = R Wᵀ: bends in the deformation spread out instead of folding."""
    return neighbours.variation(torch.einsum("fdk,fek->fde", restricted, frames).flatten(1))


def singular_values(restricted: Float[Tensor, "F D 2"]) -> tuple[Tensor, Tensor]:
    """σ₁ ≥ σ₂ of every restricted Jacobian, (F,) each.

    For a map into the plane (D = 2) σ₂ carries the sign of the determinant, so that a turned-over face is negative.
    """
    a, c = restricted[:, :, 0], restricted[:, :, 1]
    if restricted.shape[1] == 2:
        # the floor under the roots keeps them differentiable where J is a rotation (q = 0) or a reflection (p = 0)
        p = torch.sqrt((a[:, 0] + c[:, 1]) ** 2 + (a[:, 1] - c[:, 0]) ** 2 + 1e-12) * 0.5
        q = torch.sqrt((a[:, 0] - c[:, 1]) ** 2 + (a[:, 1] + c[:, 0]) ** 2 + 1e-12) * 0.5
        return p + q, p - q
    trace = (a * a).sum(1) + (c * c).sum(1)
    # (trace/2)² − det of RᵀR is ((|a|² − |c|²)/2)² + (a·c)² ≥ 0; the floor keeps the root differentiable at a similarity
    spread = torch.sqrt((0.5 * ((a * a).sum(1) - (c * c).sum(1))) ** 2 + (a * c).sum(1) ** 2 + 1e-12)
    return torch.sqrt(0.5 * trace + spread), torch.sqrt((0.5 * trace - spread).clamp_min(1e-12))


def collapse_loss(
    restricted: Float[Tensor, "F D 2"],
    areas: Float[Tensor, " F"],
    smallest: float = 0.35,
    largest: float = 4.0,
) -> Tensor:
    """Area mean of max(0, `smallest` − σ₂)² + max(0, σ₁ − `largest`)²: no collapsed, folded or torn faces."""
    first, second = singular_values(restricted)
    return _area_mean(torch.relu(smallest - second) ** 2 + torch.relu(first - largest) ** 2, areas)


def image_loss(image: Tensor, target: Tensor, weight: Tensor | None = None) -> Tensor:
    """Mean absolute difference of two images, over the pixels where `weight` is (L_2D of CRAFT, a mean)."""
    difference = (image - target).abs()
    if weight is None:
        return difference.mean()
    if difference.ndim > weight.ndim:
        difference = difference.mean(-1)
    return (difference * weight).sum() / weight.sum().clamp_min(1.0)


def point_loss(points: Float[Tensor, "N D"], targets: Float[Tensor, "N D"]) -> Tensor:
    """Mean squared distance of matched points; for contacts (`paired`), contours and chamfer sides."""
    return ((points - targets) ** 2).sum(1).mean()


def penetration_loss(
    signed_distance: Float[Tensor, " N"], clearance: Float[Tensor, " N"], areas: Float[Tensor, " N"]
) -> Tensor:
    """Area mean of max(0, δ − s)², s > 0 outside the body: a hinge on the wanted clearance δ.

    CRAFT's L_p with its threshold read as a clearance, so that nothing outside is pulled towards the skin.
    """
    return _area_mean(torch.relu(clearance - signed_distance) ** 2, areas)


def contact_loss(signed_distance: Float[Tensor, " N"], gap: Float[Tensor, " N"]) -> Tensor:
    """Mean squared difference of the distance to the skin and the wanted gap, Huber beyond 0.05.

    Points may slide along the skin; only how far they are from it counts.
    """
    off = (signed_distance - gap).abs()
    knee = 0.05
    return torch.where(off < knee, off**2, 2.0 * knee * off - knee**2).mean()


def normal_consistency_loss(
    vertices: Float[Tensor, "V 3"], faces: Int[Tensor, "F 3"], neighbours: Neighbours
) -> Tensor:
    """Mean of 1 − cos between the normals of neighbouring faces: a smooth surface."""
    a, b, c = vertices.index_select(0, faces.flatten()).view(-1, 3, 3).unbind(1)
    normals = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1, eps=1e-12)
    return 0.5 * neighbours.variation(normals)  # |n − m|² = 2 (1 − n·m)


def rim_loss(vertices: Float[Tensor, "V D"], loops: tuple[Int[Tensor, " _"], ...]) -> Tensor:
    """Mean squared second difference along the rims, in units of the point spacing: no ripple, no saw-tooth."""
    total = vertices.new_zeros(())
    for loop in loops:
        points = vertices[loop]
        before, after = points.roll(1, 0), points.roll(-1, 0)
        spacing = (after - before).norm(dim=1).mean().detach() * 0.5
        total = total + (((before - 2.0 * points + after) / spacing) ** 2).sum(1).mean()
    return total / max(len(loops), 1)


def chamfer_loss(
    points: Float[Tensor, "N 3"],
    targets: Float[Tensor, "M 3"],
    nearest_target: Int[Tensor, " N"],
    nearest_point: Int[Tensor, " M"] | None = None,
) -> Tensor:
    """Mean squared distance to the matched nearest neighbour, from the points and, if given, from the targets too.

    L_CD of CRAFT; one-sided when the targets know only one side of the object.
    """
    loss = point_loss(points, targets[nearest_target])
    if nearest_point is not None:
        loss = loss + point_loss(points[nearest_point], targets)
    return loss


def _area_mean(values: Tensor, areas: Tensor) -> Tensor:
    return (values * areas).sum() / areas.sum()
