"""Ink becomes centre lines: skeleton, its graph, spurs pruned, straightest lines joined through junctions,
smoothed.

Skeleton by Zhang and Suen (1984). A graph here is a list of `Branch`es; an end without a node is free. Points
are (column, row) at pixel centres (+0.5).
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy import ndimage

from fabcraft.errors import InputError
from fabcraft.geometry.contour import resample, resample_open
from fabcraft.guidance.curves import length_of, smooth_closed, smooth_open

MOST_BRANCHES = 3000
"""More is noise, a photograph or a screen print; what follows would take minutes and understand nothing."""

Mask = Bool[np.ndarray, "H W"]
Points = Float64[np.ndarray, "_ 2"]


@dataclass(frozen=True, eq=False)
class Branch:
    """A piece of skeleton between two nodes; -1 is a free end, and a ring has both ends -1 and `ring` set."""

    points: Points
    start: int
    end: int
    ring: bool = False

    def turned(self) -> "Branch":
        return replace(self, points=self.points[::-1], start=self.end, end=self.start)

    def length(self) -> float:
        return length_of(self.points)


def trace_strokes(mask: Mask, width: float) -> list[Points]:
    """Smooth open centre lines of the ink in `mask`, longest first; none shorter than two line widths."""
    lines = _joined(skeleton_graph(mask, width), width)
    drawn = []
    for line in lines:
        if line.length() < 2 * width:
            continue
        step = max(1.0, width / 4)
        if line.ring:
            ring = smooth_closed(resample(line.points, step), 6 * width / step)
            drawn.append(np.vstack([ring, ring[:1]]))
        else:
            drawn.append(smooth_open(resample_open(line.points, step), 6 * width / step))
    return sorted(drawn, key=lambda p: -length_of(p))


def skeleton_graph(mask: Mask, width: float) -> list[Branch]:
    """Branches of the skeleton of `mask`; spurs that are no longer than the ink is thick are gone."""
    from skimage.morphology import skeletonize

    padded = np.pad(mask, 2)
    smooth = cv2.GaussianBlur(padded.astype(np.float32), (0, 0), max(0.6, width / 8)) > 0.5
    skeleton = skeletonize(smooth | (padded & ~ndimage.binary_dilation(smooth, iterations=2)))
    deep = cv2.distanceTransform(padded.astype(np.uint8), cv2.DIST_L2, 5)
    branches = _branches(skeleton)
    if len(branches) > MOST_BRANCHES:
        raise InputError(
            f"the picture falls apart into {len(branches):,} short lines; a line drawing has some hundred",
            "Draw it with clear lines on plain paper, or clean the scan first.",
        )
    for _ in range(3):
        kept = [b for b in branches if not _is_spur(b, deep, width)]
        kept = _without_joints(_contracted(kept, 2.0 * width))
        if len(kept) == len(branches):
            break
        branches = kept
    return [replace(b, points=b.points - 2.0) for b in branches]


def end_direction(points: Points, reach: float) -> Float64[np.ndarray, "2"]:
    """Unit vector in which the polyline runs out at its last point, seen over `reach`."""
    back = points[np.linalg.norm(points - points[-1], axis=1) <= reach]
    d = points[-1] - (back if len(back) > 1 else points[-2:]).mean(0)
    return d / (np.linalg.norm(d) + 1e-12)


def _branches(skeleton: Mask) -> list[Branch]:
    """The skeleton's pixels walked from junction to junction."""
    around = cv2.filter2D(skeleton.astype(np.uint8), -1, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT) - 1
    joint = skeleton & (around >= 3)
    nodes, count = ndimage.label(joint, np.ones((3, 3)))
    at, owner = np.argwhere(joint)[:, ::-1] + 0.5, nodes[joint] - 1
    members = np.bincount(owner, minlength=count)
    centres = np.stack([np.bincount(owner, at[:, k], count) / members for k in (0, 1)], 1)
    paths, n = ndimage.label(skeleton & ~joint, np.ones((3, 3)))
    found = []
    for label, box in enumerate(ndimage.find_objects(paths, n), start=1):
        corner = np.array([box[0].start, box[1].start])
        pixels, ring = _walk({(r, c) for r, c in np.argwhere(paths[box] == label).tolist()})
        at = np.array(pixels) + corner
        ends = [_node_at(nodes, at[0], set()), -1]
        ends[1] = _node_at(nodes, at[-1], {ends[0]} if len(at) < 3 else set())
        line = at[:, ::-1] + 0.5
        if ends[0] >= 0:
            line = np.vstack([centres[ends[0]], line])
        if ends[1] >= 0:
            line = np.vstack([line, centres[ends[1]]])
        if len(line) > 1:
            found.append(Branch(line.astype(np.float64), ends[0], ends[1], ring and ends == [-1, -1]))
    return found


