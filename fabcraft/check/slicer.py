"""A second opinion from PrusaSlicer, when it is there: what it reads, and whether and how it slices.

The slicer gets a flat ini made from the printer profile; nothing of it changes the object. "It slices" does
not mean "it prints" (a 0.2 mm wall is silently widened), so this adds facts and never overrules the other
checks. Runs without a shell, in its own temporary folder, under a time limit. Exit codes seen with 2.5: 0
done, 1 cannot load or cannot make paths, 134 does not fit the bed or has no volume.
"""

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fabcraft.check.report import Finding
from fabcraft.mesh import Mesh
from fabcraft.profile import PrinterProfile

PROGRAM = "prusa-slicer"
_FILAMENT_MM = 1.75


@dataclass(frozen=True)
class SlicerAnswer:
    """What the slicer said; what it did not say is None."""

    available: bool
    info: dict[str, str] = field(default_factory=dict)
    """`--info` as it stands: `manifold`, `open_edges`, `number_of_parts`, `volume`, ..."""
    sliced: bool | None = None
    """Whether it made a file; None when it was not asked to."""
    seconds: float | None = None
    """Estimated printing time."""
    filament_cm3: float | None = None
    """Material that goes through the nozzle, supports included."""
    warnings: tuple[str, ...] = ()
    error: str = ""
    """Why it gave no answer."""


def ask_slicer(
    mesh: Mesh,
    profile: PrinterProfile,
    slice_it: bool = False,
    supports: bool = True,
    timeout_s: float = 120.0,
    program: str = PROGRAM,
) -> SlicerAnswer:
    """Ask `program` about a mesh; slicing takes seconds to minutes: only on request, and only for fdm."""
    path = shutil.which(program)
    if path is None:
        return SlicerAnswer(available=False)
    with tempfile.TemporaryDirectory(prefix="fabcraft-slicer-") as name:
        folder = Path(name)
        part = folder / "part.stl"
        part.write_bytes(_stl(mesh))
        try:
            told = _run([path, "--info", str(part)], folder, timeout_s)
            info = _info(told.stdout)
            if not slice_it or profile.process != "fdm":
                return SlicerAnswer(available=True, info=info, error=_failure(told))
            ini = folder / "printer.ini"
            ini.write_text(slicer_ini(profile, supports), encoding="utf-8")
            made = folder / "part.gcode"
            command = [path, "--export-gcode", "--load", str(ini), "--loglevel", "2", "--output", str(made)]
            done = _run([*command, str(part)], folder, timeout_s)
        except (OSError, subprocess.TimeoutExpired) as error:
            late = isinstance(error, subprocess.TimeoutExpired)
            why = f"no answer within {timeout_s:g} s" if late else f"could not be started: {error}"
            return SlicerAnswer(available=True, error=why)
        return _sliced(info, done, made)


def slicer_findings(answer: SlicerAnswer, profile: PrinterProfile) -> list[Finding]:
    """The slicer's view: a note when it is absent or silent, a failure only when it refuses to slice."""
    if not answer.available:
        return [Finding(check="slicer", severity="note", advice=f"{PROGRAM} is not installed; not asked.")]
    if answer.sliced is False:
        advice = f"The slicer refuses it: {answer.error}"
        return [Finding(check="slicer", severity="fail", value=False, limit=True, advice=advice)]
    found = []
    if answer.error:
        found.append(
            Finding(check="slicer", severity="note", advice=f"The slicer gave no answer: {answer.error}")
        )
    for warning in answer.warnings:
        found.append(Finding(check="slicer", severity="warn", advice=f"The slicer says: {warning}"))
    if answer.sliced and answer.seconds is not None and answer.filament_cm3 is not None:
        advice = f"Slices for the {profile.name}: {answer.filament_cm3:.1f} cm³, {_duration(answer.seconds)}."
        found.append(Finding(check="slicer", severity="note", value=True, advice=advice))
    return found


