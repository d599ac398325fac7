"""A second opinion from a slicer, when it is there: whether it slices, how long it prints, what it takes.

PrusaSlicer gets a configuration made from the printer profile (`slicer_settings`); another slicer is run as
the profile's `slicer_command` says. Nothing of it changes the object. "It slices" does not mean "it prints"
(a 0.2 mm wall is silently widened), so this adds facts and never overrules the other checks. Runs without a
shell, in its own temporary folder, under a time limit, and takes its children with it when that is over.
Exit codes seen with PrusaSlicer 2.5: 0 done, 1 cannot load or cannot make paths, 134 does not fit the bed or
has no volume.
"""

import contextlib
import re
import shutil
import subprocess
import tempfile
import time
import zipfile
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fabcraft.check.archive import read_archive
from fabcraft.check.gcode import read_gcode
from fabcraft.check.printability import turn_to_fit
from fabcraft.check.report import Finding, PrintReport, Value, could_not_run
from fabcraft.check.slicer_settings import INFILL_PERCENT, slicer_ini
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile
from fabcraft.program import filled, run_program

PROGRAM = "prusa-slicer"
TIMEOUT_S = 300.0
_MOST_BYTES = 500_000_000


@dataclass(frozen=True)
class SlicerAnswer:
    """What the slicer said; what it did not say is None."""

    program: str
    available: bool = True
    sliced: bool | None = None
    """Whether it made a file; None when it gave no answer."""
    seconds: float | None = None
    """Estimated printing time."""
    material_mm3: float | None = None
    """Filament or resin, supports included."""
    material_g: float | None = None
    support_mm3: float | None = None
    laid_mm3: float | None = None
    """What is extruded while moving: of the part and its supports, without what primes the nozzle."""
    layers: int | None = None
    empty_layers_mm: tuple[float, ...] = ()
    """Heights over which nothing was laid below."""
    warnings: tuple[str, ...] = ()
    error: str = ""
    """Why it gave no answer, or why it refuses."""


def ask_slicer(
    mesh: Mesh,
    profile: PrinterProfile,
    *,
    supports: bool = True,
    infill_percent: int = INFILL_PERCENT,
    keep: Path | None = None,
    timeout_s: float = TIMEOUT_S,
    program: str = PROGRAM,
) -> SlicerAnswer:
    """Let a slicer slice the mesh as it is oriented; takes seconds to minutes.

    keep : where to copy what it made (G-code, or what `slicer_command` makes).
    program : PrusaSlicer's name on the path; not used where the profile has a `slicer_command`.
    Raises `InputError` when `keep` cannot be written.
    """
    words = profile.slicer_command
    name = words[0] if words else program
    if not words and profile.process not in ("fdm", "sla"):
        return SlicerAnswer(name, available=False, error="Powder is sliced by who prints it; not asked.")
    path = shutil.which(name)
    if path is None:
        return SlicerAnswer(name, available=False, error=f"{name} is not installed; not asked.")
    if turn := turn_to_fit(mesh, profile.build_mm):
        mesh = _turned(mesh, turn)
    with tempfile.TemporaryDirectory(prefix="fabcraft-slicer-", ignore_cleanup_errors=True) as temporary:
        folder = Path(temporary)
        part = folder / "part.stl"
        part.write_bytes(_stl(mesh))
        made = folder / ("part.sl1" if profile.process == "sla" and not words else "part.gcode")
        if words:
            places = {"{input}": str(part), "{output}": str(made), "{folder}": temporary}
            command = [path, *(filled(word, places) for word in words[1:])]
        else:
            ini = folder / "printer.ini"
            ini.write_text(slicer_ini(profile, supports, infill_percent), encoding="utf-8")
            action = "--export-sla" if profile.process == "sla" else "--export-gcode"
            command = [path, action, "--load", str(ini), "--loglevel", "2", "--output", str(made), str(part)]
        try:
            code, said = run_program(command, timeout_s, folder=folder)
        except subprocess.TimeoutExpired:
            return SlicerAnswer(name, error=f"{name} gave no answer within {timeout_s:g} s")
        except OSError as error:
            return SlicerAnswer(name, error=f"{name} could not be started: {error.strerror or error}")
        lines = _lines(said)
        found = _product(folder, made)
        if code != 0 or found is None:
            why = _last_words(lines) or (f"it stopped with code {code}" if code else "it made no file")
            return SlicerAnswer(name, sliced=False, error=why)
        if found.stat().st_size > _MOST_BYTES:
            return SlicerAnswer(name, error=f"{name} made {found.stat().st_size:,} bytes, too many to read")
        answer = _measured(found, mesh, profile, SlicerAnswer(name, sliced=True, warnings=_warnings(lines)))
        if keep is not None and answer.sliced:
            _copy(found, keep)
        return answer


