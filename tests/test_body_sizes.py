"""Sizes with known answers, and what is said to somebody who mistypes one."""

import pytest

from fabcraft.body.sizes import Asked, asked, parse
from fabcraft.errors import InputError


@pytest.mark.parametrize(
    ("name", "text", "millimetres", "words"),
    [
        ("ring_finger", "54", 54.0, ""),
        ("ring_finger", 54, 54.0, ""),
        ("ring_finger", "ISO54", 54.0, "ISO 54"),
        ("ring_finger", "US7", 54.35, "US 7"),
        ("ring_finger", "us 6.5", 53.075, "US 6.5"),
        ("ring_finger_left", "CH14", 54.0, "CH 14"),
        ("foot", "EU42", 267.5, "EU 42"),
        ("foot", "MP265", 265.0, "MP 265"),
        ("head", "hat58", 580.0, "hat 58"),
        ("head", "US7.25", 578.5, "US 7.25"),
        ("head", "UK7.125", 578.5, "UK 7.125"),
        ("hand_folded", "IN2-6", 189.5 - 4.0, "IN 2-6"),
        ("wrist", "15.8cm", 158.0, "15.8cm"),
        ("wrist", "15,8 cm", 158.0, "15,8 cm"),
        ("wrist", "158mm", 158.0, ""),
        ("height", "1.75m", 1750.0, "1.75m"),
        ("wrist", "6.2in", 157.48, "6.2in"),
    ],
)
def test_sizes_have_their_known_millimetres(name, text, millimetres, words):
    (one,) = asked({name: text})
    assert one.mm == pytest.approx(millimetres, abs=0.06)
    assert (one.name, one.words) == (name, words)


def test_ring_standards_agree_where_tables_do():
    def mm(text):
        return asked({"ring_finger": text})[0].mm

    assert mm("ISO54") == pytest.approx(mm("US7"), abs=0.5)  # 54 is sold as US 6 7/8
    assert mm("IT20") == mm("ISO60")


@pytest.mark.parametrize(
    ("measures", "said"),
    [
        ({"wirst": 158}, "did you mean wrist"),
        ({"wrist": "US7"}, "no standard 'US' for wrist"),
        ({"ring_finger": "JP7"}, "Standards: ISO, US, CH, IT, ES"),
        ({"wrist": "wide"}, "is not a size"),
        ({"wrist": "-158"}, "is not a size"),
        ({"wrist": "158kg"}, "is not a size"),
        ({"hand_folded": "IN26"}, "is not a size"),
        ({"hand_folded": "200-6"}, "is not a size"),
        ({"wrist": "0"}, "would be 0 mm"),
        ({"wrist": float("nan")}, "is not a size"),
        ({"wrist": "9" * 400}, "would be inf mm"),
        ({"height": "1750m"}, "would be 1.75e"),
        ({"wrist": 158, "wrist_left": 160}, "both given"),
        ({"head_left": 560}, "head has no left side"),
    ],
)
def test_a_wrong_size_is_refused_with_what_would_do(measures, said):
    with pytest.raises(InputError, match=said.replace("(", r"\(")):
        asked(measures)


def test_words_of_the_command_line_are_taken_apart():
    assert parse(["wrist=158", " ring_finger = US7 "]) == {"wrist": "158", "ring_finger": "US7"}
    for wrong in ("wrist", "wrist=", "=158"):
        with pytest.raises(InputError, match="name=value"):
            parse([wrong])
    with pytest.raises(InputError, match="measured twice"):
        parse(["wrist=158", "wrist=160"])


def test_the_order_is_kept():
    assert asked({"foot": 250, "wrist": 150}) == [Asked("foot", 250.0), Asked("wrist", 150.0)]
