"""One HTML page that says everything about a design: verdict, findings, numbers, pictures, recipe and a 3D
view.

Complete in itself: no network, no external address (a content security policy forbids both, and admits only
the page's own script by its hash). Everything that came from a user is escaped. Equal input gives equal
bytes.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fabcraft import __version__
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.write.atomic import write_atomically
from fabcraft.write.viewer import scene_data

_UNITS = {"mm": "mm", "mm2": "mm²", "mm3": "mm³", "deg": "°"}
_BADGES: dict[Any, tuple[str, str]] = {
    True: ("good", "Printable"),
    False: ("fail", "Not printable"),
    None: ("note", "Not checked"),
}


def write_page(
    path: str | Path,
    report: Mapping[str, Any],
    object: Mesh,
    body: Mesh | None = None,
    thickness: Float[np.ndarray, " V"] | None = None,
    clearance: Float[np.ndarray, " V"] | None = None,
    pictures: Mapping[str, bytes] | None = None,
    title: str = "",
    recipe: str | None = None,
    *,
    wall_mm: float | None = None,
) -> Path:
    """Write the page to `path` (whole or not at all); returns the path.

    report : `PrintReport.to_dict()`, what `--json` prints; any key may be absent.
    object, body : mm; the 3D view shows decimated copies.
    thickness : (V,) wall at the object's vertices, mm.  wall_mm : the wall asked for, the middle of that
    map's scale.
    clearance : (V,) signed distance of the object's vertices to the body, mm, positive outside.
    pictures : PNG bytes by caption.  recipe : TOML text.

    Raises `InputError` when the place cannot be written to or a per-vertex array has another length than
    the object.
    """
    for name, values in (("thickness", thickness), ("clearance", clearance)):
        if values is not None and len(values) != len(object.vertices):
            raise InputError(
                f"{name} has {len(values)} values for {len(object.vertices)} vertices",
                "Measure the mesh that is shown.",
            )
    page = page_html(
        report,
        scene_data(object, body, thickness, clearance, wall_mm),
        pictures or {},
        title or object.name or Path(path).stem,
        recipe,
    )
    return write_atomically(path, page.encode("utf-8", "replace"))


def page_html(
    report: Mapping[str, Any],
    scene: Mapping[str, Any],
    pictures: Mapping[str, bytes],
    title: str,
    recipe: str | None,
) -> str:
    """The page's text; `scene` from `fabcraft.write.viewer.scene_data`."""
    room = files("fabcraft.write")
    script = room.joinpath("viewer.js").read_text("utf-8")
    badge_class, badge = _BADGES.get(report.get("printable"), _BADGES[None])
    sections = [
        _findings(report.get("findings", ())),
        _pictures(pictures),
        '<div class="columns">',
        _table("Measured", report.get("metrics", {})),
        _table("How it was made", _as_mapping(report.get("route", {}))),
        _table("Time and memory", _costs(report)),
        _table("Files", _as_mapping(report.get("files", {}))),
        "</div>",
        f"<h2>Recipe</h2><pre>{_safe(recipe)}</pre>" if recipe else "",
    ]
    parts = {
        "title": _safe(title),
        "version": _safe(__version__),
        "badge_class": badge_class,
        "badge": badge,
        "verdict": _safe(report.get("verdict", "")),
        "sections": "\n".join(part for part in sections if part),
        # Inside a script element only "<" can end it; JSON allows it to be written as an escape.
        "scene": json.dumps(scene, separators=(",", ":")).replace("<", "\\u003c"),
        "script": script,
        "script_hash": "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
    }
    # One pass: what is filled in is never searched for further marks.
    template = room.joinpath("page_template.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda mark: parts[mark[1]], template)


def _findings(findings: Sequence[Mapping[str, Any]]) -> str:
    """The table of findings, worst first."""
    if not findings:
        return ""
    rank = {"fail": 0, "warn": 1, "note": 2}
    rows = []
    for finding in sorted(findings, key=lambda finding: rank.get(str(finding.get("severity")), 3)):
        severity = str(finding.get("severity", "note"))
        kind = severity if severity in rank else "note"
        unit = str(finding.get("unit") or "")
        rows.append(
            f'<tr><td><span class="badge {kind}">{_safe(severity)}</span></td>'
            f"<td>{_safe(_words(str(finding.get('check', ''))))}</td>"
            f'<td class="number">{_safe(_shown(finding.get("value"), unit))}</td>'
            f'<td class="number">{_safe(_shown(finding.get("limit"), unit))}</td>'
            f"<td>{_safe(_places(finding.get('where')))}</td><td>{_safe(_shown(finding.get('advice')))}</td></tr>"
        )
    heads = (
        "<th></th><th>Check</th>"
        '<th class="number">Value</th><th class="number">Limit</th><th>Where</th><th>What to do</th>'
    )
    return (
        f'<h2>Findings</h2><div class="wide"><table><thead><tr>{heads}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _costs(report: Mapping[str, Any]) -> dict[str, str]:
    """Seconds of every stage and the largest memory, as text."""
    costs = {name: _shown(value, "s") for name, value in report.get("seconds", {}).items()}
    memory = report.get("peak_memory_bytes")
    return costs | ({} if memory is None else {"peak memory": _shown(round(memory / 1e6), "MB")})


def _table(heading: str, entries: Mapping[str, Any]) -> str:
    """Names and values, units read off the names (wall_min_mm); nothing for nothing."""
    rows = []
    for name, value in entries.items():
        stem, _, ending = str(name).rpartition("_")
        known = bool(stem) and ending in _UNITS
        label, own = (stem, _UNITS[ending]) if known else (str(name), "")
        if ending == "share" and isinstance(value, int | float):
            label, own, value = stem or label, "%", 100.0 * value
        kind = "words" if isinstance(value, str) and not value[:1].isdigit() else "number"
        shown = _safe(_shown(value, own))
        rows.append(f'<tr><th>{_safe(_words(label))}</th><td class="{kind}">{shown}</td></tr>')
    if not rows:
        return ""
    return f"<section><h2>{heading}</h2><table><tbody>{''.join(rows)}</tbody></table></section>"


def _pictures(pictures: Mapping[str, bytes]) -> str:
    """Every picture, embedded, with its caption."""
    figures = []
    for caption, png in pictures.items():
        source = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
        words = _safe(_words(caption))
        image = f'<img src="{source}" alt="{words}" loading="lazy">'
        strip = ' class="strip"' if _is_strip(png) else ""
        figures.append(f"<figure{strip}>{image}<figcaption>{words}</figcaption></figure>")
    return f'<h2>Pictures</h2><div class="pictures">{"".join(figures)}</div>' if figures else ""


def _is_strip(png: bytes) -> bool:
    """Whether a picture is so wide that it needs a row of its own (width and height in the PNG's header)."""
    return int.from_bytes(png[16:20], "big") > 2 * int.from_bytes(png[20:24], "big")


def _shown(value: Any, unit: str = "") -> str:
    """A value as a person writes it."""
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        text = f"{value:.4g}" if abs(float(value)) < 1e4 else f"{value:,.0f}"
    elif isinstance(value, int | np.integer):
        text = f"{value:,}"
    elif isinstance(value, Mapping):
        return ", ".join(f"{_words(str(name))}: {_shown(part)}" for name, part in value.items())
    elif isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes):
        numbers = len(value) > 1 and all(isinstance(part, int | float | np.number) for part in value)
        text = (" × " if numbers and unit else ", ").join(_shown(part) for part in value)
    else:
        return str(value)
    return f"{text} {unit}".strip()


def _places(where: Any) -> str:
    """The worst three places, mm, and how many more; words stay as they are."""
    listed = isinstance(where, Sequence) and not isinstance(where, str | bytes)
    if not listed or not all(isinstance(place, Sequence) and not isinstance(place, str) for place in where):
        return _shown(where)
    text = "; ".join("(" + ", ".join(f"{float(part):.1f}" for part in place) + ")" for place in where[:3])
    return text + (f" and {len(where) - 3} more" if len(where) > 3 else "")


def _as_mapping(value: Any) -> Mapping[str, Any]:
    """A mapping as it is; a list numbered; one thing alone under a plain word."""
    if isinstance(value, Mapping):
        return value
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return {str(index + 1): part for index, part in enumerate(value)}
    return {"route": value} if value else {}


def _words(name: str) -> str:
    """`wall_min` as "wall min"."""
    return name.replace("_", " ")


def _safe(value: Any) -> str:
    """Text that cannot become markup, in an element or in a quoted attribute."""
    return html.escape(str(value), quote=True)
