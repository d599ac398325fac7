"""What helmets, visors and slippers keep besides what every solid template does."""

import numpy as np
from tried import assert_comes_off, assert_seated, assert_walled, built, skin

from fabcraft.geometry.distance import SurfaceDistance
from fabcraft.mesh import Mesh
from fabcraft.template.template import Template


def assert_fits(kind: str, body: str) -> None:
    """Off the skin by what is listed but touching somewhere, a wall as thick as listed, and off without pressing."""
    template = built(kind, body)
    assert_seated(template, skin(kind, body))
    assert skin(kind, body).signed(template.mesh.vertices).min() < template.listed_mm[0] + 0.6
    assert_walled(template)
    assert_comes_off(template)


def assert_mirrored(mesh: Mesh) -> None:
    """Every vertex has its mirror image at -x."""
    places = {tuple(row) for row in np.round(mesh.vertices + 0.0, 6)}
    assert {(0.0 - x, y, z) for x, y, z in places} == places


def assert_motifs_outside(template: Template, *names: str) -> None:
    """Frames of these names, right-handed, on the outer surface, facing away from the body."""
    frames = [frame for frame in template.motifs if frame.reading == "motif"]
    assert tuple(frame.name for frame in frames) == names
    surface = SurfaceDistance(template.mesh)
    for motif in frames:
        axes = np.stack([motif.right, motif.up, motif.outward])
        assert np.abs(axes @ axes.T - np.eye(3)).max() < 1e-6
        assert abs(surface.signed(motif.origin[None])[0]) < 0.15 * template.wall_mm
        before = motif.origin + 2.0 * template.wall_mm * motif.outward
        behind = motif.origin - 0.5 * template.wall_mm * motif.outward
        assert surface.signed(before[None])[0] > 0.0
        assert surface.signed(behind[None])[0] < 0.0
