"""Clean drawings of known shape for the tests of `fabcraft.guidance`: exact centre lines, inked without
wobble.
"""

import cv2
import numpy as np

SIZE = 900
CENTRE = np.array([450.0, 520.0])
RADIUS = 320.0


def page(lines, size=SIZE, pen=10.0, fills=()):
    """(H, W, 4) uint8: black lines (list of (points, pen or None)) and filled shapes on white, smooth."""
    canvas = np.zeros((4 * size, 4 * size), np.uint8)
    for points in fills:
        cv2.fillPoly(canvas, [np.round(np.asarray(points) * 4 * 16 - 8).astype(np.int32)], 255, cv2.LINE_8, 4)
    for points, width in lines:
        fixed = np.round(np.asarray(points) * 4 * 16 - 8).astype(np.int32)
        thick = round(4 * (width or pen))
        cv2.polylines(canvas, [fixed], False, 255, thick, cv2.LINE_8, 4)
        for x, y in fixed[[0, -1]]:
            cv2.circle(canvas, (int(x), int(y)), thick * 8, 255, -1, cv2.LINE_8, 4)
    ink = cv2.resize(canvas, (size, size), interpolation=cv2.INTER_AREA)
    grey = 255 - ink
    return np.dstack([grey, grey, grey, np.full_like(grey, 255)])


def arc(centre, a, b=None, start=0.0, stop=360.0, n=400):
    """(n, 2) points of an ellipse between two angles in degrees, clockwise on the screen from the right."""
    t = np.radians(np.linspace(start, stop, n))
    return np.asarray(centre) + np.stack([a * np.cos(t), (b or a) * np.sin(t)], 1)


def head(gap_deg=0.0):
    """The round head, open by `gap_deg` below."""
    return (arc(CENTRE, RADIUS, start=90 + gap_deg / 2, stop=450 - gap_deg / 2), None)


def eyes(y=500.0, apart=290.0, a=66.0, b=42.0):
    return [(arc((CENTRE[0] + s * apart / 2, y), a, b), None) for s in (-1, 1)]


def whiskers(inner=170.0, outer=430.0):
    return [
        (CENTRE + np.linspace([s * inner, 60 + k], [s * outer, 50 + 2.2 * k], 50), 6.0)
        for s in (-1, 1)
        for k in (-35, 0, 35)
    ]


def ears():
    """Two triangles on the head; their apex angle is 40 degrees. Tips at `EAR_TIPS`."""
    return [([(450 + s * 100, 216), (450 + s * 250, 60), (450 + s * 268, 346)], None) for s in (-1, 1)]


EAR_TIPS = np.array([[200.0, 60.0], [700.0, 60.0]])


def iou(a, b):
    return float((a & b).sum() / (a | b).sum())
