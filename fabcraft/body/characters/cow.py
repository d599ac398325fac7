"""The cow: on four hooves, horned, with a broad muzzle and ears to the sides."""

from fabcraft.body.characters.model import Arm, Ear, Foot, Head, Model, Neck
from fabcraft.body.characters.shapes import (
    Shape,
    ball,
    both_sides,
    carved,
    crease,
    drum,
    ellipsoid,
    joined,
    limb,
    standing,
)

_EAR = ellipsoid((58, -44, 152), (25, 9, 13.5), (0, 20, -10))


def _head() -> Shape:
    skull = joined(14, ellipsoid((0, -58, 140), (39, 36, 38)), ellipsoid((0, -56, 160), (36, 30, 22)))
    lip = ellipsoid((15, -90, 114), (18, 18, 17))
    head = joined(10, skull, joined(10, ellipsoid((0, -86, 116), (31, 22, 20)), both_sides(lip)))
    head = joined(6, head, both_sides(_EAR))
    head = joined(4, head, both_sides(limb([(24, -46, 170), (35, -46, 184), (35, -48, 200)], (10.5, 8.5, 5))))
    head = joined(
        4, head, ellipsoid((0, -80, 174), (13, 11, 9)), ellipsoid((0, -72, 181), (16, 13, 9))
    )  # the tuft
    return carved(4, head, both_sides(ellipsoid((62, -56, 151), (15, 8, 8), (0, 20, -10))))


def _body() -> Shape:
    trunk = joined(16, ellipsoid((0, -10, 80), (40, 36, 40)), ellipsoid((0, 48, 80), (41, 50, 39)))
    trunk = joined(12, trunk, limb([(0, -16, 98), (0, -44, 122)], (32, 30)))
    fore = joined(2.5, limb([(24, -20, 66), (25, -22, 14)], (17, 14.5)), drum((25, -23, 8), 18, 12, 5.5))
    thigh = joined(
        10, ellipsoid((27, 66, 60), (17, 27, 30)), limb([(27, 72, 44), (26, 72, 14)], (15.5, 14.5))
    )
    hind = joined(2.5, thigh, drum((26, 71, 8), 18, 12, 5.5))
    tail = joined(
        3,
        limb([(0, 92, 104), (0, 112, 88), (0, 113, 62)], (7, 6, 6)),
        ellipsoid((0, 113, 48), (9.5, 9.5, 15)),
    )
    teat = limb([(8, 34, 34), (8, 34, 27)], (4.5, 4))
    udder = joined(3, ellipsoid((0, 40, 43), (22, 24, 12)), both_sides(teat))
    return joined(5, joined(8, joined(10, trunk, both_sides(fore), both_sides(hind)), tail), udder)


def _shape() -> Shape:
    plain = joined(12, _body(), _head())
    cow = joined(1.5, plain, both_sides(ball((21, -87, 150), 7.8)))  # the eyes
    nostril = ellipsoid((13, -108, 122), (5, 5.5, 4.2), (0, -25, 0))
    smile = crease(plain, [(0, -108, 105), (13, -107, 104), (26, -98, 109)], 2.4)
    clefts = [limb([(x, y, -2), (x, y + 4, 22)], (3.4, 2.2)) for x, y in ((25, -43), (26, 51))]
    cut = [both_sides(cutter) for cutter in (nostril, smile, *clefts)]
    return standing(carved(4, cow, *cut), 3)


COW = Model(
    name="cow",
    title="cow, on four legs",
    height_mm=200,
    shape=_shape,
    bounds=((-95, -120, 0), (95, 130, 210)),
    cell_mm=2.6,
    head=Head(
        middle=(0, -56, 146),
        eye=(21, -87, 150),
        eye_radius=7.8,
        glabella_z=162,
        sellion_z=149,
        nose_z=122,
        mouth=(0, -109, 104),
        chin=(0, -88, 95),
        breadth_z=162,
        cheek=(38, -66, 138),
        temple=(40, -44, 166),
        ear=Ear(shape=_EAR, tip=(46, -44, 169), outermost=(82, -44, 144)),
        cut=((0, -20, 102), (0, -0.66, 0.75)),
    ),
    neck=Neck(
        root=(0, -32, 118),
        notch=(0, -52, 92),
        nape=(0, 6, 118),
        collarbone=(20, -44, 92),
        cut=((0, -2, 64), (0, -0.6, 0.8)),
    ),
    arm=Arm(elbow=(24.6, -21.3, 36), wrist=(25, -22, 25), tip=(25, -24, 6), back=(0, -1, 0), girth_mm=20),
    foot=Foot(ankle=(26, 72, 22), reach_mm=42, cut_z=35, behind_mm=24),
    unwearable={
        "helmet": "its horns stand on the crown, where a helmet would sit",
        "visor": "its horns and ears grow where the band would run",
        "glasses": "its ears stand out where the side pieces would slide off",
        "ring": "its hooves have no fingers",
        "slippers": "its legs stand in the middle of the hooves: nothing sticks out in front for an upper to cover",
    },
)
