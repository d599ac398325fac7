"""How often a cluttered guidance mesh comes back: 24 orientations x 3 scales, a fifth of clutter, noise on the vertices.

    python tests/benchmarks/registration.py [mask|helmet|ring|dog ...] [--every N]

Truth: where the target was made (helmet, ring); where the clean upright one goes (mask, head), whose size and place the
program chooses.  Aim: within 2 degrees, 2 % of the scale and 2 % of the size in 95 of 100, in 5 CPU seconds each.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from registered import SCALES, error, given, orientations, shaken

from fabcraft.body.character import character
from fabcraft.body.human import human
from fabcraft.geometry.align import Similarity
from fabcraft.guidance.alignment import aligned
from fabcraft.guidance.clean import cleaned
from fabcraft.guidance.inflate import inflate
from fabcraft.guidance.photograph import read_as
from fabcraft.guidance.placement import place
from fabcraft.guidance.target import target_relief
from fabcraft.read.image_file import read_image
from fabcraft.road.base import as_solid, built
from fabcraft.template.mask import mask, natural_wall_mm

CAT = Path(__file__).parents[2] / "examples" / "cat-mask.png"


def bumped(mesh, direction, height_mm, width_mm):
    """The mesh with a horn where it reaches farthest in a direction."""
    tip = mesh.vertices[np.argmax(mesh.vertices @ np.array(direction))]
    away = np.linalg.norm(mesh.vertices - tip, axis=1) / width_mm
    return mesh.with_vertices(mesh.vertices + mesh.vertex_normals * (height_mm * np.exp(-(away**2)))[:, None])


def target(name):
    """(the target, the template it is for)."""
    if name == "dog":
        body = character("dog")
        template = mask(body, natural_wall_mm(body))
        return template.body.mesh, template
    if name == "mask":
        template = mask(human("man"), 2.4)
        drawing = read_as(read_image(CAT), "")
        return inflate(place(drawing, template), template).mesh(1.5), template
    template = built(name, human("man"), {})
    solid = as_solid(template)
    if name == "ring":
        return bumped(solid, (0.3, 0.2, 0.9), 2.0, 3.0), template
    return bumped(bumped(solid, (-0.7, -0.2, 0.7), 45.0, 14.0), (0.7, -0.2, 0.7), 30.0, 14.0), template


def placed(mesh, template, rest):
    """(the placement that the program finds, its residual)."""
    found = (
        target_relief(mesh, template) if rest is None else aligned(cleaned(mesh, template.pair).mesh, rest)
    )
    return found.placed, found.residual


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", default=["mask", "helmet", "ring", "dog"])
    parser.add_argument("--every", type=int, default=1)
    asked = parser.parse_args()
    for name in asked.targets:
        mesh, template = target(name)
        rest = None if template.kind == "sheet" else as_solid(template)
        truth = placed(mesh, template, rest)[0] if rest is None else Similarity()
        rows, seconds = [], []
        jobs = [(turn, scale) for turn in orientations() for scale in SCALES]
        for index, (turn, scale) in list(enumerate(jobs))[:: asked.every]:
            whole, pose = given(shaken(mesh, index), turn, scale, index)
            start = time.process_time()
            found, _ = placed(whole, template, rest)
            seconds.append(time.process_time() - start)
            rows.append(error(found, pose, truth, mesh))
        errors = np.array(rows)
        back = (errors < [2.0, 0.02, 0.02]).all(1).mean()
        worst = errors.max(0)
        sys.stdout.write(
            f"{name}: {100.0 * back:.0f} % of {len(rows)} came back; worst {worst[0]:.2f} degrees, {100.0 * worst[1]:.2f} % "
            f"of the scale, {100.0 * worst[2]:.2f} % of the size; {np.median(seconds):.1f} CPU s (at most "
            f"{max(seconds):.1f})\n"
        )


if __name__ == "__main__":
    main()
