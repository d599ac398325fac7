"""The dog: on four legs, with hanging ears and its tail up."""

from fabcraft.body.characters.model import Arm, Ear, Foot, Head, Model, Neck
from fabcraft.body.characters.shapes import (
    Number,
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

_EAR = joined(
    4,
    limb([(33, -38, 168), (49, -39, 158), (57, -41, 132)], (9, 10, 13)),
    ellipsoid((57, -42, 121), (8.5, 15, 20)),
)


def _head() -> Shape:
    skull = joined(
        14, ellipsoid((0, -50, 140), (45, 40, 40)), both_sides(ellipsoid((20, -64, 126), (24, 23, 20)))
    )
    jowl = ellipsoid((10, -94, 118), (13, 14, 13))
    muzzle = joined(8, ellipsoid((0, -86, 122), (23, 22, 17)), both_sides(jowl))
    return joined(5, joined(8, skull, muzzle), both_sides(_EAR))


def _paw(x: Number, y: Number) -> Shape:
    """A paw under (x, y): a foot with three toes."""
    toes = [ball((x + dx, y - 11 + dy, 9), 7.5) for dx, dy in ((-9, 0), (0, -4), (9, 0))]
    return joined(3, ellipsoid((x, y, 12), (16, 18, 14)), *toes)


def _body() -> Shape:
    trunk = joined(16, ellipsoid((0, -14, 76), (36, 32, 37)), ellipsoid((0, 38, 74), (34, 42, 33)))
    trunk = joined(12, trunk, limb([(0, -18, 92), (0, -40, 118)], (30, 30)))
    fore = joined(8, limb([(22, -22, 66), (24, -26, 14)], (17, 13.5)), _paw(24, -34))
    hind = joined(
        10,
        ellipsoid((26, 54, 58), (18, 26, 27)),
        limb([(28, 66, 42), (26, 64, 14)], (15, 13.5)),
        _paw(26, 52),
    )
    tail = limb([(0, 72, 88), (0, 92, 106), (0, 100, 130), (0, 92, 150)], (12, 10.5, 9.5, 7))
    return joined(8, joined(11, trunk, both_sides(fore), both_sides(hind)), tail)


def _shape() -> Shape:
    plain = joined(10, _body(), _head())
    dog = joined(2, plain, ellipsoid((0, -107.5, 132), (11.5, 8.5, 8.5)))  # the nose
    dog = joined(1.5, dog, both_sides(ball((19, -82, 150), 7.4)))  # the eyes
    line = crease(plain, [(0, -108, 124), (0, -108, 114)], 2.4)
    smile = crease(plain, [(0, -108, 114), (9, -106, 109), (18, -98, 112)], 2.4)
    return standing(carved(4, dog, joined(1, line, both_sides(smile))), 3)


DOG = Model(
    name="dog",
    title="dog, on four legs",
    height_mm=180,
    shape=_shape,
    bounds=((-80, -125, 0), (80, 120, 185)),
    cell_mm=2.5,
    head=Head(
        middle=(0, -50, 140),
        eye=(19, -82, 150),
        eye_radius=7.4,
        glabella_z=163,
        sellion_z=149,
        nose_z=133,
        mouth=(0, -111, 112),
        chin=(0, -94, 104),
        breadth_z=150,
        cheek=(42, -62, 132),
        temple=(38, -46, 162),
        ear=Ear(shape=_EAR, tip=(36, -38, 178), outermost=(70, -42, 128)),
        cut=((0, -22, 98), (0, -0.66, 0.75)),
    ),
    neck=Neck(
        root=(0, -30, 112),
        notch=(0, -52, 92),
        nape=(0, 2, 112),
        collarbone=(18, -46, 92),
        cut=((0, -2, 60), (0, -0.6, 0.8)),
    ),
    arm=Arm(
        elbow=(23.4, -24.3, 39), wrist=(23.8, -25.6, 30), tip=(24, -44, 8), back=(0, -1, 0.1), girth_mm=19
    ),
    foot=Foot(ankle=(26, 63, 24), reach_mm=42, cut_z=30, behind_mm=24),
    unwearable={
        "helmet": "its ears grow from the crown, where a helmet would sit",
        "visor": "its ears grow where the band would run",
        "glasses": "its ears grow over the place where the side pieces would rest",
        "ring": "its paws have no fingers",
    },
)
