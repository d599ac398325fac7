"""The frog: stands upright, eyes on top of a wide head, three fingers on each hand."""

from fabcraft.body.characters.model import Arm, Foot, Head, Model, Neck
from fabcraft.body.characters.shapes import (
    Shape,
    ball,
    both_sides,
    carved,
    crease,
    ellipsoid,
    joined,
    limb,
    standing,
)

_FINGERS = (
    ((57.5, -25, 61), (54, -29, 55.5), (50, -33, 50)),
    ((63.5, -27, 59), (64.5, -32, 52), (65, -36.5, 45.5)),
    ((70, -21, 63), (77, -23.5, 58), (84, -26, 52.5)),
)
"""(base, knuckle, tip) of each finger of the left hand."""


def _head() -> Shape:
    head = joined(14, ellipsoid((0, -6, 146), (57, 42, 29)), ellipsoid((0, -14, 133), (55, 40, 21)))
    return joined(8, head, both_sides(ball((31, -8, 173), 20)))


def _body() -> Shape:
    trunk = joined(18, ellipsoid((0, 4, 72), (38, 33, 38)), ellipsoid((0, 0, 104), (26, 24, 24)))
    toes = [limb([(30, -16, 8), (x, y, 8.5)], (7, 8)) for x, y in ((21, -44), (37, -48), (51, -40))]
    shin = limb([(20, 4, 52), (31, 2, 32), (27, 6, 12)], (18, 14, 11.5))
    leg = joined(8, shin, ellipsoid((31, -12, 9), (20, 26, 11), (0, 0, 12)), *toes)
    arm = limb([(22, 0, 110), (46, -4, 94), (60, -14, 76)], (11, 10, 9.5))
    hand = joined(6, arm, ellipsoid((63, -19, 69), (10.5, 9.5, 10)))
    hand = joined(3, hand, *[limb([base, tip], (4.6, 4.9)) for base, _, tip in _FINGERS])
    return joined(8, joined(10, trunk, both_sides(leg)), both_sides(hand))


def _shape() -> Shape:
    plain = joined(14, _body(), _head())
    frog = joined(2, plain, both_sides(ball((34, -21, 177), 10.5)))  # the eyes
    smile = crease(plain, [(0, -54, 139), (24, -49, 137), (44, -37, 141), (55, -20, 150)], 2.5)
    nostril = ellipsoid((7, -50, 154), (3.2, 4, 2.8))
    return standing(carved(4.5, frog, both_sides(smile), both_sides(nostril)), 3)


FROG = Model(
    name="frog",
    title="frog, standing",
    height_mm=180,
    shape=_shape,
    bounds=((-95, -65, 0), (95, 50, 200)),
    cell_mm=2.4,
    head=Head(
        middle=(0, -6, 144),
        eye=(34, -21, 177),
        eye_radius=10.5,
        glabella_z=168,
        sellion_z=162,
        nose_z=154,
        mouth=(0, -54, 138),
        chin=(0, -40, 116),
        breadth_z=150,
        cheek=(52, -24, 146),
        temple=(52, 2, 162),
        ear=None,
        cut=((0, 0, 104), (0, 0, 1)),
    ),
    neck=Neck(
        root=(0, 0, 110),
        notch=(0, -25, 108),
        nape=(0, 24, 108),
        collarbone=(14, -20, 107),
        cut=((0, 0, 74), (0, 0, 1)),
    ),
    arm=Arm(
        elbow=(53, -9, 85),
        wrist=(59, -13, 77),
        tip=(66, -33, 50),
        back=(0.5, -0.7, 0.5),
        girth_mm=13,
        fingers=(_FINGERS[0], _FINGERS[2]),
    ),
    foot=Foot(ankle=(28, 5, 22), reach_mm=62, cut_z=36, behind_mm=20),
    unwearable={
        "glasses": "its eyes stand on top of its head, with no nose between them",
        "helmet": "its eyes stand on the crown, where a helmet would sit",
        "visor": "its eyes stand where the band would run",
    },
)
