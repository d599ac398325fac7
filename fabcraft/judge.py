"""What a finished mask promises its wearer, and how like the drawing it is.

Contacts are judged where the drawn outline covers them; that enough of them are covered, and that the openings are before
the eyes, are promises of their own: a mask pushed up over the forehead sits on its one pad without a fault.
"""

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.ndimage import distance_transform_edt

from fabcraft.check.inspect import Worn
from fabcraft.check.report import Finding
from fabcraft.geometry.contour import inside
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.plane import Plane
from fabcraft.geometry.raster import silhouette_mask
from fabcraft.guidance.inflate import Relief, solid_mask
from fabcraft.mesh import Mesh
from fabcraft.solid.shell import PAD_ROOM_MM
from fabcraft.template.mask import SIGHT_MM
from fabcraft.template.template import Template

PENETRATION_MM = 0.05
"""Nothing of the object is deeper than this in the body."""
COVERED_SHARE = 0.25
"""A region counts as a rest when at least this share of it has a pad."""
EYES = (("eye_right", "right"), ("eye_left", "left"))


def worn(solid: Mesh, template: Template, relief: Relief, distance: SurfaceDistance) -> Worn:
    """What the object is held to on its body: the contacts that it covers rest, no penetration, the eyes free."""
    head = template.body
    contacts, gaps = [np.zeros((0, 3))], [np.zeros(0)]
    for name in template.contacts:
        region = head.regions[name]
        contacts.append(head.mesh.vertices[region.vertex_indices][_covered(name, template, relief)])
        gaps.append(np.full(len(contacts[-1]), max(template.resting_mm, region.never_closer_mm)))
    return Worn(
        body=distance,
        object=solid,
        clearance_mm=0.0,
        penetration_limit_mm=PENETRATION_MM,
        contacts=np.concatenate(contacts),
        gaps_mm=np.concatenate(gaps),
        donning=template.donning,
        eyes=np.stack([head.landmarks[name] for name, _ in EYES]),
    )


def seat_findings(template: Template, relief: Relief) -> list[Finding]:
    """Where the mask cannot rest, and eyes that are not behind an opening."""
    shares = {name: float(np.mean(_covered(name, template, relief))) for name in template.contacts}
    bare = [name.replace("_", " ") for name, share in shares.items() if share < COVERED_SHARE]
    found = []
    if bare:
        rests = len(shares) - len(bare)
        found.append(
            Finding(
                check="rests",
                severity="fail" if rests < 2 else "warn",
                value=rests,
                limit=len(shares),
                advice=f"The outline does not reach the {', '.join(bare)}: the mask does not rest there. "
                "Move or enlarge the drawing (--up, --left, --scale).",
            )
        )
    for name, side in EYES:
        eye = template.body.landmarks[name][[0, 2]][None]
        if not any(inside(eye, [opening])[0] for opening in relief.openings):
            found.append(
                Finding(
                    check="eyes",
                    severity="fail",
                    advice=f"The wearer's {side} eye is not behind an opening. Move the drawing (--up, --left, --scale).",
                )
            )
    return found


def contact_findings(solid: Mesh, template: Template, relief: Relief) -> list[Finding]:
    """What became of the contacts of the wearer's own file: the distance kept, or the gap where it rests."""
    head, found = template.body, []
    surface = SurfaceDistance(solid)
    for name in head.asked:
        if name not in head.regions:
            found.append(
                Finding(check="contacts", severity="note", advice=f"{name} is not on the part that wears it.")
            )
            continue
        region, words = head.regions[name], name.replace("_", " ")
        away = surface.closest(head.mesh.vertices[region.vertex_indices]).distances
        least = float(away.min())
        if least < region.never_closer_mm - PENETRATION_MM:
            found.append(
                Finding(
                    check="contacts",
                    severity="fail",
                    value=round(least, 2),
                    limit=region.never_closer_mm,
                    unit="mm",
                    advice=f"It comes nearer to the {words} than was asked. Move the drawing (--up, --left), or ask less.",
                )
            )
        covered = _covered(name, template, relief) if name in template.contacts else np.zeros(0, dtype=bool)
        if covered.any() and (gap := float(np.percentile(away[covered], 95))) > region.gap_mm:
            found.append(
                Finding(
                    check="contacts",
                    severity="warn",
                    value=round(gap, 2),
                    limit=region.gap_mm,
                    unit="mm",
                    advice=f"It does not come down to the {words} as was asked: the gap there is wider.",
                )
            )
    return found


