"""Mask templates and simple drawings for the tests of placement, inflation and guidance meshes."""

from functools import cache

import cv2
import numpy as np

from fabcraft.body.human import human
from fabcraft.guidance.drawing import Drawing
from fabcraft.template.mask import mask

SIZE = 600


@cache
def template(name="man"):
    """The mask of one of the built-in people; made once for all tests."""
    return mask(human(name))


def ring(x, y, a, b=None, count=240):
    """(count, 2) points of an ellipse, clockwise on the screen."""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.column_stack([x + a * np.cos(angle), y + (b or a) * np.sin(angle)])


def two_eyes(y=260.0, apart=190.0, a=50.0, b=32.0):
    return (ring(300.0 - apart / 2, y, a, b), ring(300.0 + apart / 2, y, a, b))


def drawing(outline=None, eyes=(), regions=(), strokes=()):
    """A `Drawing` of exactly these contours and lines, symmetric about the middle of the page."""
    outline = ring(300.0, 300.0, 240.0, 270.0) if outline is None else outline
    filled = np.zeros((SIZE, SIZE), np.uint8)
    cv2.fillPoly(filled, [np.round((outline - 0.5) * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
    return Drawing(
        width=SIZE,
        height=SIZE,
        silhouette=filled.astype(bool),
        outline=outline,
        eyes=tuple(eyes),
        holes=(),
        regions=tuple(regions),
        strokes=tuple(strokes),
        stroke_width_px=6.0,
        outline_closed=True,
        gap_closed_px=0.0,
        symmetry_axis_px=300.0,
        symmetry_tilt_deg=0.0,
        symmetry_iou=1.0,
    )


def boundary_edges(faces):
    """(N, 2) directed edges that have no other face, and whether no edge has more than two or a twin turned alike."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = {tuple(edge) for edge in directed.tolist()}
    clean = len(forward) == len(directed)
    return np.array([edge for edge in forward if edge[::-1] not in forward]), clean


def boundary_loops(faces):
    """How many closed loops the boundary has; fails where one touches another."""
    edges, clean = boundary_edges(faces)
    assert clean
    follower = dict(edges.tolist())
    assert len(follower) == len(edges)
    count = 0
    while follower:
        start, at = follower.popitem()
        while at != start:
            at = follower.pop(at)
        count += 1
    return count


def assert_clean_sheet(mesh):
    """One piece facing the viewer with two openings, without unused vertices or folds in the front view."""
    assert boundary_loops(mesh.faces) == 3
    used = np.unique(mesh.faces)
    assert len(used) == len(mesh.vertices)
    edges = len(np.unique(np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0))
    assert len(mesh.vertices) - edges + len(mesh.faces) == -1  # a disc with two holes
    assert (mesh.area_vectors[:, 1] < 0).all()
