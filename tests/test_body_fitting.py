"""People of given measures: reached, natural, mirror images, or refused with the range."""

import time

import numpy as np
import pytest

from fabcraft.body.fitting import Fitter, rarest
from fabcraft.body.human import PRESETS, human
from fabcraft.body.measures import MEASURES, measured
from fabcraft.body.model import human_model
from fabcraft.errors import InputError


@pytest.fixture(scope="module")
def model():
    return human_model()


@pytest.fixture(scope="module")
def fitters(model):
    return {name: Fitter(model, model.presets[name].astype(np.float64)) for name in PRESETS}


@pytest.mark.parametrize("seed", range(20))
def test_six_measures_of_a_drawn_person_are_reached(model, fitters, seed):
    rng, name = np.random.default_rng(seed), PRESETS[seed % len(PRESETS)]
    names = [str(one) for one in rng.choice(list(MEASURES), 6, replace=False)]
    fitter = fitters[name]
    drawn = rng.normal(size=len(model.spread)) * model.spread
    drawn[-model.differences :] = 0.0
    targets = measured(model.body((fitter.start + drawn).astype(np.float32), name), names)
    fit = fitter.fit(targets)
    assert fit.believable
    # those who were drawn meet the measures too; the found one is more ordinary
    assert fit.rarity <= np.linalg.norm(rng_free(drawn, model)) + 0.01
    again = measured(model.body(fit.coefficients.astype(np.float32), name), names)  # on the cut parts
    assert again == pytest.approx(targets, abs=0.1)


def rng_free(drawn, model):
    used = model.spread > 0
    return drawn[used] / model.spread[used]


def test_six_measures_take_less_than_two_seconds():
    wanted = {"height": 1680, "head": 570, "neck": 340, "wrist": 160, "ring_finger": 55, "foot": 241}
    start = time.process_time()
    person = human("woman", wanted)
    assert time.process_time() - start < 2.0
    assert {name: one.reached_mm for name, one in person.measures.items()} == pytest.approx(wanted, abs=0.05)


def test_what_was_not_asked_stays_ordinary(model):
    before, after = measured(human("woman")), measured(human("woman", {"wrist": 163}))
    assert after["wrist"] == pytest.approx(163, abs=0.05)
    for name, limit_mm in {"height": 40, "head": 6, "pupils": 1, "foot": 6, "ring_finger": 2}.items():
        assert abs(after[name] - before[name]) < limit_mm, name


def test_a_preset_asked_for_its_own_measures_is_itself(model, fitters):
    own = measured(human("man"))
    fit = fitters["man"].fit(own)
    assert fit.rarity < 0.01


def test_without_sides_a_person_is_a_mirror_image():
    person = human("man", {"wrist": 182, "foot": 280})
    points = {
        key: point for key, point in (person.landmarks | person.joints).items() if key.endswith("_left")
    }
    places = person.landmarks | person.joints
    for key, point in points.items():
        assert places[key.replace("_left", "_right")] == pytest.approx(point * [-1, 1, 1], abs=1e-4), key


def test_left_and_right_can_differ():
    wanted = {"wrist_left": 160, "wrist_right": 156, "foot_left": 248, "ring_finger": 54}
    person = human("woman", wanted)
    found = measured(person, ("wrist", "foot", "ring_finger"))
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, abs=0.05)
    assert found["foot_right"] == pytest.approx(247.5, abs=1.0)  # the other foot follows


def test_the_knuckle_and_the_finger_are_their_own_measures():
    found = measured(human("woman", {"ring_finger": 54, "ring_knuckle": 58}), ("ring_finger", "ring_knuckle"))
    assert found == pytest.approx({"ring_finger": 54, "ring_knuckle": 58}, abs=0.05)


def test_sizes_are_reported_as_they_were_asked():
    person = human("woman", {"ring_finger": "US7", "hand_folded": "IN2-8"})
    assert person.measures["ring_finger"].words == "US 7"
    assert person.measures["ring_finger"].reached_mm == pytest.approx(54.35, abs=0.05)
    assert person.measures["hand_folded"].reached_mm == person.measures["hand_folded"].asked_mm
    assert person.part("hand_left").measures == person.measures


@pytest.mark.parametrize(
    ("name", "measures", "said"),
    [
        (
            "woman",
            {"wrist": 260},
            r"wrist 260 mm is out of reach for woman: it can be 11\d\.\d to 19\d\.\d mm",
        ),
        (
            "man",
            {"head": 574, "pupils": 90},
            r"pupils 90 mm .* with the other measures as asked: it can be 5",
        ),
        ("woman", {"ring_finger": "US15"}, r"ring_finger US 15, 74\.8 mm, is out of reach"),
    ],
)
def test_a_measure_out_of_reach_is_refused_with_the_range(name, measures, said):
    with pytest.raises(InputError, match=said):
        human(name, measures)


def test_the_range_holds_what_it_promises(fitters):
    low, high = fitters["woman"].reach({"wrist": 300.0}, "wrist")
    assert low < 125 < 155 < 185 < high
    for value in (low, high):
        assert fitters["woman"].fit({"wrist": value}).believable
    for value in (low - 2.0, high + 2.0):
        assert not fitters["woman"].fit({"wrist": value}).believable


def test_measures_that_no_one_has_together_are_refused():
    with pytest.raises(InputError, match=r"out of reach|together"):
        human("woman", {"head": 590, "head_breadth": 130, "head_length": 175})


def test_rarity_is_the_tail_of_the_chi_distribution():
    assert rarest(1) == pytest.approx(3.8906, abs=1e-3)  # one in ten thousand, two sides
    assert rarest(6) > rarest(2) > rarest(1)


def test_a_fitted_person_is_the_same_every_time():
    first, second = (human("child", {"head": 530}).mesh.vertices.tobytes() for _ in range(2))
    assert first == second