def slicer_ini(profile: PrinterProfile, supports: bool = True) -> str:
    """A flat PrusaSlicer configuration with what the profile knows; the rest is the slicer's default."""
    x, y, z = (f"{side:g}" for side in profile.build_mm)
    bead = 1.125 * profile.nozzle_mm
    lines = {
        "printer_technology": "FFF",
        "gcode_flavor": "marlin",
        "bed_shape": f"0x0,{x}x0,{x}x{y},0x{y}",
        "max_print_height": z,
        "nozzle_diameter": f"{profile.nozzle_mm:g}",
        "filament_diameter": f"{_FILAMENT_MM:g}",
        "layer_height": f"{profile.layer_mm:g}",
        "first_layer_height": f"{profile.layer_mm:g}",
        "extrusion_width": f"{bead:g}",
        "perimeters": str(max(2, round(profile.wall_mm / bead))),
        "fill_density": "15%",
        "temperature": "215",
        "bed_temperature": "60",
        "support_material": str(int(supports)),
        "support_material_threshold": f"{90 - profile.max_overhang_deg:g}",
        "use_relative_e_distances": "0",
    }
    return "".join(f"{key} = {value}\n" for key, value in lines.items())


def _run(command: list[str], folder: Path, timeout_s: float) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=timeout_s,
        check=False,
    )


def _info(text: str) -> dict[str, str]:
    return {key: value.strip() for key, value in re.findall(r"^(\w+) = (.*)$", text, re.MULTILINE)}


def _failure(done: subprocess.CompletedProcess[str]) -> str:
    """Why a run failed, in the slicer's last words; empty when it did not."""
    if done.returncode == 0:
        return ""
    said = _lines(done)
    if not said:
        return f"it stopped with code {done.returncode}"
    return re.sub(r"^(what\(\):\s*|\S*part\.stl:\s*)", "", said[-1])


def _lines(done: subprocess.CompletedProcess[str]) -> list[str]:
    """What it printed, without its time stamps and traces."""
    lines = (line.strip() for line in (done.stdout + "\n" + done.stderr).splitlines())
    lines = (re.sub(r"^\[[-\d :.]+\]\s*\[\w+\]\s*", "", line) for line in lines if "[trace]" not in line)
    return [line for line in lines if line and " = " not in line]


def _sliced(info: dict[str, str], done: subprocess.CompletedProcess[str], made: Path) -> SlicerAnswer:
    if done.returncode != 0 or not made.is_file():
        return SlicerAnswer(
            available=True, info=info, sliced=False, error=_failure(done) or "it made no file"
        )
    tail = made.read_text(encoding="utf-8", errors="replace")
    volume = re.search(r"^; filament used \[cm3\] = ([\d.]+)", tail, re.MULTILINE)
    time = re.search(r"^; estimated printing time \(normal mode\) = (.+)$", tail, re.MULTILINE)
    said = tuple(
        dict.fromkeys(line for line in _lines(done) if re.search(r"warning|empty layer|detected", line, re.I))
    )
    return SlicerAnswer(
        available=True,
        info=info,
        sliced=True,
        seconds=_seconds(time[1]) if time else None,
        filament_cm3=float(volume[1]) if volume else None,
        warnings=said,
    )


def _seconds(text: str) -> float:
    """ "1d 2h 3m 4s" as seconds."""
    unit = {"d": 86400, "h": 3600, "m": 60, "s": 1}
    return float(sum(int(number) * unit[letter] for number, letter in re.findall(r"(\d+)([dhms])", text)))


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def _stl(mesh: Mesh) -> bytes:
    """Binary STL: header, count, and for every face its normal, three corners and two empty bytes."""
    record = np.zeros(
        len(mesh.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("pad", "<u2")]
    )
    record["normal"], record["corners"] = mesh.face_normals, mesh.corners
    return b"fabcraft".ljust(80, b"\0") + np.uint32(len(record)).tobytes() + record.tobytes()