def with_slicing(
    report: PrintReport, mesh: Mesh, profile: PrinterProfile, keep: Path | None = None
) -> PrintReport:
    """The report with what the slicer says of the mesh it is about.  Raises `InputError` as `ask_slicer`."""
    if not len(mesh.faces):
        return report
    start = time.perf_counter()
    answer = ask_slicer(mesh, profile, keep=keep)
    told: dict[str, Value | None] = {
        "slicer_print_seconds": answer.seconds,
        "slicer_material_mm3": answer.material_mm3,
        "slicer_material_g": answer.material_g,
        "slicer_support_mm3": answer.support_mm3,
        "slicer_layers": answer.layers,
    }
    kept = (str(keep),) if keep is not None and answer.sliced else ()
    return replace(
        report,
        findings=(*report.findings, *slicer_findings(answer, profile)),
        metrics={**report.metrics, **{name: value for name, value in told.items() if value is not None}},
        seconds={**report.seconds, "slicer": time.perf_counter() - start},
        files=(*report.files, *kept),
    )


def slicer_findings(answer: SlicerAnswer, profile: PrinterProfile) -> list[Finding]:
    """The slicer's view: a note when it is absent, a failure when it refuses or gives no answer."""
    if not answer.available:
        return [Finding(check="slicer", severity="note", advice=answer.error)]
    if answer.sliced is None:
        return [could_not_run("slicer", answer.error, "Slice it by hand, or leave out --slice.")]
    if not answer.sliced:
        advice = f"{answer.program} refuses it: {answer.error}"
        return [Finding(check="slicer", severity="fail", value=False, limit=True, advice=advice)]
    found = []
    if answer.empty_layers_mm:
        heights = ", ".join(f"{height:g}" for height in answer.empty_layers_mm[:5])
        advice = f"Nothing is laid in the layers below {heights} mm: what is there is too thin to print."
        count = len(answer.empty_layers_mm)
        found.append(Finding(check="empty_layers", severity="fail", value=count, limit=0, advice=advice))
    for warning in answer.warnings:
        found.append(Finding(check="slicer", severity="warn", advice=f"{answer.program} says: {warning}"))
    found.append(Finding(check="slicer", severity="note", advice=_summary(answer, profile)))
    return found


def _summary(answer: SlicerAnswer, profile: PrinterProfile) -> str:
    figures = []
    if answer.seconds is not None:
        figures.append(_duration(answer.seconds))
    if answer.material_mm3 is not None:
        weight = "" if answer.material_g is None else f" ({answer.material_g:.1f} g)"
        figures.append(f"{answer.material_mm3 / 1000:.1f} cm³{weight}")
    if answer.support_mm3 is not None:
        share = f"{answer.support_mm3 / 1000:.2g} cm³ of it" if answer.support_mm3 else "no"
        figures.append(f"{share} support")
    text = f"{answer.program} slices it for the {profile.name or profile.title}"
    text += f": {', '.join(figures)}" if figures else ", and tells no time or material"
    if profile.slicer_command:
        return f"{text}."
    if profile.process == "fdm":
        return f"{text}, at {INFILL_PERCENT} % infill and general speeds."
    untold = "" if answer.seconds is not None else "; the profile tells no exposure, so no time"
    return f"{text}{untold}."