def likeness(solid: Mesh, template: Template, relief: Relief, fitted: Mesh, direct: Mesh) -> dict[str, float]:
    """Silhouette overlap with the drawn shape: of the finished object, and of three sheets grown by half a wall.

    The sheets (fitted, direct baseline, unfitted template) compare with each other; the object has slots besides.
    """
    half = 0.5 * template.wall_mm
    everything = np.vstack([relief.outline, template.outline, solid.vertices[:, [0, 2]]])
    plane = Plane.around(everything, 0.25 * template.scale, 4.0 * template.scale)
    wanted = solid_mask(relief.outline, relief.openings, plane)

    def overlap(mesh: Mesh, grown_mm: float) -> float:
        pixels = plane.to_pixels(mesh.vertices[:, [0, 2]])
        seen = silhouette_mask(pixels, mesh.faces, plane.width, plane.height) >= 0.5
        if grown_mm > 0.0:  # a wall around a sheet adds half its thickness to the silhouette
            seen |= distance_transform_edt(~seen) * plane.pixel_mm <= grown_mm
        return float((seen & wanted).sum() / (seen | wanted).sum())

    return {
        "silhouette_iou": overlap(solid, 0.0),
        "silhouette_iou_before": overlap(template.mesh, half),
        "silhouette_iou_sheet": overlap(fitted, half),
        "silhouette_iou_direct": overlap(direct, half),
    }


def worn_solid(solid: Mesh, template: Template, distance: SurfaceDistance) -> Worn:
    """What a solid is held to on its body: no penetration, its firm contacts rest, it comes off.

    Of a region, the tenth that is nearest counts: a temple or a tube crosses it on a line.  Regions that it only hangs on
    (weight below 1, as a bangle on a wrist) ask for no gap.
    """
    body = template.body
    firm = [body.regions[name] for name in template.contacts if body.regions[name].weight >= 1.0]
    surface = SurfaceDistance(solid)
    rest, gaps, least = [], [], template.listed_mm[0]
    for region in firm:
        skin = body.mesh.vertices[region.vertex_indices]
        nearest, away = nearest_tenth(surface, skin)
        rest.append(skin[nearest])
        # the gap that it may have, nearest to the one it has: what is between the two misses nothing
        gaps.append(np.clip(away, least, max(least, region.gap_mm)))
    through = None if template.path is None else template.path.through
    pressed = max([-region.never_closer_mm for region in firm], default=0.0)
    return Worn(
        body=distance,
        object=solid,
        penetration_limit_mm=max(PENETRATION_MM, pressed),
        contacts=np.concatenate(rest) if rest else None,
        gaps_mm=np.concatenate(gaps) if gaps else 0.0,
        donning=template.donning,
        path=None if template.path is None else template.path.poses,
        passes=None if through is None else SurfaceDistance(through),
        flex_mm=0.5 if template.path is None else template.path.allowed_mm,
    )


def nearest_tenth(
    surface: SurfaceDistance, points: Float64[np.ndarray, "N 3"]
) -> tuple[Int64[np.ndarray, " M"], Float64[np.ndarray, " M"]]:
    """Which tenth of `points` is nearest to `surface`, at least three of them, and how far each is from it, mm."""
    away = surface.closest(points).distances
    nearest = np.argsort(away, kind="stable")[: max(3, len(points) // 10)]
    return nearest, away[nearest]


def motif_likeness(
    plate_solid: Mesh, plate: Template, relief: Relief, carrier: Mesh | None = None
) -> dict[str, float]:
    """Silhouette overlap of the finished plate with the drawn shape, in the motif's frame, and of the plate before.

    carrier : of a drawn object, the template in the picture: within the drawn outline it fills what the plate leaves.
    """
    everything = np.vstack([relief.outline, plate.outline])
    plane = Plane.around(everything, 0.25, 4.0)
    wanted = solid_mask(relief.outline, relief.openings, plane)

    def seen(mesh: Mesh) -> Bool[np.ndarray, "H W"]:
        pixels = plane.to_pixels(mesh.vertices[:, [0, 2]])
        shown: Bool[np.ndarray, "H W"] = silhouette_mask(pixels, mesh.faces, plane.width, plane.height) >= 0.5
        return shown

    def overlap(shown: Bool[np.ndarray, "H W"]) -> float:
        return float((shown & wanted).sum() / (shown | wanted).sum())

    made = seen(plate_solid)
    if carrier is not None:
        made |= seen(carrier) & wanted
    return {"silhouette_iou": overlap(made), "silhouette_iou_before": overlap(seen(plate.mesh))}


def _covered(name: str, template: Template, relief: Relief) -> Bool[np.ndarray, " N"]:
    """Which points of a region of the body lie under the object, far enough from its rims for a pad."""
    points, front = template.body.mesh.vertices[template.body.regions[name].vertex_indices], template.front
    seen = -points[:, 1] > front.at(front.skin, points[:, [0, 2]]) - SIGHT_MM * template.scale
    return seen & (relief.room_at(points[:, [0, 2]]) > PAD_ROOM_MM * template.scale)
