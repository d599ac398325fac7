"""The user study: a page that shows renders without saying who made them, and the analysis of what came back.

Every picture has a code, drawn at random from the study's seed; which method is behind it is in a key that is not part of
the page. Each participant sees all pictures in an order of their own and answers the paper's three questions from 1 to
10. The analysis gives a mean and a bootstrap interval over participants for every method (Efron 1979, percentiles).
"""

import base64
import csv
import html
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from fabcraft.errors import InputError
from fabcraft.evaluate.cells import Cell
from fabcraft.evaluate.suite import WORDS

QUESTIONS = {
    "alignment": "How well does the object show what is asked for?",
    "aesthetics": "How good does it look?",
    "comfort": "How comfortable does it look to wear?",
}
"""The paper's three questions, from 1 (not at all) to 10 (very)."""
COLUMNS = ("participant", "code", *QUESTIONS)
LOWEST, HIGHEST = 1, 10
STUDIED = ("template", "textdeformer", "body-aware-textdeformer", "no-body-loss", "ours")
"""The methods of the paper's study, and the one without a body loss."""
REDRAWS, LEVEL = 10_000, 95.0
_MOST_BYTES, _MOST_ROWS = 20_000_000, 200_000


@dataclass(frozen=True)
class Item:
    """A picture of the study."""

    code: str
    method: str
    design: str
    prompt: str
    pictures: tuple[bytes, bytes]
    """PNG from two sides."""


def items_of(cells: Sequence[Cell], prompts: Mapping[str, str], out: Path, seed: int) -> tuple[Item, ...]:
    """The studied cells in a random order, each under a code that says nothing; the same for the same seed.

    prompts : what was asked for, by the design's name.
    """
    shown = [cell for cell in cells if cell.method in STUDIED and not cell.error]
    random = np.random.default_rng([seed, 8])
    order = random.permutation(len(shown))
    codes = random.permutation(36**4 - 36**3)[: len(shown)] + 36**3
    return tuple(
        Item(
            np.base_repr(int(code), 36).lower(),
            shown[index].method,
            shown[index].design,
            prompts[shown[index].design],
            tuple((out / shown[index].folder / f"{name}.png").read_bytes() for name in ("worn", "other")),
        )
        for index, code in zip(order, codes, strict=True)
    )


def study_page(items: Sequence[Item]) -> str:
    """The offline page: no name of a method, no network; its results leave it as a CSV file that the browser saves."""
    shown = [
        {
            "code": item.code,
            "prompt": item.prompt,
            "pictures": ["data:image/png;base64," + base64.b64encode(png).decode() for png in item.pictures],
        }
        for item in items
    ]
    data = json.dumps({"items": shown, "questions": QUESTIONS, "columns": COLUMNS}).replace("<", "\\u003c")
    return files("fabcraft.evaluate").joinpath("study.html").read_text("utf-8").replace("/*DATA*/", data)


def key_json(items: Sequence[Item]) -> str:
    """Which method and design is behind each code; keep it from the participants."""
    return json.dumps({item.code: [item.method, item.design] for item in items}, indent=1) + "\n"


def read_key(path: Path) -> dict[str, tuple[str, str]]:
    """The key of a study.  Raises `InputError` for a file that is none."""
    text = _text(path, "the key of a study (study-key.json)")
    try:
        table = json.loads(text)
        return {str(code): (str(method), str(design)) for code, (method, design) in table.items()}
    except (ValueError, AttributeError, TypeError):
        raise InputError(
            f"{path} is no key of a study",
            "Give the study-key.json that was written beside the page (--key).",
        ) from None


@dataclass(frozen=True)
class Answer:
    """What one participant said of one picture."""

    participant: str
    code: str
    scores: tuple[int, ...]
    """1 to 10, in the order of `QUESTIONS`."""


