"""Who wears the object, in pictures: the skin, a character's eyes, and the contacts on the skin by what they ask."""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float64

from fabcraft.body.body import Body
from fabcraft.mesh import Mesh
from fabcraft.write.camera import VIEWS
from fabcraft.write.colours import BODY, EYES, KEPT_CLEAR, RESTED_ON
from fabcraft.write.landmarks import head_frame
from fabcraft.write.picture import Item, scene_picture
from fabcraft.write.sheet import contact_sheet, labelled

PORTRAIT = (700, 780)


def wearer_items(body: Body, colours: Float64[np.ndarray, "V 3"] | None = None) -> list[Item]:
    """The skin, in clay or in `colours` per vertex; a character's eyes are dark glass."""
    items = [Item(body.mesh, BODY, vertex_colours=colours, gloss=0.15)]
    if body.kind != "character":
        return items
    for name in ("eye_left", "eye_right"):
        if name in body.regions:
            centre = body.landmarks[name]
            dome = body.mesh.vertices[body.regions[name].vertex_indices] - centre
            # a little larger than the dome, so that the facets of the two do not cross
            ball = trimesh.creation.icosphere(4, 1.012 * float(np.median(np.linalg.norm(dome, axis=1))))
            items.append(Item(Mesh(ball.vertices + centre, ball.faces.astype(np.int32)), EYES, gloss=0.9))
    return items


def contact_colours(body: Body, resting: Sequence[str]) -> Float64[np.ndarray, "V 3"]:
    """sRGB per vertex: green where the object rests, amber what it keeps clear of, clay elsewhere.

    resting : regions that it rests on.  The more a region counts, the fuller its green.
    """
    colours = np.tile(np.array(BODY), (len(body.mesh.vertices), 1))
    clear = [one for one in body.regions.values() if one.never_closer_mm > 0.0 and one.weight == 0.0]
    for region in clear:
        colours[region.vertex_indices] = KEPT_CLEAR
    for name in resting:
        region = body.regions[name]
        share = (0.35 + 0.65 * min(region.weight, 1.0) * region.emphasis)[:, None]
        colours[region.vertex_indices] = share * RESTED_ON + (1.0 - share) * np.array(BODY)
    return colours


def contact_picture(body: Body, resting: Sequence[str]) -> np.ndarray:
    """The head from the front and from three quarters with its contacts in colour."""
    items = wearer_items(body, contact_colours(body, resting))[:1]
    frame = head_frame(body)
    views = [
        scene_picture(items, VIEWS[name], PORTRAIT, frame_on=frame) for name in ("front", "three_quarter")
    ]
    return labelled(
        contact_sheet(views, columns=2), "green: it rests here      amber: it keeps clear of this"
    )
