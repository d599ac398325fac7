"""Contact files: read, checked, and laid on a body."""

import json
from functools import cache

import numpy as np
import pytest
from masked import template

from fabcraft.body.body import Body
from fabcraft.body.contacts import MAX_ROWS, Contact, read_contacts, resting_on, skin_disc, with_contacts
from fabcraft.body.human import human
from fabcraft.errors import InputError
from fabcraft.template.mask import CONTACTS, GENERAL_MM, RESTING_MM, mask


@cache
def head() -> Body:
    return human("man").part("head")


def written(folder, text, name="contacts.toml"):
    path = folder / name
    path.write_text(text)
    return path


def test_rows_are_read_from_toml_and_json_alike(tmp_path):
    rows = read_contacts(
        written(
            tmp_path,
            '[[contact]]\nregion = "forehead"\nweight = 0\n\n'
            '[[contact]]\npoint = [1, 2.5, 3]\nname = "scar"\nradius_mm = 8\nnever_closer_mm = 5\n',
        )
    )
    assert rows == (
        Contact(region="forehead", weight=0.0),
        Contact(point=(1.0, 2.5, 3.0), name="scar", radius_mm=8.0, never_closer_mm=5.0),
    )
    table = {
        "contact": [
            {"region": "forehead", "weight": 0},
            {"point": [1, 2.5, 3], "name": "scar", "radius_mm": 8},
        ]
    }
    assert read_contacts(written(tmp_path, json.dumps(table), "contacts.json"))[0] == rows[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no list of contacts"),
        ("contact = 3", "no list of contacts"),
        ("contact = [3]", "not a table"),
        ("[[contacts]]\nregion = 'chin'", "unknown|key 'contacts'"),
        ("[[contact]]\nregio = 'chin'", "unknown key regio"),
        ("[[contact]]\nweight = 1", "one of region and point"),
        ("[[contact]]\nregion = 'chin'\npoint = [1, 2, 3]", "one of region and point"),
        ("[[contact]]\nregion = 'chin'\nradius_mm = 3", "own size"),
        ("[[contact]]\nregion = 'chin'\nweight = -1", "weight is -1"),
        ("[[contact]]\nregion = 'chin'\nweight = true", "weight is True"),
        ("[[contact]]\nregion = 'chin'\ngap_mm = nan", "gap_mm is nan"),
        ("[[contact]]\nregion = 'chin'\nnever_closer_mm = 'far'", "never_closer_mm is 'far'"),
        ("[[contact]]\nregion = 7", "region is 7"),
        ("[[contact]]\npoint = [1, 2]", "point is"),
        ("[[contact]]\npoint = [1, 2, inf]", "point is"),
        ("[[contact]]\npoint = 5", "point is 5"),
        ("[[contact]\n", "not valid TOML"),
        ("[[contact]]\nregion = 'chin'\n" * (MAX_ROWS + 1), "201 contacts"),
    ],
)
def test_a_file_that_is_not_right_is_refused_with_what_is_wrong(tmp_path, text, said):
    with pytest.raises(InputError, match=said) as refused:
        read_contacts(written(tmp_path, text))
    assert refused.value.next_step


def test_a_file_that_is_none_is_refused(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path, written(tmp_path, "x", "contacts.txt")):
        with pytest.raises(InputError):
            read_contacts(path)
    with pytest.raises(InputError, match="not valid JSON"):
        read_contacts(written(tmp_path, "{", "broken.json"))
    with pytest.raises(InputError, match="no table"):
        read_contacts(written(tmp_path, "[1]", "list.json"))
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not text"):
        read_contacts(tmp_path / "bytes.toml")


def test_a_row_changes_only_what_it_says():
    body = with_contacts(head(), (Contact(region="forehead", gap_mm=3.0),))
    before, after = head().regions["forehead"], body.regions["forehead"]
    assert (after.weight, after.gap_mm, after.never_closer_mm) == (before.weight, 3.0, before.never_closer_mm)
    assert (after.vertex_indices == before.vertex_indices).all()
    assert body.asked == ("forehead",)


def test_a_point_becomes_a_region_round_it_that_is_kept_clear_of():
    body = with_contacts(
        head(), (Contact(point="zygion_left", name="scar", radius_mm=12.0, never_closer_mm=5.0),)
    )
    region = body.regions["scar"]
    away = np.linalg.norm(body.mesh.vertices[region.vertex_indices] - body.landmarks["zygion_left"], axis=1)
    assert len(region.vertex_indices) > 10
    assert away.max() < 13.0
    assert (region.weight, region.never_closer_mm) == (0.0, 5.0)


def test_an_unknown_region_is_refused_with_the_nearest():
    with pytest.raises(InputError, match="no region 'cheekbones_left'") as refused:
        with_contacts(head(), (Contact(region="cheekbones_left"),))
    assert "cheekbone_left" in refused.value.next_step


def test_what_cannot_be_laid_on_the_body_is_refused():
    with pytest.raises(InputError, match="no landmark 'nose'"):
        with_contacts(head(), (Contact(point="nose"),))
    with pytest.raises(InputError, match="away from the skin"):
        with_contacts(head(), (Contact(point=(0.0, -900.0, 700.0)),))
    with pytest.raises(InputError, match="region of that name"):
        with_contacts(head(), (Contact(point="menton", name="chin"),))
    with pytest.raises(InputError, match="gap wanted"):
        with_contacts(head(), (Contact(region="forehead", never_closer_mm=4.0),))


def test_a_template_rests_on_its_own_regions_and_what_is_asked_besides():
    assert resting_on(head(), CONTACTS) == CONTACTS
    body = with_contacts(
        head(), (Contact(region="nose_bridge", weight=0.0), Contact(region="chin", weight=1.0))
    )
    assert resting_on(body, CONTACTS) == ("forehead", "cheekbone_left", "cheekbone_right", "chin")


def test_a_disc_reaches_as_far_as_its_radius_and_not_across_a_gap():
    mesh, lip = head().mesh, head().landmarks["pronasale"]
    disc = skin_disc(mesh, lip[None], 10.0)
    away = np.linalg.norm(mesh.vertices - lip, axis=1)
    assert away[disc].max() <= 10.0
    assert len(disc) > 0.7 * (away <= 10.0).sum()
    assert len(skin_disc(mesh, lip[None], 0.01)) == 1


def test_a_mask_keeps_the_distance_that_was_asked_and_leaves_out_a_rest():
    asked = with_contacts(
        head(),
        (
            Contact(region="forehead", weight=0.0),
            Contact(point="zygion_left", name="scar", radius_mm=8.0, never_closer_mm=6.0),
            Contact(region="chin", weight=1.0, gap_mm=2.0, never_closer_mm=0.8),
        ),
    )
    placed, plain = mask(asked), template("man")
    assert placed.contacts == ("cheekbone_left", "cheekbone_right", "nose_bridge", "chin")

    def clearance(worn, name):
        points = asked.mesh.vertices[asked.regions[name].vertex_indices]
        return worn.front.at(worn.front.clearance, points[:, [0, 2]])

    scar = clearance(placed, "scar")
    assert scar.max() > 5.9 and clearance(plain, "scar").max() <= GENERAL_MM + 1e-9
    assert np.median(clearance(placed, "forehead")) == pytest.approx(GENERAL_MM)
    assert np.median(clearance(plain, "forehead")) == pytest.approx(RESTING_MM)
    assert clearance(placed, "chin").min() == pytest.approx(0.8, abs=0.05)
