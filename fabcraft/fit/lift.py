"""The lifted stage: the fitted outline, on the template's own surface, takes the relief's shape and keeps its fit.

Rest mesh: the flat sheet raised to the template's surface. Per-face Jacobians move it until its rendered depth and normals
are the relief's, its rims stay where the flat stage laid them, it keeps its clearance to the body (hinge) and its distance
to the skin where it is to rest. Material may slide along the skin: only the distance to it is held.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float64
from scipy.spatial import cKDTree
from torch import Tensor

from fabcraft.fit.body_field import BodyField
from fabcraft.fit.camera import front
from fabcraft.fit.descend import Descended, Descent, State, Variables, descend
from fabcraft.fit.gather import Places
from fabcraft.fit.losses import (
    Term,
    chamfer_loss,
    collapse_loss,
    contact_loss,
    image_loss,
    jacobian_loss,
    normal_consistency_loss,
    penetration_loss,
    point_loss,
    rim_loss,
    smoothness_loss,
)
from fabcraft.fit.neighbours import Neighbours
from fabcraft.fit.render import Images, Topology, render
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.poisson import PoissonSystem
from fabcraft.guidance.inflate import Relief
from fabcraft.mesh import Mesh
from fabcraft.template.template import Template


@dataclass(frozen=True)
class LiftWeights:
    """Weights of the lifted stage (optimiser's frame: longest template side = 2)."""

    depth: float = 60.0
    """Rendered against wanted depth, mean absolute difference."""
    normal: float = 0.5
    """Rendered against wanted normals, mean absolute difference."""
    silhouette: float = 20.0
    chamfer: float = 25.0
    """Squared distance to the relief's points, both ways."""
    rim: float = 60.0
    """Rims stay where they were laid, seen from the front."""
    contact: float = 20.0
    """Distance to the skin where the object rests; 0 switches the term off."""
    penetration: float = 1e4
    """Hinge on the clearance; 0 switches the term off."""
    jacobian: float = 0.002
    smoothness: float = 0.02
    collapse: float = 10.0
    consistency: float = 1.0
    """Normals of neighbouring faces agree."""
    ripple: float = 0.02
    """Second differences along the rims."""


@dataclass(frozen=True, eq=False)
class LiftTargets:
    """What the lifted stage aims at, beside the relief itself."""

    relief: Relief
    distance: SurfaceDistance
    """To the body."""
    template: Template


def fit_lifted(
    sheet: Mesh,
    rims: tuple[np.ndarray, ...],
    targets: LiftTargets,
    steps: int,
    pixels: int,
    weights: LiftWeights | None = None,
    watch: Callable[[int, dict[str, float], Mesh], None] | None = None,
    device: torch.device | str = "cpu",
) -> tuple[Mesh, Descended]:
    """Deform `sheet` (mm, faces to the viewer) towards the relief; returns it, and the run."""
    weights = weights or LiftWeights()
    lower, upper = sheet.bounds
    scale, centre = 2.0 / float((upper - lower).max()), 0.5 * (lower + upper)
    system = PoissonSystem.of((sheet.vertices - centre) * scale, sheet.faces)
    terms = _terms(system, sheet, rims, targets, pixels, weights, scale, centre, device)

    def seen(step: int, values: dict[str, float], positions: Tensor) -> None:
        if watch is not None:
            watch(step, values, sheet.with_vertices(positions.double().cpu().numpy() / scale + centre))

    outcome = descend(
        system,
        terms,
        Descent(steps, 1.2e-2, 4e-3, final_share=0.08),
        Variables.rest(len(sheet.faces), 3, device),
        seen,
    )
    return sheet.with_vertices(outcome.positions / scale + centre), outcome


def _terms(
    system: PoissonSystem,
    sheet: Mesh,
    rims: tuple[np.ndarray, ...],
    targets: LiftTargets,
    pixels: int,
    weights: LiftWeights,
    scale: float,
    centre: Float64[np.ndarray, "3"],
    device: torch.device | str,
) -> list[Term]:
    areas, frames, origin = (
        torch.from_numpy(array).float().to(device) for array in (system.areas, system.frames, centre)
    )
    faces = torch.from_numpy(sheet.faces.astype(np.int64)).to(device)
    neighbours = Neighbours.of(sheet.faces, device)
    loops = tuple(torch.from_numpy(rim.astype(np.int64)).to(device) for rim in rims)
    every_rim = torch.cat(loops)
    laid = torch.from_numpy((sheet.vertices - centre) * scale).float().to(device)[every_rim][:, [0, 2]]

    def millimetres(state: State) -> Tensor:
        return state.positions / scale + origin

    images = _image_terms(sheet, targets.relief, pixels, weights, scale, millimetres, device)
    body = _body_terms(sheet, targets, weights, areas, faces, scale, millimetres)
    relief = targets.relief.mesh(edge_mm=3.0 * targets.template.scale)
    goal = torch.from_numpy((relief.vertices - centre) * scale).float()
    goals, goal = goal.numpy(), goal.to(device)
    tree = cKDTree(goals)
    matched: dict[str, Tensor] = {}

    def chamfer(state: State) -> Tensor:
        if state.step % 10 == 0:
            now = state.positions.detach().cpu().numpy()
            matched["goal"] = torch.from_numpy(tree.query(now)[1]).to(device)
            matched["mine"] = torch.from_numpy(cKDTree(now).query(goals)[1]).to(device)
        return chamfer_loss(state.positions, goal, matched["goal"], matched["mine"])

    shape = [
        Term("chamfer", weights.chamfer, chamfer),
        Term("rim", weights.rim, lambda state: point_loss(state.positions[every_rim][:, [0, 2]], laid)),
        Term("jacobian", weights.jacobian, lambda state: jacobian_loss(state.restricted, frames, areas)),
        Term(
            "smoothness",
            weights.smoothness,
            lambda state: smoothness_loss(state.restricted, frames, neighbours),
        ),
        Term("collapse", weights.collapse, lambda state: collapse_loss(state.restricted, areas)),
        Term(
            "consistency",
            weights.consistency,
            lambda state: normal_consistency_loss(state.positions, faces, neighbours),
        ),
        Term("ripple", weights.ripple, lambda state: rim_loss(state.positions, loops)),
    ]
    return [term for term in images + body + shape if term.weight > 0.0]


def _image_terms(
    sheet: Mesh,
    relief: Relief,
    pixels: int,
    weights: LiftWeights,
    scale: float,
    millimetres: Callable[[State], Tensor],
    device: torch.device | str,
) -> list[Term]:
    """Depth, normal and silhouette of one front view; rendered once a step, shared by the three."""
    plane = Plane.around(sheet.vertices[:, [0, 2]], float(sheet.size_mm.max()) / pixels, 4.0)
    camera, topology = front(plane), Topology.of(sheet.faces)
    x, z = plane.centres()
    height = relief.height_at(np.column_stack([x.ravel(), z.ravel()])).reshape(x.shape)
    down, across = np.gradient(height, plane.pixel_mm)
    # the surface is (x, -h(x, z), z); its normal towards the viewer is (-h_x, -1, -h_z), and rows run down
    normals = np.stack([-across, -np.ones_like(height), down], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    wanted_depth, wanted_normal = (torch.from_numpy(array).float().to(device) for array in (-height, normals))
    # the flat stage laid the outline: keeping it is the silhouette's whole target here
    with torch.no_grad():
        start = torch.from_numpy(sheet.vertices.copy()).float().to(device)
        wanted_mask = render(start, topology, camera, outputs=("mask",)).of("mask")[0]
    share = wanted_mask.numel() / wanted_mask.sum()
    shared: dict[str, Any] = {}

    def images(state: State) -> tuple[Images, Tensor]:
        if shared.get("positions") is not state.positions:
            shared["positions"] = state.positions
            shared["images"] = render(
                millimetres(state), topology, camera, outputs=("mask", "depth", "normal")
            )
            mask = shared["images"].of("mask")[0].detach()
            # at rims the pixel holds a share of the depth only; inside it is the depth itself
            shared["inside"] = ((mask > 0.999) & (wanted_mask > 0.999)).float()
        return shared["images"], shared["inside"]

    def depth(state: State) -> Tensor:
        pictures, inside = images(state)
        return scale * image_loss(pictures.of("depth")[0], wanted_depth, inside)

    def normal(state: State) -> Tensor:
        pictures, inside = images(state)
        return image_loss(pictures.of("normal")[0], wanted_normal, inside)

    def silhouette(state: State) -> Tensor:
        pictures, _ = images(state)
        return image_loss(pictures.of("mask")[0], wanted_mask) * share

    return [
        Term("depth", weights.depth, depth),
        Term("normal", weights.normal, normal),
        Term("silhouette", weights.silhouette, silhouette),
    ]


def _body_terms(
    sheet: Mesh,
    targets: LiftTargets,
    weights: LiftWeights,
    areas: Float[Tensor, " F"],
    faces: Tensor,
    scale: float,
    millimetres: Callable[[State], Tensor],
) -> list[Term]:
    """The hinge on the clearance, at face centres and vertices, and the distance to the skin where the sheet rests."""
    relief, template = targets.relief, targets.template
    heights = relief.height_at(sheet.vertices[:, [0, 2]])
    box = np.concatenate(
        [sheet.vertices, np.column_stack([sheet.vertices[:, 0], -heights, sheet.vertices[:, 2]])]
    )
    away, cell = 6.0 * template.scale, 4.0 * template.scale
    lower, upper = box.min(0) - away, box.max(0) + away
    device = faces.device
    field = BodyField.around(targets.distance, lower, upper, cell_mm=cell, device=device)
    half = 0.5 * template.wall_mm
    keep_mm = template.front.at(template.front.clearance, sheet.vertices[:, [0, 2]]) + half
    wanted = torch.from_numpy(keep_mm).float().to(device)
    corner_areas = areas.repeat_interleave(3)[:, None] / 3.0
    vertex_areas = Places.of(faces.reshape(-1), len(sheet.vertices)).added(corner_areas)[:, 0]
    rest_weight = template.front.at(template.front.contact, sheet.vertices[:, [0, 2]])
    resting = torch.from_numpy(np.flatnonzero(rest_weight > 0.5)).to(device)
    both_areas = torch.cat([vertex_areas, areas])
    both_wanted = torch.cat([wanted, wanted[faces].mean(1)]) * scale

    def penetration(state: State) -> Tensor:
        points = millimetres(state)
        signed = field(torch.cat([points, points[faces].mean(1)])) * scale
        return penetration_loss(signed, both_wanted, both_areas)

    def contact(state: State) -> Tensor:
        return contact_loss(field(millimetres(state)[resting]) * scale, wanted[resting] * scale)

    terms = [Term("penetration", weights.penetration, penetration)]
    if len(resting):
        terms.append(Term("contact", weights.contact, contact))
    return terms
