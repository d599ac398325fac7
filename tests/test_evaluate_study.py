import json

import numpy as np
import pytest

from fabcraft.errors import InputError
from fabcraft.evaluate.cells import Cell
from fabcraft.evaluate.study import (
    COLUMNS,
    Answer,
    analysis,
    items_of,
    key_json,
    read_key,
    read_results,
    results_csv,
    score,
    study_page,
)
from fabcraft.evaluate.suite import METHODS, WORDS

SHOWN = ("template", "no-body-loss", "ours")
KEY = {"aaaa": ("ours", "cat-mask"), "bbbb": ("template", "cat-mask"), "cccc": ("ours", "star-ring")}


@pytest.fixture
def cells(tmp_path):
    made = []
    for index, (method, design) in enumerate(
        (m, d) for m in SHOWN for d in ("cat-mask", "star-ring", "owl-ring")
    ):
        folder = tmp_path / "cells" / str(index)
        folder.mkdir(parents=True)
        for name in ("worn", "other"):
            (folder / f"{name}.png").write_bytes(b"\x89PNG" + bytes([index]) + name.encode())
        made.append(Cell(method, design, "", "", f"cells/{index}", {}, 0.0))
    made.append(Cell("ours", "fox-mask", "", "", "", {}, 0.0, error="it broke"))
    made.append(Cell("direct", "cat-mask", "", "", "cells/0", {}, 0.0))
    return made


def items(cells, folder, seed=0):
    return items_of(cells, {one.design: f"a {one.design}" for one in cells}, folder, seed)


def test_blinding_is_a_permutation_of_what_can_be_shown(cells, tmp_path):
    found = items(cells, tmp_path)
    wanted = {(one.method, one.design) for one in cells if one.method in SHOWN and not one.error}
    assert {(one.method, one.design) for one in found} == wanted and len(found) == len(wanted)
    assert len({one.code for one in found}) == len(found) and all(len(one.code) == 4 for one in found)
    for one in found:
        index = next(
            i for i, cell in enumerate(cells) if (cell.method, cell.design) == (one.method, one.design)
        )
        assert one.pictures[0] == b"\x89PNG" + bytes([index]) + b"worn"


def test_order_and_codes_follow_the_seed_alone(cells, tmp_path):
    assert items(cells, tmp_path, 3) == items(cells, tmp_path, 3)
    assert [a.code for a in items(cells, tmp_path, 3)] != [a.code for a in items(cells, tmp_path, 4)]
    in_order = [(cell.method, cell.design) for cell in cells if cell.method in SHOWN and not cell.error]
    assert [(a.method, a.design) for a in items(cells, tmp_path, 3)] != in_order


def test_the_page_names_no_method_and_no_address(cells, tmp_path):
    page = study_page(items(cells, tmp_path)).lower()
    for word in {*METHODS, *WORDS, *WORDS.values(), "method", "baseline", "seed"}:
        assert word.lower() not in page.replace("<template", ""), word
    assert "http://" not in page and "https://" not in page and "default-src 'none'" in page
    assert "/*data*/" not in page and page.count("data:image/png;base64,") == 2 * len(items(cells, tmp_path))


def test_a_prompt_cannot_end_the_pages_script(cells, tmp_path):
    cells = cells[:1]
    evil = items_of(cells, {cells[0].design: "</script><script>alert(1)</script>"}, tmp_path, 0)
    assert study_page(evil).count("</script>") == study_page(()).count("</script>")


def test_a_study_without_objects_is_a_page_too():
    assert "There are no objects in this study" in study_page(())


def test_the_key_comes_back(cells, tmp_path):
    found = items(cells, tmp_path)
    path = tmp_path / "key.json"
    path.write_text(key_json(found))
    assert read_key(path) == {one.code: (one.method, one.design) for one in found}


def test_results_come_back_from_csv(tmp_path):
    answers = (
        Answer('Ada, "the first"', "aaaa", (1, 10, 5)),
        Answer("Bob", "aaaa", (2, 2, 2)),
        Answer("Bob", "bbbb", (3, 4, 9)),
    )
    path = tmp_path / "results.csv"
    path.write_text(results_csv(answers))
    assert read_results(path, KEY) == answers
    path.write_bytes(
        b"\xef\xbb\xbf" + (results_csv(answers[:1]) + results_csv(answers[1:])).replace("\n", "\r\n").encode()
    )
    assert read_results(path, KEY) == answers  # a byte order mark, joined files and Windows' line ends


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("p,aaaa,1,2", "line 1: 4 values, 5 were expected"),
        ("p,zzzz,1,2,3", "no picture 'zzzz' in the key"),
        ("p,aaaa,1,2,11", "the scores are 1, 2, 11"),
        ("p,aaaa,0,2,3", "the scores are 0, 2, 3"),
        ("p,aaaa,1.5,2,3", "the scores are 1.5"),
        ("p,aaaa,²,2,3", "the scores are"),
        ("p,aaaa,10000000000,2,3", "the scores are"),
        ("p,aaaa,1,2,3\np,aaaa,1,2,3", "line 2: participant p answered aaaa twice"),
        ("", "has no answers"),
        (",".join(COLUMNS), "has no answers"),
        ('p,"' + "x" * 200_000 + '",1,2,3', "line 1: field larger than"),
    ],
)
def test_what_does_not_fit_is_named_with_its_line(tmp_path, text, words):
    path = tmp_path / "results.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_results(path, KEY)
    assert words in caught.value.message and caught.value.next_step


@pytest.mark.parametrize("text", ["", "[1]", '{"a": 1}', '{"a": ["b"]}', "no json"])
def test_a_file_that_is_no_key_is_refused(tmp_path, text):
    path = tmp_path / "key.json"
    path.write_text(text)
    with pytest.raises(InputError, match="is no key of a study"):
        read_key(path)


def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_key(tmp_path / "none.json")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="is not text"):
        read_results(tmp_path / "binary.csv", KEY)


def test_an_interval_of_equal_scores_is_a_point_and_one_of_many_is_normal():
    assert score(np.full(9, 7.0)).__dict__ == {"mean": 7.0, "low": 7.0, "high": 7.0}
    values = np.tile([4.0, 6.0], 200)  # deviation 1, so the mean's is 1 / 20
    found = score(values)
    assert found.mean == 5.0
    assert found.low == pytest.approx(5.0 - 1.96 / 20, abs=0.01)
    assert found.high == pytest.approx(5.0 + 1.96 / 20, abs=0.01)


def test_two_participants_give_the_interval_between_them():
    found = score(np.array([2.0, 8.0]))  # resampled: 2, 5 or 8 with 1/4, 1/2, 1/4
    assert (found.low, found.mean, found.high) == (2.0, 5.0, 8.0)


def test_the_analysis_weighs_participants_alike():
    answers = [
        Answer("a", "aaaa", (10, 1, 1)),
        Answer("a", "cccc", (10, 1, 3)),
        Answer("b", "aaaa", (4, 1, 4)),
    ]
    answers += [Answer("b", "bbbb", (1, 1, 1))]
    rows = analysis(answers, KEY)
    assert [row["method"] for row in rows] == ["template", "ours"]
    assert rows[1]["participants"] == 2 and rows[1]["answers"] == 3
    assert rows[1]["alignment"]["mean"] == 7.0 and rows[1]["comfort"]["mean"] == 3.0
    assert rows[0]["participants"] == 1 and rows[0]["comfort"] == {"mean": 1.0, "low": 1.0, "high": 1.0}
    assert json.dumps(rows) == json.dumps(analysis(answers, KEY))
