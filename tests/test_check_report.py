"""The report's JSON and text: stable, complete, and never safer than what was measured."""

import json

import numpy as np
import pytest

from fabcraft import __version__
from fabcraft.check.report import Finding, PrintReport, could_not_run, places

THIN = Finding(
    check="wall",
    severity="fail",
    value=0.5,
    limit=0.9,
    unit="mm",
    where=((1.0, 2.0, 3.0),),
    advice="Too thin.",
)
HANGS = Finding(check="overhang", severity="warn", value=12.5, unit="%", advice="Turn it.")
PARTS = Finding(check="parts", severity="note", value=2, advice="Two pieces.")


def test_the_json_has_the_promised_keys_in_order():
    report = PrintReport(
        findings=(THIN,), peak_memory_bytes=5, files=("a.3mf",), route=("mesh",), seconds={"wall": 1.0}
    )
    assert list(json.loads(report.to_json())) == [
        "schema",
        "version",
        "printable",
        "verdict",
        "findings",
        "route",
        "metrics",
        "seconds",
        "peak_memory_bytes",
        "files",
    ]
    assert json.loads(report.to_json())["version"] == __version__
    assert list(json.loads(report.to_json())["findings"][0]) == [
        "check",
        "severity",
        "value",
        "limit",
        "unit",
        "where",
        "advice",
    ]


def test_one_failure_is_enough_to_be_unprintable():
    assert PrintReport(findings=(HANGS, PARTS)).printable
    report = PrintReport(findings=(HANGS, THIN))
    assert not report.printable
    assert report.verdict == "Not printable: wall (1 warning)."
    assert PrintReport().verdict == "Printable."


def test_a_check_that_could_not_run_is_a_failure():
    finding = could_not_run("wall", "no inside.", "Close it.")
    assert finding.severity == "fail"
    assert finding.advice == "could not run: no inside. Close it."
    assert not PrintReport(findings=(finding,)).printable


def test_nothing_is_called_printable_that_was_not_checked():
    unknown = PrintReport(findings=(could_not_run("wall", "no inside"), PARTS))
    assert unknown.verdict == "Not known to be printable, could not check: wall."
    assert unknown.to_dict()["findings"][0]["ran"] is False
    both = PrintReport(
        findings=(could_not_run("wall", "no inside"), Finding(check="size", severity="fail", advice="x"))
    )
    assert both.verdict == "Not printable: wall, size."
    sound = PrintReport(findings=(PARTS,), unchecked="walls")
    assert (sound.printable, sound.failed) == (False, False)
    assert sound.verdict == "Sound, but not checked: walls."


def test_the_worst_comes_first():
    assert [one.check for one in PrintReport(findings=(PARTS, HANGS, THIN)).findings] == [
        "wall",
        "overhang",
        "parts",
    ]


def test_what_was_not_measured_is_absent():
    data = PrintReport(findings=(PARTS,), metrics={"parts": 2}).to_dict()
    assert data["metrics"] == {"parts": 2}
    assert "peak_memory_bytes" not in data
    assert set(data["findings"][0]) == {"check", "severity", "value", "advice"}


def test_the_same_metrics_in_another_order_give_the_same_bytes():
    one = PrintReport(metrics={"parts": 1, "wall_min_mm": 1.0, "size_mm": (1.0, 2.0, 3.0)})
    other = PrintReport(metrics={"size_mm": (1.0, 2.0, 3.0), "wall_min_mm": 1.0, "parts": 1})
    assert one.to_json() == other.to_json()


def test_numbers_keep_six_significant_digits_and_numpy_becomes_plain():
    metrics = {"paper_Dp": 1.23456789e-9, "faces": np.int64(3), "wall_min_mm": np.float64(1.23456789)}
    assert PrintReport(metrics=metrics).to_dict()["metrics"] == {
        "faces": 3,
        "paper_Dp": 1.23457e-9,
        "wall_min_mm": 1.23457,
    }


def test_a_number_that_is_none_is_refused():
    with pytest.raises(ValueError):
        PrintReport(metrics={"pen_max_mm": float("nan")}).to_json()


def test_the_text_names_number_limit_place_and_verdict():
    assert PrintReport(findings=(THIN,)).to_text() == (
        "FAIL wall 0.5 mm (limit 0.9 mm): Too thin.\n     at (1.0, 2.0, 3.0) mm\nNot printable: wall."
    )


def test_places_are_plain_rounded_and_limited():
    assert places(np.array([[1.23456, 0, -1.0]] * 20), most=2) == ((1.23, 0.0, -1.0), (1.23, 0.0, -1.0))


def test_a_report_cannot_be_changed():
    report = PrintReport(metrics={"parts": 1})
    with pytest.raises(TypeError):
        report.metrics["parts"] = 2  # type: ignore[index]
