"""The block figure: a round head with a stud, a tapering torso, square legs and hands that grip."""

from fabcraft.body.characters.model import Arm, Foot, Head, Model, Neck
from fabcraft.body.characters.shapes import (
    Shape,
    ball,
    both_sides,
    box,
    carved,
    crease,
    drum,
    joined,
    limb,
    standing,
)


def _shape() -> Shape:
    head = joined(2, drum((0, 0, 151), 29, 23, 9), drum((0, 0, 177), 14, 7.5, 2.4))
    torso = joined(3, box((0, 0, 92), (40, 22, 32), 5.5, 0.22), box((0, 0, 57), (39, 21, 8), 4))
    torso = joined(3, torso, drum((0, 0, 127), 16, 8, 2))  # the neck
    leg = joined(2, box((21, 0, 28), (18, 21, 28), 5), box((21, -8, 8), (18, 28, 10), 5))
    arm = limb([(36, 0, 112), (54, -4, 93), (59, -18, 74)], (13, 12.5, 12))
    grip = carved(3, ball((62.5, -33, 59), 15), limb([(62.5, -54, 71), (62.5, -22, 37)], (6.8, 6.8)))
    hand = joined(2.5, limb([(59, -18, 74), (61, -26, 66)], (9, 9)), grip)
    figure = joined(2, torso, head, both_sides(leg))
    figure = joined(2.5, joined(4, figure, both_sides(arm)), both_sides(hand))
    figure = joined(1, figure, both_sides(ball((10.5, -25.5, 158), 4.8)))  # the eyes
    smile = crease(head, [(0, -29, 140.5), (7.5, -28, 142.5), (13, -26, 147.5)], 2.2)
    return standing(carved(3.5, figure, both_sides(smile)), 2.5)


FIGURE = Model(
    name="figure",
    title="block figure",
    height_mm=160,
    shape=_shape,
    bounds=((-85, -55, 0), (85, 40, 190)),
    cell_mm=2.3,
    head=Head(
        middle=(0, 0, 151),
        eye=(10.5, -25.5, 158),
        eye_radius=4.8,
        glabella_z=163,
        sellion_z=157,
        nose_z=150,
        mouth=(0, -29, 141),
        chin=(0, -27, 130),
        breadth_z=162,
        cheek=(29, 0, 152),
        temple=(28.5, 5, 160),
        ear=None,
        cut=((0, 0, 116), (0, 0, 1)),
    ),
    neck=Neck(
        root=(0, 0, 124),
        notch=(0, -16, 124),
        nape=(0, 16, 124),
        collarbone=(16, -10, 124),
        cut=((0, 0, 74), (0, 0, 1)),
    ),
    arm=Arm(elbow=(54, -4, 93), wrist=(60, -22, 70), tip=(62.5, -36, 62), back=(0.3, -0.7, 0.6), girth_mm=16),
    foot=Foot(ankle=(21, 0, 26), reach_mm=50, cut_z=40, behind_mm=24, inner_x=2),
    unwearable={
        "glasses": "it has neither a nose nor ears that could carry them",
        "necklace": "its head sits close on its shoulders: there is no neck to go round",
        "ring": "its hands have no fingers",
    },
)
