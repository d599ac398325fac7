"""`fabcraft evaluate`: the paper's tables, figures and user study, by one command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from fabcraft.cli.console import result, result_json, say, table
from fabcraft.errors import InputError

if TYPE_CHECKING:
    from fabcraft.evaluate.cells import Cell

_SHOWN = ("pen_max_mm", "contact_rms_mm", "silhouette_iou", "chamfer_mm", "wall_min_mm", "donnable")


def evaluate(
    *,
    output: Annotated[str, Parameter(name=("--output", "-o"))] = "evaluation",
    quick: bool = False,
    only: Annotated[tuple[str, ...], Parameter(show_default=False, negative=(), consume_multiple=True)] = (),
    preset: Literal["draft", "standard"] = "draft",
    steps: int = 0,
    seed: int = 0,
    encoder: str = "",
    jobs: int = 1,
    study: str | None = None,
    key: str | None = None,
    json: bool = False,
    quiet: bool = False,
) -> int:
    """Compare methods on a suite of designs: the paper's tables and figures, and a user study.

    Examples:

      fabcraft evaluate -o comparison
      fabcraft evaluate --quick -o comparison
      fabcraft evaluate --only ours/star-ring no-body-loss/star-ring
      fabcraft evaluate -o comparison --study results.csv

    What was computed before is found again in the folder; stop it with Ctrl-C and go on later.

    Parameters
    ----------
    output
        Folder for everything.
    quick
        One design with few steps: to see that it runs, not to compare.
    only
        METHOD, DESIGN or METHOD/DESIGN, again for more; the figures then show what there is.
    preset
        How patiently to fit.
    steps
        Steps of every fit. [default: the preset's]
    seed
        Of everything random.
    encoder
        The encoder of the methods that read words, also for the score: a name from fabcraft weights, or a checkpoint.
        [default: what is on this machine]
    jobs
        Cells that are computed at the same time.
    study
        Analyse the results of the user study, a CSV file, instead.
    key
        The study's key. [default: study/study-key.json in the folder]
    json
        Print the result as JSON, and nothing else, on stdout.
    quiet
        No progress on stderr.
    """
    out = Path(output)
    if study is not None:
        return _analysed(Path(study), Path(key) if key else out / "study" / "study-key.json", seed, json)
    if key is not None:
        raise InputError("--key was given without --study", "Give --study RESULTS.csv as well.")
    from fabcraft.evaluate.cells import Options
    from fabcraft.evaluate.judge import judge_of
    from fabcraft.evaluate.run import evaluate as run
    from fabcraft.evaluate.suite import WORDS
    from fabcraft.evaluate.table import COLUMNS, written

    def told(cell: "Cell", done: int, whole: int) -> None:
        if not quiet:
            how = cell.error or f"{cell.seconds:.0f} s"
            say(f"{done} of {whole}: {WORDS[cell.method]}, {cell.title}: {how}")

    options = Options(out, preset, steps, seed, encoder, judge_of(encoder))
    try:
        found = run(options, quick=quick, only=only, jobs=jobs, told=told)
    except KeyboardInterrupt:
        say(f"stopped; the cells that are done are kept in {out}: the same command goes on from there")
        return 130
    if json:
        result_json(found.to_dict())
        return 0
    shown = [index for index, one in enumerate(COLUMNS) if one[0] in _SHOWN]
    lines = [("method", "designs", *(COLUMNS[index][1] for index in shown))]
    for row in found.rows:
        words = written(row)
        lines.append((*words[:2], *(words[2 + index] for index in shown)))
    notes = [f"{WORDS[row.method]}: {row.note}" for row in found.rows if row.note]
    absent = [f"figure {one.name}: {one.why}" for one in found.figures if one.picture is None]
    files = [f"wrote {out / 'index.html'} and {len(found.files) - 1} files beside it"]
    result("\n".join([table(lines), "", *notes, *absent, "", *files]))
    return 0


def _analysed(results: Path, key: Path, seed: int, as_json: bool) -> int:
    """The study's means and intervals."""
    from fabcraft.evaluate.study import QUESTIONS, analysis, read_key, read_results
    from fabcraft.evaluate.suite import WORDS

    codes = read_key(key)
    rows = analysis(read_results(results, codes), codes, seed)
    if as_json:
        result_json({"study": rows})
        return 0

    def words(score: dict[str, Any]) -> str:
        return f"{score['mean']:.2f} [{score['low']:.2f}, {score['high']:.2f}]"

    lines = [("method", "participants", "answers", *QUESTIONS)]
    for row in rows:
        method = WORDS.get(row["method"], row["method"])
        lines.append(
            (method, str(row["participants"]), str(row["answers"]), *(words(row[one]) for one in QUESTIONS))
        )
    result(table(lines))
    return 0
