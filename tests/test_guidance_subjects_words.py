"""Words become subjects of the library, or are refused with the nearest ones."""

import pytest

from fabcraft.errors import InputError
from fabcraft.guidance.subjects.library import subjects
from fabcraft.guidance.subjects.words import nearest, wish_of

KNOWN = subjects()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cat", "cat"),
        ("kitty", "cat"),
        ("rabbit", "bunny"),
        ("a crocodile", "alligator"),
        ("T-Rex", "dinosaur"),
        ("a mask that looks like a cat", "cat"),
        ("heart shaped glasses", "heart"),
        ("heart-shaped glasses", "heart"),
        ("a ring with a star", "star"),
        ("a star on a ring", "star"),
        ("a bangle in the shape of an alligator", "alligator"),
        ("bunny slippers", "bunny"),
        ("the face of a lion", "lion"),
        ("WOLVES", "wolf"),
        ("strawberries", "strawberry"),
        ("leaves", "leaf"),
        ("jack-o'-lantern", "jack-o-lantern"),
        ("sun flower", "sunflower"),
        ("a princess crown", "crown"),
        ("a cat with a star", "cat with star"),
        ("a star on a cat", "cat with star"),
        ("rose & heart", "rose and heart"),
    ],
)
def test_a_prompt_names_its_subject(text, words):
    assert wish_of(text, KNOWN).words == words


@pytest.mark.parametrize(
    ("text", "name"),
    [("dinosuar", "dinosaur"), ("catt", "cat"), ("buterfly", "butterfly"), ("bunnny", "bunny")],
)
def test_a_slip_of_the_pen_is_read_as_it_was_meant_and_told(text, name):
    wish = wish_of(text, KNOWN)
    assert wish.subject.name == name
    assert text in wish.notes[0]


@pytest.mark.parametrize(
    "text", ["clown", "father", "castle", "bar", "plant", "pocket", "leather", "funny", "host"]
)
def test_a_real_word_beside_a_subject_is_not_taken_for_it(text):
    with pytest.raises(InputError, match="no drawing of"):
        wish_of(text, KNOWN)


def test_what_the_drawing_cannot_show_is_told():
    assert wish_of("a cute black cat", KNOWN).notes == (
        "Left aside, for the drawing cannot show it: cute black.",
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "names nothing"),
        ("a mask", "names nothing"),
        ("!?", "names nothing"),
        ("a cat with whiskers", "no drawing of 'whiskers'"),
        ("hot dog", "no drawing of 'hot dog'"),
        ("tiger shark", "without saying how"),
        ("a cat wearing glasses", "kind of wearable"),
        ("not a cat", "says 'not'"),
        ("cat or dog", "says 'or'"),
        ("a cat and a dog and a pig", "3 subjects"),
        ("a cat with a kitty", "twice"),
        ("a cat shaped like a dog", "not how they belong together"),
        ("cat " * 100, "400 letters"),
    ],
)
def test_what_leaves_a_doubt_is_refused(text, said):
    with pytest.raises(InputError, match=said):
        wish_of(text, KNOWN)


def test_a_refusal_lists_the_nearest_subjects():
    with pytest.raises(InputError) as refused:
        wish_of("a mask like a pumkin", KNOWN)
    assert "jack-o-lantern (pumpkin)" in refused.value.next_step
    assert nearest("cattle car", KNOWN)
    assert nearest("qqqq", KNOWN) == []
