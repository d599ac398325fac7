"""Re-makes examples/pictures/ablation.png: what the body's two terms do, each alone and together.

A cat mask made for a woman is the guidance; the object is a man's plain mask as a closed solid, deformed by its per-face
Jacobians towards the guidance's views and surface, without an encoder. Nothing is settled or pushed out afterwards, so
that the pictures show what the loop alone achieves.

Run in the repository's root: python examples/make_ablation.py (about five minutes).
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # before torch is imported

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

import fabcraft
from fabcraft.body.human import human
from fabcraft.fit.body_terms import ContactSet
from fabcraft.fit.deform import ablate
from fabcraft.fit.presets import PRESETS
from fabcraft.fit.topology import Topology
from fabcraft.fit.views import ViewBank
from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.geometry.frame import Frame
from fabcraft.guidance.picture import PictureGuidance, targets_of
from fabcraft.guidance.target_points import TargetPoints
from fabcraft.mesh import Mesh
from fabcraft.solid.thicken import SolidSettings, solidify
from fabcraft.template.mask import mask
from fabcraft.write.camera import VIEWS
from fabcraft.write.maps import penetration_map
from fabcraft.write.picture import png_bytes
from fabcraft.write.sheet import contact_sheet

HERE = Path(__file__).parent
WORDS = {
    "none": "no body loss",
    "contact": "contact only",
    "penetration": "penetration only",
    "both": "both",
}
LIMIT_MM = 4.0
WALL_MM = 4.0
"""A closed solid of two millimetres would need twice as many triangles to bend well."""
GAP_MM = 0.5


def resting_places(body: "fabcraft.body.body.Body", names: tuple[str, ...]) -> ContactSet:
    """The skin where a mask rests, as contacts."""
    chosen = np.concatenate([body.regions[name].vertex_indices for name in names])
    points, normals = body.mesh.vertices[chosen], body.mesh.vertex_normals[chosen]
    return ContactSet(points, normals, np.full(len(chosen), GAP_MM), np.ones(len(chosen)))


def plain_mask(template: "fabcraft.template.template.Template") -> Mesh:
    """The template as a closed solid with coarse, even triangles."""
    settings = SolidSettings(wall_mm=WALL_MM, cell_mm=2.0)
    return solidify(template.mesh, settings).mesh


def main() -> None:
    """Write examples/pictures/ablation.png."""
    woman = fabcraft.make(
        fabcraft.Recipe(
            sketch=str(HERE / "cat-mask.png"),
            body="woman",
            preset="draft",
            wall_mm=WALL_MM,
            strap_slots=False,
        )
    )
    template = mask(human("man"), WALL_MM)
    rest, distance = plain_mask(template), SurfaceDistance(template.body.mesh)
    eyes = [
        np.mean([body.landmarks["eye_left"], body.landmarks["eye_right"]], axis=0)
        for body in (template.body, woman.template.body)
    ]
    goal = woman.object.with_vertices(woman.object.vertices + eyes[0] - eyes[1] + [0.0, 3.0, 0.0])
    settings = replace(PRESETS["draft"], clearance_mm=0.0, steps=200)
    bank, frame = ViewBank.around(rest, settings), Frame.of(rest)
    inside = torch.from_numpy(frame.inside(goal.vertices)).float()
    views = bank.chunks(inside, Topology.of(goal.faces), ("shaded", "mask", "normal"))
    guidance = [PictureGuidance(targets_of(views)), TargetPoints.of(goal, rest, weight=100.0)]
    contacts = resting_places(template.body, template.contacts)
    pictures, labels = [], []
    for name, made in ablate(
        rest, body=distance, contacts=contacts, guidance=guidance, settings=settings
    ).items():
        signed = distance.signed(made.mesh.vertices)
        pictures += [
            penetration_map(made.mesh, signed, VIEWS[view], (420, 440), limit_mm=LIMIT_MM)
            for view in ("three_quarter", "back")
        ]
        numbers = f"{made.pen_max_mm:.2f} mm deep, contacts off by {made.contact_rms_mm:.2f} mm"
        labels += [f"{WORDS[name]}: {numbers}", "inside"]
        print(f"{WORDS[name]}: {numbers}")  # noqa: T201
    (HERE / "pictures" / "ablation.png").write_bytes(png_bytes(contact_sheet(pictures, labels, columns=4)))


if __name__ == "__main__":
    main()
