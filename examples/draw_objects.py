"""Draw a star, and an object for every kind of wearable, in the same hand as the masks.

    python examples/draw_objects.py [FOLDER]

A ring is drawn along the finger, a bangle along the arm, a helmet from the wearer's left, slippers from above with the toes
up; the others from the front.  Pixels, y down.
"""

import itertools
import sys
from pathlib import Path

import numpy as np
from draw_examples import Sheet
from PIL import Image


def around(middle, radii, start_deg=-90.0):
    """Points at `radii`, evenly turned about `middle`, clockwise on the page."""
    turn = np.radians(start_deg + np.arange(len(radii)) * 360.0 / len(radii))
    return np.asarray(middle) + np.asarray(radii, float)[:, None] * np.column_stack(
        [np.cos(turn), np.sin(turn)]
    )


def straight(sheet, points, **how):
    """A closed outline of straight strokes."""
    ends = [*points, points[0]]
    for a, b in itertools.pairwise(ends):
        sheet.line([a, b], overshoot=4, **how)


def star():
    """Five points, straight strokes."""
    s = Sheet(1000, 960, seed=3, ink=(70, 62, 40), pen=11, wobble=1.4)
    straight(s, around((500, 510), [430, 190] * 5))
    return s.picture()


def ring():
    """A cat's head with the finger through it: two ears over a round band."""
    s = Sheet(1000, 1000, seed=4, ink=(52, 50, 58), pen=10, wobble=1.4)
    turn = np.radians(np.arange(-28.0, 209.0, 12.0))
    s.line(np.column_stack([500 + 340 * np.cos(turn), 570 + 340 * np.sin(turn)]))
    s.both([(800, 410), (806, 300), (786, 150)], overshoot=2)
    s.both([(784, 150), (700, 210), (640, 262)], overshoot=2)
    s.line([(360, 262), (430, 238), (500, 230), (570, 238), (640, 262)])
    s.line(around((500, 570), [240] * 16), closed=True, overshoot=10)
    return s.picture()


def bangle():
    """A flower of ten petals round the wrist."""
    s = Sheet(1000, 1000, seed=6, ink=(120, 52, 74), pen=10, wobble=1.6)
    s.line(around((500, 500), [450, 412, 362, 412] * 10), closed=True, overshoot=10)
    s.line(around((500, 500), [288] * 20), closed=True, overshoot=10)
    return s.picture()


def necklace():
    """A heart with a smaller one in it."""
    s = Sheet(1000, 960, seed=7, ink=(150, 30, 50), pen=11, wobble=1.8)
    half = [
        (500, 262),
        (560, 176),
        (664, 120),
        (780, 136),
        (866, 232),
        (868, 372),
        (790, 520),
        (650, 690),
        (500, 850),
    ]
    s.both(half)
    inner = 0.55 * (np.array(half, float) - [500, 440]) + [500, 430]
    s.both(inner, width=0.8)
    return s.picture()


def glasses():
    """Hearts round the eyes, a bridge between."""
    s = Sheet(1400, 640, seed=8, ink=(150, 30, 60), pen=9, wobble=1.4)
    lens = [(1000, 196), (1058, 138), (1140, 128), (1204, 180), (1204, 270), (1140, 372), (1010, 500), (880, 372),
            (800, 270), (800, 180), (862, 128), (944, 138)]  # fmt: skip
    s.both(lens, middle=700.0, closed=True, overshoot=8)
    rim = [(762, 300), (834, 420), (922, 512), (1010, 582), (1100, 512), (1200, 410), (1268, 300), (1284, 180),
           (1230, 84), (1140, 52), (1060, 70), (1000, 112), (940, 70), (862, 52), (790, 84), (742, 160)]  # fmt: skip
    s.both(rim, middle=700.0)
    s.line([(660, 160), (700, 146), (740, 160)])
    s.line([(640, 300), (664, 262), (700, 248), (736, 262), (760, 300)])
    return s.picture()


def visor():
    """A crown with three jewels."""
    s = Sheet(1400, 640, seed=9, ink=(110, 84, 20), pen=10, wobble=1.6)
    top = [(90, 560), (60, 190), (330, 330), (480, 110), (610, 310), (700, 70), (790, 310), (920, 110), (1070, 330),
           (1340, 190), (1310, 560)]  # fmt: skip
    for a, b in itertools.pairwise(top):
        s.line([a, b], overshoot=3)
    s.line([(90, 562), (400, 588), (700, 596), (1000, 588), (1310, 562)])
    for middle in ((400, 470), (700, 460), (1000, 470)):
        s.line(around(middle, [52] * 8), closed=True, overshoot=6)
    return s.picture()


def helmet():
    """A dinosaur's back from the left: a smooth dome, and plates over it from brow to nape."""
    s = Sheet(1200, 1000, seed=10, ink=(40, 84, 52), pen=11, wobble=1.8)
    s.line([(150, 820), (152, 700), (190, 560), (226, 486)])
    plates = [(226, 486), (190, 330), (330, 352), (340, 180), (490, 240), (560, 60), (690, 212), (830, 110), (880, 300),
              (1030, 270), (1016, 450), (1130, 500), (1060, 620)]  # fmt: skip
    for a, b in itertools.pairwise(plates):
        s.line([a, b], overshoot=3)
    s.line([(1060, 620), (1074, 720), (1076, 830)])
    s.line([(1076, 830), (800, 850), (480, 850), (150, 820)])
    return s.picture()


def slippers():
    """A bear's paw from above: four toes, a broad foot."""
    s = Sheet(800, 1400, seed=12, ink=(84, 58, 40), pen=11, wobble=1.8)
    side = [(700, 430), (716, 640), (690, 860), (672, 1060), (620, 1240), (510, 1320), (400, 1336)]
    s.both(side, middle=400.0)
    toes = [
        (700, 430),
        (742, 330),
        (706, 222),
        (610, 196),
        (580, 212),
        (572, 120),
        (490, 66),
        (420, 92),
        (400, 130),
    ]
    s.both(toes, middle=400.0)
    for x in (300, 500):
        s.line([(x - 60, 300), (x, 270), (x + 60, 300)], width=0.8)
    return s.picture()


DRAWINGS = {one.__name__: one for one in (star, ring, bangle, necklace, glasses, visor, helmet, slippers)}


def main(folder: Path) -> None:
    """Write all of them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in DRAWINGS.items():
        Image.fromarray(draw()).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "objects")
