"""Numbers of one cell of the table: how an object sits on its body, and how like its guidance it is. Names as in reports.

Signed distances s to the body are positive outside; S are samples spread evenly by area, C the reference's contacts.
    pen_area_pct           share of S with s < -0.1 mm
    pen_volume_mm3         volume of the intersection of object and body, where both are manifold
    contact_within_1mm_pct share of C whose distance to the object is within 1 mm of its gap
    silhouette_iou         mean over the fixed views of |object ∩ guidance| / |object ∪ guidance|, parallel projection
    drawing_iou            the same in one view: the picture that the drawing was laid in, as far as a drawing may reach
    chamfer_mm             mean of the two mean distances between the surfaces of object and guidance
    clip_cos, clip_cos_std mean and deviation over the views of the cosine of picture and prompt
The fixed views are eight directions round the object at elevations of 0, 20 and 40 degrees. They ask for all of the
guidance, also for its temples, ear hooks and neck, which were made for another body and which this wearer's should not
resemble; the drawing's own picture asks for the design alone. What cannot be measured is absent, never zero.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from fabcraft.check.wear import measure_fit, surface_samples
from fabcraft.evaluate.reference import Picture, Reference
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.raster import silhouette_mask
from fabcraft.mesh import Mesh
from fabcraft.solid.manifolds import try_manifold
from fabcraft.write.camera import View

if TYPE_CHECKING:
    from fabcraft.guidance.clip import ClipModel

TOUCH_MM, NEAR_MM = 0.1, 1.0
"""Depth that counts as inside, and the miss that counts as touching."""
PIXELS, SAMPLES = 192, 8000


def fixed_views() -> Iterator[View]:
    """The 24 views."""
    for elevation in (0.0, 20.0, 40.0):
        for azimuth in range(0, 360, 45):
            yield View(float(azimuth), elevation)


def fit_metrics(mesh: Mesh, reference: Reference) -> dict[str, float]:
    """How `mesh` sits on the reference's body and contacts."""
    body = reference.body
    found = measure_fit(mesh, body, reference.contacts, reference.gaps_mm)
    numbers = {name: float(value) for name, value in found.metrics().items()}  # type: ignore[arg-type]
    signed = body.signed(surface_samples(mesh, SAMPLES))
    numbers["pen_area_pct"] = 100.0 * float(np.mean(signed < -TOUCH_MM))
    solid, skin = try_manifold(mesh), try_manifold(body.mesh)
    if solid is not None and skin is not None:
        numbers["pen_volume_mm3"] = max(0.0, float((solid ^ skin).volume()))
    if reference.contacts is not None and len(reference.contacts):
        miss = np.abs(SurfaceDistance(mesh).closest(reference.contacts).distances - reference.gaps_mm)
        numbers["contact_within_1mm_pct"] = 100.0 * float(np.mean(miss <= NEAR_MM))
    return numbers


def likeness_metrics(mesh: Mesh, goal: Mesh, picture: Picture | None = None) -> dict[str, float]:
    """How like `goal` the object is, both where they are worn.  picture : the one that the drawing was laid in."""
    points = surface_samples(mesh, SAMPLES), surface_samples(goal, SAMPLES)
    there = SurfaceDistance(goal).closest(points[0]).distances.mean()
    back = SurfaceDistance(mesh).closest(points[1]).distances.mean()
    overlaps = [overlap(mesh, goal, Picture.whole(view, mesh, goal)) for view in fixed_views()]
    found = {"silhouette_iou": float(np.mean(overlaps)), "chamfer_mm": 0.5 * float(there + back)}
    if picture is not None:
        found["drawing_iou"] = overlap(mesh, goal, picture)
    return {name: value for name, value in found.items() if np.isfinite(value)}


def overlap(one: Mesh, other: Mesh, picture: Picture) -> float:
    """Intersection over union of two silhouettes in a picture; NaN where neither is in it."""
    scale = (PIXELS - 4) / float(picture.size_mm.max())
    width, height = (int(side) + 4 for side in np.ceil(picture.size_mm * scale))

    def seen(mesh: Mesh) -> Bool[np.ndarray, "H W"]:
        flat = mesh.vertices @ picture.axes.T
        pixels = (flat - 0.5 * (picture.lower + picture.upper)) * scale + 0.5 * np.array([width, height])
        covered: Bool[np.ndarray, "H W"] = silhouette_mask(pixels, mesh.faces, width, height, 2) >= 0.5
        return covered

    a, b = seen(one), seen(other)
    return float((a & b).sum() / (a | b).sum()) if (a | b).any() else float("nan")


def clip_metrics(mesh: Mesh, prompt: str, model: "ClipModel") -> dict[str, float]:
    """The raw cosine of the prompt with shaded pictures of the object on white, over the fixed views."""
    import torch

    from fabcraft.fit.camera import orbit
    from fabcraft.fit.render import render
    from fabcraft.fit.topology import Topology

    middle = mesh.bounds.mean(0)
    radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
    points = torch.from_numpy((mesh.vertices - middle) / radius).float()
    cameras = [
        orbit((0.0, 0.0, 0.0), 3.2, one.azimuth_deg, one.elevation_deg, 40.0, 224) for one in fixed_views()
    ]
    with torch.no_grad():
        images = render(points, Topology.of(mesh.faces), cameras, ("shaded", "mask"))
        seen = model.encode_images(images.of("shaded"), images.of("mask"))
        cosines = (seen @ model.encode_text([prompt])[0]).cpu().numpy()
    return {"clip_cos": float(cosines.mean()), "clip_cos_std": float(cosines.std())}