def _walk(pixels: set[tuple[int, int]]) -> tuple[list[tuple[int, int]], bool]:
    """The pixels of one path in order, and whether it closes on itself."""
    steps = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)]  # straight before diagonal
    beside = {(r, c): [(r + i, c + j) for i, j in steps if (r + i, c + j) in pixels] for r, c in pixels}
    ends = [pixel for pixel, others in beside.items() if len(others) <= 1]
    here = min(ends) if ends else min(pixels)
    order, left = [here], pixels - {here}
    while True:
        ahead = next((pixel for pixel in beside[here] if pixel in left), None)
        if ahead is None:
            return order, not ends and len(order) > 7
        here = ahead
        order.append(here)
        left.discard(here)


def _node_at(nodes: np.ndarray, pixel: np.ndarray, not_these: set[int]) -> int:
    """Number of the junction that touches `pixel`, or -1."""
    r, c = pixel
    near = nodes[r - 1 : r + 2, c - 1 : c + 2]
    touching = [int(k) - 1 for k in np.unique(near[near > 0]) if int(k) - 1 not in not_these]
    return touching[0] if touching else -1


def _is_spur(branch: Branch, deep: Float32[np.ndarray, "H W"], width: float) -> bool:
    """A dead end hardly longer than the ink at its root is thick: a bump of the edge, no stroke."""
    if (branch.start < 0) == (branch.end < 0):
        return False
    root = branch.points[-1] if branch.start < 0 else branch.points[0]
    thick = float(deep[int(root[1]), int(root[0])])
    return branch.length() < max(0.8 * width, 1.6 * thick)


def _contracted(branches: list[Branch], shortest: float) -> list[Branch]:
    """Two junctions a line's width or two apart are one crossing: the branch between is taken out."""
    while True:
        short = [
            b for b in branches if b.start >= 0 and b.end >= 0 and b.start != b.end and b.length() < shortest
        ]
        if not short:
            return [b for b in branches if not (b.start == b.end >= 0 and b.length() < shortest)]
        gone = short[0]
        middle = 0.5 * (gone.points[:1] + gone.points[-1:])
        moved = []
        for b in branches:
            if b is gone:
                continue
            p = b.points
            if b.start in (gone.start, gone.end) and b.start >= 0:
                p = np.vstack([middle, p[1:]])
            if b.end in (gone.start, gone.end) and b.end >= 0:
                p = np.vstack([p[:-1], middle])
            start, end = (gone.start if k == gone.end else k for k in (b.start, b.end))
            moved.append(replace(b, points=p, start=start, end=end))
        branches = moved


def _without_joints(branches: list[Branch]) -> list[Branch]:
    """Branches that meet two at a node become one; a node that only one reaches is a free end."""
    while True:
        at: dict[int, list[int]] = {}
        for i, b in enumerate(branches):
            for node in (b.start, b.end):
                if node >= 0:
                    at.setdefault(node, []).append(i)
        lone = {node for node, who in at.items() if len(who) == 1}
        if lone:
            branches = [
                replace(b, start=-1 if b.start in lone else b.start, end=-1 if b.end in lone else b.end)
                for b in branches
            ]
        pair = next(((node, who) for node, who in at.items() if len(who) == 2), None)
        if pair is None:
            return branches
        node, (i, j) = pair
        if i == j:  # one branch that comes back to its own start
            joined = replace(branches[i], points=branches[i].points[:-1], start=-1, end=-1, ring=True)
        else:
            joined = _spliced(branches[i], branches[j], node)
        branches = [b for k, b in enumerate(branches) if k not in (i, j)] + [joined]


def _spliced(a: Branch, b: Branch, node: int) -> Branch:
    a = a if a.end == node else a.turned()
    b = b if b.start == node else b.turned()
    return Branch(np.vstack([a.points, b.points[1:]]), a.start, b.end)


def _joined(branches: list[Branch], width: float) -> list[Branch]:
    """At every node the two branches that run straightest into each other become one line, over and over."""
    while True:
        best, straightest = None, np.cos(np.radians(50.0))
        ends: dict[int, list[tuple[int, np.ndarray]]] = {}
        for i, b in enumerate(branches):
            if b.end >= 0:
                ends.setdefault(b.end, []).append((i, end_direction(b.points, 3 * width)))
            if b.start >= 0:
                ends.setdefault(b.start, []).append((i, end_direction(b.points[::-1], 3 * width)))
        for node, who in ends.items():
            for k, (i, u) in enumerate(who):
                for j, v in who[k + 1 :]:
                    if i != j and -float(u @ v) > straightest:
                        best, straightest = (node, i, j), -float(u @ v)
        if best is None:
            return branches
        node, i, j = best
        a = branches[i] if branches[i].end == node else branches[i].turned()
        b = branches[j] if branches[j].start == node else branches[j].turned()
        line = Branch(np.vstack([a.points[:-1], b.points[1:]]), a.start, b.end)
        branches = [c for k, c in enumerate(branches) if k not in (i, j)] + [line]
