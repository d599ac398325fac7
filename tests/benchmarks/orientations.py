"""`python tests/benchmarks/orientations.py [OBJECT ...] [--layer MM]`: does turning for the least support save it?

Every plain template for the man lies in eight poses and in the one that `oriented` chooses; PrusaSlicer slices them all
for the MK4 (walls of one line, no infill, a bed that is large enough). Shown: the support that fabcraft estimates and
the slicer extrudes, their rank correlation, and how the chosen pose compares with the best of the eight.
"""

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from scipy.stats import spearmanr

from fabcraft.check.slicer import ask_slicer
from fabcraft.fitting_room import try_on
from fabcraft.geometry.support import support_of
from fabcraft.mesh import Mesh
from fabcraft.profile import load_profile
from fabcraft.solid.orient import oriented
from fabcraft.template.kinds import NAMES
from fabcraft.wearer import find_body

POSES = {
    "as worn": (0.0, 0.0),
    "upside down": (180.0, 0.0),
    "front up": (-90.0, 0.0),
    "front down": (90.0, 0.0),
    "on its left": (0.0, 90.0),
    "on its right": (0.0, -90.0),
    "tilted": (35.0, 20.0),
    "tilted back": (-50.0, 25.0),
}
"""Turns about x, then y, degrees."""
GOOD_CORRELATION, WITHIN, LITTLE_MM3 = 0.95, 1.10, 20.0


def turned(mesh: Mesh, about_x_deg: float, about_y_deg: float) -> Mesh:
    x, y = np.radians([about_x_deg, about_y_deg])
    first = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(x), -np.sin(x)], [0.0, np.sin(x), np.cos(x)]])
    second = np.array([[np.cos(y), 0.0, np.sin(y)], [0.0, 1.0, 0.0], [-np.sin(y), 0.0, np.cos(y)]])
    return mesh.with_vertices(mesh.vertices @ (second @ first).T)


def main(names: list[str], layer_mm: float) -> bool:
    """Prints the tables; whether all aims are met."""
    profile = replace(load_profile("prusa-mk4"), layer_mm=layer_mm, build_mm=(400.0, 400.0, 400.0))
    body = find_body("man")
    own: list[float] = []
    told: list[float] = []
    good = True
    for name in names:
        mesh = try_on(name, body).object
        poses = {word: turned(mesh, *turn) for word, turn in POSES.items()}
        poses["chosen"] = oriented(mesh, profile).mesh
        print(f"\n{name}: {len(mesh.faces)} faces, {mesh.volume_mm3 / 1000.0:.1f} cm³", flush=True)
        rows = []
        for word, pose in poses.items():
            answer = ask_slicer(pose, profile, infill_percent=0, timeout_s=500.0)
            if answer.support_mm3 is None:
                print(f"  {word:14} not sliced: {answer.error}", flush=True)
                good = False
                continue
            rows.append((word, support_of(pose, profile).volume_mm3, answer.support_mm3))
            print(f"  {word:14} estimate {rows[-1][1]:9.0f}   slicer {rows[-1][2]:9.0f} mm³", flush=True)
        given = [row for row in rows if row[0] != "chosen"]
        own += [row[1] for row in given]
        told += [row[2] for row in given]
        best = min(given, key=lambda row: row[2])
        chosen = next((row[2] for row in rows if row[0] == "chosen"), np.inf)
        kept = chosen <= WITHIN * best[2] + LITTLE_MM3
        rank = spearmanr([row[1] for row in given], [row[2] for row in given])[0]
        good &= kept
        print(
            f"  rank correlation {rank:.3f}; chosen {chosen:.0f}, best of the eight {best[2]:.0f} ({best[0]})"
            f"{'' if kept else '  MISSED'}",
            flush=True,
        )
    whole = spearmanr(own, told)[0]
    print(f"\nrank correlation over {len(own)} slices: {whole:.3f} (aim {GOOD_CORRELATION})")
    return bool(good and whole >= GOOD_CORRELATION)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("objects", nargs="*", default=list(NAMES))
    parser.add_argument("--layer", type=float, default=0.2, help="height of a layer, mm")
    given = parser.parse_args()
    sys.exit(0 if main(given.objects, given.layer) else 1)