def read_results(path: Path, key: Mapping[str, tuple[str, str]]) -> tuple[Answer, ...]:
    """The answers in a CSV file of one or many participants; several files may simply be joined.

    Raises `InputError` naming the line that does not fit.
    """
    rows = csv.reader(io.StringIO(_text(path, "the results of a study (CSV)")))
    answers: dict[tuple[str, str], Answer] = {}
    try:
        for line in rows:
            if not line or tuple(line) == COLUMNS:
                continue
            if rows.line_num > _MOST_ROWS:
                raise InputError(f"{path} has more than {_MOST_ROWS:,} lines", "Check the path.")
            answer = _answer(line, f"{path}, line {rows.line_num}", key)
            if (answer.participant, answer.code) in answers:
                raise InputError(
                    f"{path}, line {rows.line_num}: participant {answer.participant} answered {answer.code} twice",
                    "Keep one of the two lines; participants need different names.",
                )
            answers[answer.participant, answer.code] = answer
    except csv.Error as error:
        raise InputError(
            f"{path}, line {rows.line_num}: {error}", "Give the CSV that the page saved."
        ) from None
    if not answers:
        raise InputError(f"{path} has no answers", f"Give the CSV that the page saved: {','.join(COLUMNS)}.")
    return tuple(answers.values())


def _answer(line: list[str], where: str, key: Mapping[str, tuple[str, str]]) -> Answer:
    if len(line) != len(COLUMNS):
        raise InputError(
            f"{where}: {len(line)} values, {len(COLUMNS)} were expected", f"Columns: {','.join(COLUMNS)}."
        )
    participant, code, *said = (part.strip() for part in line)
    if code not in key:
        raise InputError(
            f"{where}: there is no picture '{code[:20]}' in the key", "Give the key of this study (--key)."
        )
    if not all(part.isascii() and part.isdigit() and LOWEST <= int(part[:3]) <= HIGHEST for part in said):
        raise InputError(
            f"{where}: the scores are {', '.join(said)[:60]}",
            f"Whole numbers from {LOWEST} to {HIGHEST} were expected.",
        )
    return Answer(participant, code, tuple(map(int, said)))


def results_csv(answers: Sequence[Answer]) -> str:
    """Answers as the page saves them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows((answer.participant, answer.code, *answer.scores) for answer in answers)
    return text.getvalue()


@dataclass(frozen=True)
class Score:
    """A method's score on one question."""

    mean: float
    low: float
    high: float
    """Bounds of the 95 % interval; equal to the mean with one participant, who says nothing about others."""


def analysis(
    answers: Sequence[Answer], key: Mapping[str, tuple[str, str]], seed: int = 0
) -> list[dict[str, Any]]:
    """A row for every method: participants, answers, and the score of every question."""
    rows = []
    for method in dict.fromkeys(method for method, _ in key.values()):
        mine = [answer for answer in answers if key[answer.code][0] == method]
        if not mine:
            continue
        people = sorted({answer.participant for answer in mine})
        means = np.array(
            [np.mean([a.scores for a in mine if a.participant == one], axis=0) for one in people]
        )
        scores = {name: score(means[:, index], seed) for index, name in enumerate(QUESTIONS)}
        told = {name: {"mean": one.mean, "low": one.low, "high": one.high} for name, one in scores.items()}
        rows.append({"method": method, "participants": len(people), "answers": len(mine), **told})
    order = list(WORDS)
    return sorted(rows, key=lambda row: order.index(row["method"]) if row["method"] in order else len(order))


def score(values: Float64[np.ndarray, " N"], seed: int = 0) -> Score:
    """Mean of the participants' means, and the percentiles of the means of resampled participants."""
    random = np.random.default_rng([seed, len(values)])
    drawn = values[random.integers(len(values), size=(REDRAWS, len(values)))].mean(1)
    rest = 0.5 * (100.0 - LEVEL)
    low, high = np.percentile(drawn, [rest, 100.0 - rest])
    return Score(float(values.mean()), float(low), float(high))


def _text(path: Path, what: str) -> str:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path} is larger than {_MOST_BYTES // 1_000_000} MB", "Check the path.")
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text", f"Give {what}.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}", f"Give {what}.") from None


def safe(text: str) -> str:
    """Text that cannot become markup."""
    return html.escape(text, quote=True)
