"""One offline HTML page with the table, the comparison and every figure; it loads nothing and runs nothing."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any

from fabcraft.evaluate.figures import Figure
from fabcraft.evaluate.study import safe
from fabcraft.evaluate.suite import WORDS
from fabcraft.evaluate.table import COLUMNS, Row, written

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #262a30; background: #fafafb; margin: 0; }
main { max-width: 1500px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 26px; margin: 0; } h2 { font-size: 19px; margin: 36px 0 4px; }
p { margin: 4px 0 12px; max-width: 80ch; color: #525964; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; background: #fff; font-variant-numeric: tabular-nums; }
th, td { padding: 7px 12px; border-bottom: 1px solid #e4e7eb; text-align: right; vertical-align: bottom; }
td { white-space: nowrap; }
th { font-weight: 600; font-size: 13px; } td:first-child, th:first-child { text-align: left; white-space: nowrap; }
tr.ours td { background: #eaf2fb; font-weight: 600; }
td.note { text-align: left; white-space: normal; color: #8a5a00; font-weight: 400; }
img { max-width: 100%; border: 1px solid #e4e7eb; border-radius: 8px; background: #fff; }
.why { color: #8a5a00; } dt { font-weight: 600; } dd { margin: 0 0 6px; }
"""
_TIMES = {"pen_rms_mm": "depth", "pen_volume_mm3": "volume inside", "contact_rms_mm": "contact distance"}
_LIKE = {"silhouette_iou": "silhouette IoU over 24 views", "drawing_iou": "IoU in the drawing's own picture"}


def page_html(
    rows: Sequence[Row],
    compared: Mapping[str, float],
    designs: Sequence[Sequence[str]],
    figures: Sequence[Figure],
    pngs: Mapping[str, bytes],
    manifest: Mapping[str, Any],
) -> str:
    """The page.  designs : lines of `by_design`.  pngs : the figures' pictures by name."""
    heads = _heads(("method", "designs", *(one[1] for one in COLUMNS)))
    body = [
        "<h1>Comparison of methods</h1>",
        f"<p>fabcraft {safe(str(manifest['version']))}, preset {safe(str(manifest['preset']))}, seed {manifest['seed']}: "
        f"{manifest['cells']} cells. Means over the designs; “deepest” is the worst of all. – was not measured.</p>",
        f'<div class="wide"><table><thead><tr>{heads}</tr></thead><tbody>{"".join(map(_row, rows))}</tbody></table></div>',
        _compared(compared),
        _designs(designs),
        *(_figure(one, pngs.get(one.name)) for one in figures),
        "<h2>Manifest</h2><dl>",
        *(f"<dt>{safe(str(name))}</dt><dd>{safe(str(value))}</dd>" for name, value in manifest.items()),
        "</dl>",
    ]
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    return (
        '<!doctype html>\n<html lang="en"><meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>fabcraft: comparison of methods</title>\n<style>{_STYLE}</style>\n<main>\n"
        + "\n".join(body)
        + "\n</main></html>\n"
    )


def _heads(texts: Sequence[str]) -> str:
    """Headings; an arrow stays with its word."""
    return "".join(
        f"<th>{safe(text).replace(' ↑', '&nbsp;↑').replace(' ↓', '&nbsp;↓')}</th>" for text in texts
    )


def _designs(lines: Sequence[Sequence[str]]) -> str:
    if len(lines) < 2:
        return ""
    body = "".join(
        "<tr>" + "".join(f"<td>{safe(text)}</td>" for text in line) + "</tr>" for line in lines[1:]
    )
    return (
        "<h2>Design by design</h2><p>Ours / no body loss.</p>"
        f'<div class="wide"><table><thead><tr>{_heads(lines[0])}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _row(row: Row) -> str:
    if not row.numbers:
        text = f'<td class="note" colspan="{len(COLUMNS) + 1}">{safe(row.note)}</td>'
        return f"<tr><td>{safe(WORDS[row.method])}</td>{text}</tr>"
    cells = "".join(f"<td>{safe(text)}</td>" for text in written(row))
    note = ""
    if row.note:
        note = f'<tr><td></td><td class="note" colspan="{len(COLUMNS) + 1}">{safe(row.note)}</td></tr>'
    return f'<tr class="{"ours" if row.method == "ours" else ""}">{cells}</tr>{note}'


def _compared(compared: Mapping[str, float]) -> str:
    """Ours against no body loss, in a sentence."""
    if not compared.get("designs"):
        return ""
    times = [
        f"{words} {compared[key]:.3g} times smaller"
        for name, words in _TIMES.items()
        if (key := f"{name}_times_smaller") in compared
    ]
    said = [
        *times,
        f"deepest place {compared['pen_max_mm_ours']:.3f} mm",
        *(
            f"{words} {'lower' if compared[key] >= 0.0 else 'higher'} by {abs(compared[key]):.3f}"
            for name, words in _LIKE.items()
            if (key := f"{name}_lost") in compared
        ),
    ]
    count = f"{compared['designs']:.0f} design" + ("" if compared["designs"] == 1.0 else "s")
    return f"<p>Ours against no body loss, {count}: {safe('; '.join(said))}.</p>"


def _figure(figure: Figure, png: bytes | None) -> str:
    head = f"<h2>{safe(figure.title)}</h2><p>{safe(figure.caption)}</p>"
    if png is None:
        return f'{head}<p class="why">Not there: {safe(figure.why)}</p>'
    source = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    return f'{head}<img src="{source}" alt="{safe(figure.title)}">'
