"""The dinosaur: upright on two feet and a long tail, with a row of spikes down its back; its crown is bare."""

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
    thorn,
)

_SPIKES = (
    ((0, 26, 146), 9, 11), ((0, 33, 124), 11, 15), ((0, 44, 101), 12.5, 17), ((0, 58, 78), 12.5, 17),
    ((0, 80, 59), 11.5, 15), ((0, 104, 45), 9.5, 12), ((0, 127, 36), 7.5, 9), ((0, 148, 34), 5.5, 7),
)  # fmt: skip
"""(near, radius, height) of each, from the neck to the end of the tail."""
_FINGERS = (((44, -49, 92), (42, -59, 91), (40, -69, 90)), ((54, -48, 92), (57, -58, 90.5), (60, -67, 89)))
"""(base, knuckle, tip) of each finger of the left hand."""


def _head() -> Shape:
    snout = joined(10, ellipsoid((0, -54, 150), (31, 28, 23)), ellipsoid((0, -42, 140), (32, 32, 19)))
    skull = joined(12, ellipsoid((0, -20, 160), (40, 40, 36)), snout)
    return joined(7, skull, both_sides(ellipsoid((22, -40, 177), (13, 14, 12))))  # the brows


def _body() -> Shape:
    trunk = joined(20, ellipsoid((0, 6, 74), (40, 40, 44)), limb([(0, 6, 90), (0, -2, 140)], (33, 27)))
    tail = limb([(0, 24, 56), (0, 66, 38), (0, 108, 24), (0, 146, 22), (0, 172, 30)], (36, 27, 18, 11, 5.5))
    trunk = joined(14, trunk, ellipsoid((0, -8, 68), (34, 34, 40)), tail)
    toes = [limb([(34, -18, 10), (x, y, 9)], (8, 8)) for x, y in ((24, -34), (35, -39), (46, -33))]
    foot = joined(5, ellipsoid((34, -10, 12), (19, 24, 15)), *toes)
    leg = joined(9, ellipsoid((32, 6, 46), (20, 27, 30)), limb([(34, 6, 34), (33, 2, 14)], (17, 16)), foot)
    arm = limb([(26, -12, 108), (46, -24, 97), (49, -44, 93)], (11, 9.5, 9))
    hand = joined(3, arm, *[limb([base, tip], (5, 4.6)) for base, _, tip in _FINGERS])
    return joined(7, trunk, both_sides(leg), both_sides(hand))


def _shape() -> Shape:
    smooth = joined(14, _body(), _head())
    dinosaur = joined(4, smooth, *[thorn(smooth, *spike) for spike in _SPIKES])
    dinosaur = joined(1.5, dinosaur, both_sides(ball((22, -53.5, 176), 8)))  # the eyes
    nostril = ellipsoid((9.5, -79, 161), (3.6, 4.5, 3.2))
    smile = crease(smooth, [(0, -80, 143), (17, -74, 143), (30, -58, 146), (35, -42, 154)], 2.4)
    return standing(carved(4, dinosaur, both_sides(nostril), both_sides(smile)), 3)


DINOSAUR = Model(
    name="dinosaur",
    title="dinosaur, upright, with a long tail",
    height_mm=200,
    shape=_shape,
    bounds=((-75, -95, 0), (75, 190, 205)),
    cell_mm=2.6,
    head=Head(
        middle=(0, -22, 160),
        eye=(22, -53.5, 176),
        eye_radius=8,
        glabella_z=184,
        sellion_z=174,
        nose_z=155,
        mouth=(0, -81, 143),
        chin=(0, -64, 125),
        breadth_z=172,
        cheek=(40, -30, 155),
        temple=(40, -14, 174),
        ear=None,
        cut=((0, 0, 122), (0, -0.25, 1)),
    ),
    neck=Neck(
        root=(0, 2, 126),
        notch=(0, -30, 114),
        nape=(0, 31, 133),
        collarbone=(17, -25, 116),
        cut=((0, 0, 76), (0, 0, 1)),
    ),
    arm=Arm(
        elbow=(44, -22, 98),
        wrist=(48.5, -40, 94),
        tip=(49, -64, 90.5),
        back=(0, 0.1, 1),
        girth_mm=13,
        fingers=_FINGERS,
    ),
    foot=Foot(ankle=(33, 2, 26), reach_mm=52, cut_z=36, behind_mm=18, inner_x=10),
)