def _measured(made: Path, mesh: Mesh, profile: PrinterProfile, answer: SlicerAnswer) -> SlicerAnswer:
    """The answer with the figures in the file that was made."""
    weight = profile.density_g_cm3
    try:
        if made.suffix == ".sl1":
            archive = read_archive(made, profile.layer_mm)
            timed = archive.seconds if profile.exposure_s is not None else None
            answer = replace(
                answer,
                seconds=timed,
                material_mm3=archive.material_mm3,
                support_mm3=max(0.0, archive.material_mm3 - abs(mesh.volume_mm3)),
                layers=archive.layers,
                empty_layers_mm=archive.empty_layers_mm,
            )
        else:
            with made.open(encoding="utf-8", errors="replace") as lines:
                told = read_gcode(lines)
            answer = replace(
                answer,
                seconds=told.seconds,
                material_mm3=told.laid_mm3 if told.cm3 is None else 1000 * told.cm3,
                material_g=told.grams if weight is None and told.grams else None,
                support_mm3=told.support_mm3,
                laid_mm3=told.laid_mm3,
                layers=len(told.layers_mm) or None,
                empty_layers_mm=() if profile.slicer_command else told.empty_layers(profile.layer_mm),
            )
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        return SlicerAnswer(answer.program, error=f"what {answer.program} made cannot be read: {error}")
    if not answer.material_mm3 and profile.slicer_command:  # resin, or G-code in words of its own
        return replace(answer, material_mm3=None, support_mm3=None, laid_mm3=None, layers=None)
    if not answer.material_mm3:
        return SlicerAnswer(answer.program, sliced=False, error="nothing would be printed")
    if weight is not None:
        answer = replace(answer, material_g=weight * answer.material_mm3 / 1000)
    return answer


def _product(folder: Path, made: Path) -> Path | None:
    """What was made: the asked file, or any G-code in the folder, or that inside a 3MF."""
    if made.is_file():
        return made
    if plates := sorted(folder.rglob("*.gcode")):
        return plates[0]
    for package in sorted(folder.rglob("*.3mf")):
        with (
            contextlib.suppress(zipfile.BadZipFile, zlib.error, OSError),
            zipfile.ZipFile(package) as entries,
        ):
            for entry in entries.infolist():
                if entry.filename.endswith(".gcode") and entry.file_size <= _MOST_BYTES:
                    with entries.open(entry) as source, made.open("wb") as copy:
                        shutil.copyfileobj(source, copy)
                    return made
    return None


def _copy(made: Path, keep: Path) -> None:
    beside = keep.with_name(f".{keep.name}.part")
    try:
        keep.parent.mkdir(exist_ok=True)
        shutil.copyfile(made, beside)
        beside.replace(keep)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise InputError(f"cannot write {keep}: {error.strerror or error}", "Choose another path.") from error


def _lines(said: str) -> list[str]:
    """What it said, without its time stamps, traces and progress."""
    lines = (re.sub(r"^\[[-\d :.]+\]\s*\[\w+\]\s*", "", line.strip()) for line in said.splitlines())
    return [line for line in lines if line and "[trace]" not in line and not re.match(r"\d+\s*% ?=>", line)]


def _warnings(lines: list[str]) -> tuple[str, ...]:
    kept = [line for line in lines if re.search(r"warning|empty layer|detected", line, re.IGNORECASE)]
    return tuple(dict.fromkeys(line.removeprefix("print warning: ")[:300] for line in kept))[:10]


def _last_words(lines: list[str]) -> str:
    return re.sub(r"^(what\(\):\s*|\S*part\.stl:\s*)", "", lines[-1])[:300] if lines else ""


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def _turned(mesh: Mesh, degrees: float) -> Mesh:
    """Turned about z."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(mesh.vertices @ turn.T, mesh.faces)


def _stl(mesh: Mesh) -> bytes:
    """Binary STL: header, count, and for every face its normal, three corners and two empty bytes."""
    record = np.zeros(
        len(mesh.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")]
    )
    record["normal"], record["corners"] = mesh.face_normals, mesh.corners
    return b"fabcraft".ljust(80, b"\0") + np.uint32(len(record)).tobytes() + record.tobytes()
