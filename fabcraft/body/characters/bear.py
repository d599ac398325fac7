"""The bear: stands upright, arms a little away from a round belly."""

from fabcraft.body.characters.model import Arm, Ear, Foot, Head, Model, Neck
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

_EAR = ellipsoid((38, 0, 184), (19, 10.5, 18), (0, 0, -14))


def _head() -> Shape:
    skull = joined(
        14, ellipsoid((0, -6, 152), (50, 43, 41)), both_sides(ellipsoid((25, -18, 140), (24, 23, 20)))
    )
    head = joined(7, skull, ellipsoid((0, -42, 138), (23, 18, 17)))  # the muzzle
    head = joined(6, head, both_sides(_EAR))
    return carved(5, head, both_sides(ellipsoid((39, -12, 185), (11.5, 8, 10.5))))


def _body() -> Shape:
    trunk = joined(20, ellipsoid((0, 0, 64), (43, 38, 44)), ellipsoid((0, 0, 92), (33, 29, 26)))
    foot = ellipsoid((29, -14, 14), (19, 28, 17), (0, 0, 12))
    leg = joined(10, limb([(24, 2, 40), (28, -2, 16)], (21, 18)), foot)
    arm = limb([(34, -2, 99), (55, -7, 83), (66, -15, 67), (72, -22, 57)], (14, 13.5, 13, 15.5))
    body = joined(10, joined(12, trunk, both_sides(leg)), both_sides(arm))
    return joined(8, body, ball((0, 42, 46), 13))  # the tail


def _shape() -> Shape:
    plain = joined(14, _body(), _head())
    bear = joined(2, plain, ellipsoid((0, -59, 145), (10.5, 7, 7.5)))  # the nose
    bear = joined(1.5, bear, both_sides(ball((18.5, -46.5, 157), 6.8)))  # the eyes
    line = crease(plain, [(0, -60, 139), (0, -60, 131)], 2.2)
    smile = crease(plain, [(0, -60, 131), (7, -58, 127), (14, -53, 130)], 2.2)
    return standing(carved(4, bear, joined(1, line, both_sides(smile))), 3)


BEAR = Model(
    name="bear",
    title="bear, standing",
    height_mm=200,
    shape=_shape,
    bounds=((-90, -80, 0), (90, 70, 210)),
    cell_mm=2.4,
    head=Head(
        middle=(0, -6, 152),
        eye=(18.5, -46.5, 157),
        eye_radius=6.8,
        glabella_z=170,
        sellion_z=157,
        nose_z=146,
        mouth=(0, -61, 130),
        chin=(0, -44, 121),
        breadth_z=158,
        cheek=(44, -22, 144),
        temple=(50, -2, 160),
        ear=Ear(shape=_EAR, tip=(42, 0, 202), outermost=(56, -2, 186)),
        cut=((0, 0, 103), (0, 0, 1)),
    ),
    neck=Neck(
        root=(0, -1, 111),
        notch=(0, -30, 106),
        nape=(0, 29, 108),
        collarbone=(17, -24, 106),
        cut=((0, 0, 72), (0, 0, 1)),
    ),
    arm=Arm(elbow=(59, -10, 77), wrist=(66, -15, 67), tip=(75, -26, 51), back=(0.6, -0.6, 0.5), girth_mm=17),
    foot=Foot(ankle=(27, 0, 26), reach_mm=50, cut_z=38, behind_mm=24, inner_x=9),
    unwearable={
        "helmet": "its ears stand on the crown, where a helmet would sit",
        "ring": "its paws have no fingers",
    },
)
