"""Draw the example sketches as a hand would: uneven wobbling lines, gaps, overshoots, pencil grain, tinted
paper.

    python examples/draw_examples.py [FOLDER]

Seeded, so the same pictures come out every time. Each mask covers a face: as wide as it is high (ears extra),
eyes half way down, their centres 0.42-0.48 of the width apart, each about a fifth of the width. Pixels, y
down.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

SCALE = 2  # drawn twice as large, then averaged down


def curve(points, closed=False, step=2.0):
    """(N, 2) evenly spaced points of the centripetal Catmull-Rom curve through `points`."""
    p = np.asarray(points, float)
    if len(p) == 2 and not closed:
        p = np.linspace(p[0], p[1], 4)
    q = np.vstack([p[-1], p, p[0], p[1]]) if closed else np.vstack([2 * p[0] - p[1], p, 2 * p[-1] - p[-2]])
    pieces = []
    for a, b, c, d in zip(q, q[1:], q[2:], q[3:], strict=False):
        t0, t1 = 0.0, np.linalg.norm(b - a) ** 0.5 + 1e-9
        t2 = t1 + np.linalg.norm(c - b) ** 0.5 + 1e-9
        t3 = t2 + np.linalg.norm(d - c) ** 0.5 + 1e-9
        t = np.linspace(t1, t2, 60, endpoint=False)[:, None]
        a1, a2 = (
            (t1 - t) / (t1 - t0) * a + (t - t0) / (t1 - t0) * b,
            (t2 - t) / (t2 - t1) * b + (t - t1) / (t2 - t1) * c,
        )
        a3 = (t3 - t) / (t3 - t2) * c + (t - t2) / (t3 - t2) * d
        b1, b2 = (
            (t2 - t) / (t2 - t0) * a1 + (t - t0) / (t2 - t0) * a2,
            (t3 - t) / (t3 - t1) * a2 + (t - t1) / (t3 - t1) * a3,
        )
        pieces.append((t2 - t) / (t2 - t1) * b1 + (t - t1) / (t2 - t1) * b2)
    pieces.append(q[-2:-1])
    line = np.vstack(pieces)
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    even = np.linspace(0, along[-1], max(4, int(along[-1] / step)))
    return np.stack([np.interp(even, along, line[:, k]) for k in (0, 1)], 1)


class Sheet:
    """A sheet of paper and the hand over it."""

    def __init__(self, width, height, seed, ink, paper=(253, 250, 243), pen=10.0, wobble=2.2):
        self.rng = np.random.default_rng(seed)
        self.size = (height * SCALE, width * SCALE)
        self.left = np.ones(self.size, np.float32)  # share of the paper's light that is left
        self.ink, self.paper, self.pen, self.wobble = (
            np.array(ink, float),
            np.array(paper, float),
            pen,
            wobble,
        )
        tooth = cv2.GaussianBlur(self.rng.normal(size=self.size).astype(np.float32), (0, 0), 1.6)
        self.tooth = tooth / tooth.std()  # the paper's tooth: where the pencil catches

    def noise(self, n, every):
        """(n,) smooth random numbers of unit spread, one bump every `every` samples."""
        knots = self.rng.normal(size=max(3, int(n / every) + 3))
        at = np.linspace(0, len(knots) - 1, n)
        smooth = 0.5 - 0.5 * np.cos(np.pi * (at % 1))
        low = np.minimum(at.astype(int), len(knots) - 2)
        return knots[low] * (1 - smooth) + knots[low + 1] * smooth

    def line(self, points, width=1.0, dark=0.86, closed=False, overshoot=0.0, skip=0.0, taper=0.25):
        """One stroke.  `overshoot`: pixels past its end; `skip`: pixels left out at its end; `taper`: lift
        of the pen.
        """
        p = curve(points, closed)
        if closed:  # a hand never meets its start exactly
            p = np.vstack([p, p[1 : 1 + max(1, int(overshoot / 2))]])
        elif overshoot:
            ahead = p[-1] - p[-4]
            p = np.vstack(
                [p, p[-1] + np.linspace(0.1, 1, 8)[:, None] * ahead / np.linalg.norm(ahead) * overshoot]
            )
        if skip:
            p = p[: -max(1, int(skip / 2))]
        n = len(p)
        tangent = np.gradient(p, axis=0)
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1) / np.linalg.norm(tangent, axis=1, keepdims=True)
        p = p + normal * (self.wobble * self.noise(n, 55) + 0.35 * self.noise(n, 9))[:, None]
        ends = np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) / 14.0, 0, 1)
        radius = self.pen / 2 * width * (1 + 0.13 * self.noise(n, 30)) * (1 - taper * (1 - ends))
        depth = np.clip(dark * (1 + 0.08 * self.noise(n, 40)) * (1 - 0.25 * (1 - ends)), 0, 1)
        layer = np.zeros(self.size, np.float32)
        for (x, y), r, d in zip(p, radius, depth, strict=True):
            cv2.circle(
                layer,
                (round(x * SCALE * 16), round(y * SCALE * 16)),
                round(r * SCALE * 16),
                float(d),
                -1,
                cv2.LINE_AA,
                4,
            )
        self.press(layer)

    def press(self, layer):
        """Lay graphite on the paper's tooth: the lighter the stroke, the more grain shows."""
        soft = cv2.GaussianBlur(layer, (0, 0), 1.2)
        caught = np.clip(soft * (1.02 + 0.16 * self.tooth * (1.25 - soft)), 0, 1)
        self.left *= 1 - caught

    def both(self, points, middle=500.0, **how):
        """The stroke and its mirror image about the column `middle`, each with its own wobble."""
        self.line(points, **how)
        self.line(mirrored(points, middle), **how)

    def hatch(self, points, dark=0.8, gap=6.0, angle=-50.0):
        """Fill the closed curve with close pencil strokes."""
        p = curve(points, True)
        inside = np.zeros(self.size, np.uint8)
        cv2.fillPoly(inside, [np.round(p * SCALE).astype(np.int32)], 1)
        layer = np.zeros(self.size, np.float32)
        c, r = p.mean(0), np.linalg.norm(p - p.mean(0), axis=1).max() + 5
        d = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        for s in np.arange(-r, r, gap):
            a = c + s * np.array([-d[1], d[0]]) + self.rng.normal(size=2)
            ends = [tuple(np.round((a + t * d) * SCALE).astype(int).tolist()) for t in (-r, r)]
            cv2.line(
                layer,
                *ends,
                float(dark * (1 + 0.08 * self.rng.normal())),
                round(gap * 1.25 * SCALE),
                cv2.LINE_AA,
            )
        self.press(layer * cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 2.0))

    def picture(self):
        """(H, W, 3) uint8, tinted paper with the ink on it."""
        left = cv2.resize(
            self.left, (self.size[1] // SCALE, self.size[0] // SCALE), interpolation=cv2.INTER_AREA
        )
        left = np.where(left > 0.985, 1.0, left)[..., None]
        return np.clip(self.ink + (self.paper - self.ink) * left, 0, 255).round().astype(np.uint8)


def cat():
    """Ears, almond eyes, nose, mouth, six whiskers that cross the rim, tabby marks; gaps under the chin and
    at an ear.
    """
    s = Sheet(1000, 1000, seed=11, ink=(52, 50, 58), pen=11)
    cheek = [(864, 404), (893, 520), (898, 630), (868, 745), (790, 842), (660, 900), (508, 916)]
    s.line(cheek)
    s.line(mirrored(cheek), skip=34)
    s.line([(866, 425), (872, 330), (866, 225), (846, 112)], overshoot=8)
    s.line([(848, 108), (772, 160), (702, 222), (642, 284)], overshoot=6)
    s.line([(136, 428), (126, 330), (132, 222), (156, 106)], overshoot=4)
    s.line([(150, 110), (226, 158), (300, 224), (360, 286)], skip=14)
    s.line([(362, 290), (428, 260), (500, 250), (574, 258), (650, 286)])
    s.both([(822, 360), (826, 280), (816, 196)], width=0.8, overshoot=3)
    s.both([(818, 196), (762, 240), (722, 288)], width=0.8)
    s.both([(722, 288), (776, 312), (824, 362)], width=0.8)
    s.both([(594, 618), (632, 562), (686, 536), (736, 544), (770, 568)], overshoot=3)
    s.both([(770, 566), (748, 616), (700, 644), (644, 642), (592, 618)], overshoot=3)
    for pupil in pair([(688, 556), (702, 590), (688, 624), (674, 590)]):
        s.hatch(pupil)
    nose = [(452, 690), (500, 682), (548, 690), (532, 722), (500, 744), (468, 722)]
    s.line(nose, closed=True, overshoot=10)
    s.hatch(nose, dark=0.75)
    s.line([(500, 744), (501, 786)], width=0.9)
    s.both([(501, 782), (530, 812), (566, 812), (592, 784)], width=0.9)
    for whisker in (
        [(640, 716), (790, 690), (962, 672)],
        [(646, 746), (800, 742), (975, 752)],
        [(636, 776), (780, 794), (948, 836)],
    ):
        s.both(whisker, width=0.62, dark=0.75, taper=0.6)
    s.line([(500, 318), (501, 352), (500, 398)], width=0.95)
    s.both([(556, 322), (552, 354), (544, 386)], width=0.95)
    s.both([(610, 338), (602, 362), (588, 386)], width=0.9)
    return s.picture()


def bunny():
    """Long ears with inner ears, round eyes, nose, two teeth, freckled cheeks; blue crayon."""
    s = Sheet(1000, 1240, seed=5, ink=(58, 84, 140), paper=(252, 250, 246), pen=12)
    cheek = [(752, 560), (826, 650), (866, 770), (862, 900), (800, 1030), (676, 1120), (498, 1150)]
    s.line(cheek, overshoot=8)
    s.line(mirrored(cheek), skip=20)
    ear = [
        (760, 572),
        (812, 440),
        (832, 300),
        (812, 170),
        (758, 96),
        (690, 96),
        (630, 180),
        (592, 310),
        (572, 470),
        (568, 506),
    ]
    s.both(ear, overshoot=4)
    s.line([(432, 502), (466, 492), (500, 489), (540, 492), (574, 502)])
    inner = [
        (706, 470),
        (760, 380),
        (778, 280),
        (762, 196),
        (724, 168),
        (684, 214),
        (652, 310),
        (640, 400),
        (652, 450),
    ]
    s.both(inner, closed=True, width=0.75, overshoot=8)
    s.both(
        [(588, 802), (608, 750), (656, 726), (708, 736), (738, 780), (728, 834), (676, 860), (620, 848)],
        closed=True,
        overshoot=10,
    )
    bunny_face(s)
    return s.picture()


def bunny_face(s):
    """Pupils, nose, smile, two teeth, freckles and brows."""
    for pupil in pair([(662, 764), (690, 786), (680, 822), (646, 824), (634, 788)]):
        s.hatch(pupil)
    nose = [(450, 908), (500, 896), (550, 908), (532, 940), (500, 956), (468, 940)]
    s.line(nose, closed=True, overshoot=8)
    s.hatch(nose, dark=0.7)
    s.line([(500, 956), (500, 994)], width=0.85)
    s.both([(500, 992), (534, 1014), (576, 1010), (604, 982)], width=0.9)
    s.line([(458, 1008), (458, 1050), (464, 1064), (492, 1066), (499, 1058), (500, 998)], width=0.75)
    s.line([(500, 1058), (508, 1066), (536, 1064), (542, 1050), (541, 1012)], width=0.75)
    for x, y in ((690, 930), (728, 952), (694, 976)):
        s.both([(x - 4, y), (x + 6, y + 4), (x + 2, y + 8)], width=1.15)
    s.both([(600, 676), (650, 652), (706, 664)], width=0.8)


def crown():
    """A half mask without eyes: a crown with five points above a jewelled band that dips to the brow;
    golden brown.
    """
    s = Sheet(1000, 860, seed=8, ink=(136, 84, 28), paper=(254, 251, 244), pen=12)
    s.both([(104, 640), (84, 500), (68, 330), (62, 196)], overshoot=2)
    s.both([(62, 200), (138, 300), (214, 404)], overshoot=4)
    s.both([(210, 402), (242, 280), (276, 128)], overshoot=3)
    s.both([(276, 132), (334, 240), (388, 346)], overshoot=5)
    s.line([(386, 346), (436, 220), (498, 60)], overshoot=4)
    s.line([(500, 64), (560, 214), (613, 348)], skip=8)
    s.both([(102, 636), (116, 690), (150, 740)])
    s.both([(148, 738), (240, 768), (340, 752), (430, 716), (502, 772)], overshoot=3)
    s.both([(92, 524), (220, 566), (360, 584), (502, 588)], width=0.85)
    for jewel in ([(500, 618), (536, 654), (500, 694), (464, 654)],):
        s.line([*jewel, jewel[0]][:2]), s.line(jewel[1:3]), s.line(jewel[2:4]), s.line([jewel[3], jewel[0]])
    for x, y in ((348, 664), (206, 656)):
        s.both([(x - 34, y), (x, y - 27), (x + 34, y), (x, y + 28)], closed=True, overshoot=8)
    drop = [(500, 300), (528, 366), (532, 420), (500, 452), (468, 420), (472, 366)]
    s.line(drop, closed=True, overshoot=6)
    s.both([(276, 306), (296, 360), (292, 396), (270, 410), (250, 392), (252, 354)], closed=True, overshoot=6)
    for x, y in ((110, 400), (150, 440)):
        s.both([(x - 7, y), (x + 2, y - 8), (x + 8, y + 1), (x, y + 8)], closed=True, width=1.1)
    for x, y in ((404, 530), (318, 516)):
        for pearl in pair(ring((x, y), 13, 13)):
            s.line(pearl, closed=True, width=0.8, overshoot=4)
    return s.picture()


def butterfly():
    """Two pairs of wings with eye holes and pattern loops, a body, feelers that stick out; violet felt."""
    s = Sheet(1000, 900, seed=21, ink=(104, 48, 132), paper=(253, 251, 249), pen=12)
    upper = [
        (508, 236),
        (580, 152),
        (700, 90),
        (840, 70),
        (940, 118),
        (962, 226),
        (934, 352),
        (872, 448),
        (800, 500),
    ]
    s.both(upper, overshoot=4)
    lower = [(804, 496), (868, 560), (890, 664), (846, 768), (748, 818), (638, 786), (560, 700), (502, 640)]
    s.line(lower)
    s.line(mirrored(lower), skip=14)
    s.both([(504, 238), (530, 300), (536, 420), (526, 540), (502, 644)], width=0.9)
    s.both([(512, 232), (540, 160), (588, 84), (640, 40), (668, 52)], width=0.7, taper=0.4)
    s.both([(624, 432), (660, 378), (716, 358), (770, 372), (806, 408)], overshoot=3)
    s.both([(806, 406), (780, 456), (724, 480), (668, 470), (622, 432)], overshoot=3)
    butterfly_pattern(s)
    return s.picture()


def butterfly_pattern(s):
    """Loops on the wings and marks on the body."""
    s.both(
        [(700, 190), (762, 148), (836, 146), (862, 196), (820, 254), (744, 270), (700, 240)],
        closed=True,
        width=0.85,
        overshoot=8,
    )
    s.both(
        [(588, 250), (622, 220), (650, 246), (644, 292), (606, 308), (584, 284)],
        closed=True,
        width=0.85,
        overshoot=6,
    )
    s.both([(884, 262), (910, 290), (900, 336), (872, 346), (858, 308)], closed=True, width=0.85, overshoot=6)
    s.both(
        [(700, 590), (764, 576), (806, 624), (796, 702), (740, 736), (684, 690), (674, 630)],
        closed=True,
        width=0.85,
        overshoot=8,
    )
    for spot in pair([(734, 630), (758, 650), (746, 680), (722, 672), (716, 646)]):
        s.hatch(spot)
    s.both([(610, 560), (640, 590), (630, 640), (600, 640), (588, 596)], closed=True, width=0.8, overshoot=5)
    for y in (330, 400, 470):
        s.line([(478, y), (500, y + 10), (522, y)], width=0.7)


def owl():
    """Ear tufts, big round eyes inside a heart of feathers, a beak, feather marks; brown pencil."""
    s = Sheet(1000, 1060, seed=3, ink=(92, 60, 40), paper=(252, 248, 240), pen=12)
    side = [(838, 262), (880, 400), (892, 560), (864, 730), (784, 880), (656, 976), (502, 1006)]
    s.line(side, overshoot=6)
    s.line(mirrored(side), skip=24)
    s.both([(836, 266), (868, 170), (884, 62)], overshoot=4)
    s.both([(886, 64), (786, 118), (676, 182)], overshoot=3)
    s.line([(320, 186), (410, 214), (500, 222), (592, 212), (682, 180)])
    s.both(ring((684, 592), 90, 88), closed=True, overshoot=14)
    for pupil in pair(ring((676, 598), 36, 36)):
        s.hatch(pupil)
    s.both(
        [
            (502, 462),
            (560, 418),
            (650, 404),
            (746, 430),
            (812, 504),
            (826, 604),
            (788, 704),
            (706, 764),
            (606, 778),
        ],
        width=0.75,
    )
    s.both([(500, 640), (536, 682), (540, 720), (500, 788)])
    s.line([(470, 690), (500, 702), (532, 690)], width=0.7)
    for x, y in ((450, 836), (550, 836), (352, 836), (648, 836), (500, 906), (404, 906), (596, 906)):
        s.line([(x - 32, y), (x - 20, y + 28), (x, y + 38), (x + 20, y + 28), (x + 32, y)], width=0.72)
    for x, y in ((400, 320), (600, 320), (350, 366), (650, 366)):
        s.line([(x - 20, y), (x - 12, y + 18), (x, y + 24), (x + 12, y + 18), (x + 20, y)], width=0.66)
    s.line([(500, 284), (500, 372)], width=0.8)
    s.both([(548, 282), (546, 320), (534, 354)], width=0.8)
    s.both([(852, 130), (834, 186), (806, 222)], width=0.75)
    return s.picture()


def fox():
    """Pointed ears and chin, zigzag fur on the cheeks, slanting almond eyes, a black nose; rust pencil."""
    s = Sheet(1000, 1020, seed=16, ink=(168, 72, 24), paper=(254, 250, 243), pen=12)
    s.both([(828, 428), (846, 300), (842, 180), (820, 54)], overshoot=3)
    s.both([(822, 56), (740, 118), (670, 188), (618, 258)], overshoot=4)
    s.line([(386, 260), (440, 238), (500, 230), (560, 236), (612, 252)])
    s.both([(826, 424), (862, 500), (916, 578)], overshoot=3)
    s.both([(918, 578), (884, 590), (852, 594)], overshoot=2)
    s.both([(852, 592), (872, 640), (888, 690)], overshoot=2)
    s.both([(888, 690), (844, 694), (800, 690)], overshoot=2)
    s.both([(800, 690), (806, 732), (808, 774)], overshoot=2)
    s.line([(806, 774), (740, 800), (660, 862), (576, 930), (500, 962)])
    s.line([(194, 774), (260, 800), (340, 862), (424, 930), (500, 962)], skip=20)
    s.both([(796, 358), (806, 262), (794, 150)], width=0.8, overshoot=3)
    s.both([(794, 152), (742, 214), (706, 282)], width=0.8)
    s.both([(706, 282), (752, 314), (798, 360)], width=0.8)
    s.both([(592, 612), (626, 554), (688, 522), (782, 512)], overshoot=3)
    s.both([(782, 512), (762, 572), (700, 616), (590, 610)], overshoot=3)
    for pupil in pair([(690, 536), (712, 566), (690, 602), (668, 570)]):
        s.hatch(pupil)
    s.both([(792, 672), (704, 700), (616, 700), (560, 738), (538, 806)], width=0.8)
    nose = [(442, 836), (500, 820), (558, 836), (540, 876), (500, 900), (460, 876)]
    s.line(nose, closed=True, overshoot=8)
    s.hatch(nose, dark=0.85)
    s.line([(500, 300), (500, 372)], width=0.85)
    s.both([(546, 302), (540, 340), (528, 368)], width=0.85)
    for x, y in ((640, 756), (676, 742), (648, 790)):
        s.both([(x - 3, y), (x + 5, y + 4), (x, y + 7)], width=1.1)
    return s.picture()


def photo(picture, seed=2):
    """The drawing photographed by hand: turned a little, lit from one side, a soft shadow, blur, the
    sensor's noise.
    """
    rng = np.random.default_rng(seed)
    rows, cols = picture.shape[:2]
    turn = cv2.getRotationMatrix2D((cols / 2, rows / 2), 2.5, 1.02)
    flat = cv2.warpAffine(picture, turn, (cols, rows), borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    y, x = np.mgrid[0:rows, 0:cols] / max(rows, cols)
    light = 0.92 - 0.38 * x - 0.16 * y + 0.10 * np.exp(-((x - 0.25) ** 2 + (y - 0.3) ** 2) / 0.08)
    shadow = 1 / (1 + np.exp(-(x + 0.55 * y - 1.22) / 0.035))  # the hand that holds the telephone
    seen = flat * (light * (1 - 0.34 * shadow))[..., None] * np.array([1.0, 0.965, 0.90])
    seen = (
        cv2.GaussianBlur(seen, (0, 0), 0.9)
        + rng.normal(size=(rows, cols, 1)) * 2.4
        + rng.normal(size=(rows, cols, 3)) * 1.2
    )
    return np.clip(seen, 0, 255).astype(np.uint8)


def ring(centre, a, b):
    """Eight points of an ellipse with half axes `a` and `b`."""
    t = np.arange(8) * np.pi / 4 + 0.3
    return np.array(centre) + np.stack([a * np.cos(t), b * np.sin(t)], 1)


def mirrored(points, middle=500.0):
    p = np.asarray(points, float)
    return np.stack([2 * middle - p[:, 0], p[:, 1]], 1)


def pair(points):
    return [np.asarray(points, float), mirrored(points)]


PICTURES = {"cat-mask": cat, "bunny": bunny, "crown": crown, "butterfly": butterfly, "owl": owl, "fox": fox}


def save_png(picture, path):
    """A palette of 32 tints keeps the file small without touching the look."""
    Image.fromarray(picture).quantize(32, dither=Image.Dither.NONE).save(path, optimize=True)


def save_photo(picture, path):
    """A JPEG as a telephone writes it: the sensor's rows run sideways, the EXIF tag says how to hold it."""
    sideways = Image.fromarray(np.ascontiguousarray(np.rot90(picture)))
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90 degrees clockwise to see it upright
    sideways.save(path, quality=82, exif=exif)


def main(folder):
    for name, draw in PICTURES.items():
        save_png(draw(), folder / f"{name}.png")
    save_photo(photo(cat()), folder / "cat-photo.jpg")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
