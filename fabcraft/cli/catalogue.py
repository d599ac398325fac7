"""`fabcraft bodies`: who there is to wear things."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from cyclopts import App, Parameter

from fabcraft.cli.console import painted, result, result_json, table
from fabcraft.cli.guidance import require_png, written_png, wrote
from fabcraft.cli.wearer import ANYBODY, Wearer
from fabcraft.template.kinds import with_article

if TYPE_CHECKING:
    from fabcraft.body.body import Measured

PLAIN = Parameter(negative=(), show_default=False)
"""No --no-json beside --json; where a default matters the help names it."""

bodies = App("bodies", help="List the built-in bodies, or show one or a scan.")
bodies.default_parameter, bodies.help_epilogue, bodies.sort_key = PLAIN, "", 10


@bodies.default
def list_bodies(*, json: bool = False) -> int:
    """List the built-in bodies.

    Parameters
    ----------
    json
        Print JSON.
    """
    from fabcraft.body.character import CHARACTERS
    from fabcraft.body.human import PRESETS, WHO, human
    from fabcraft.body.measures import measured

    keys = ("height", "head", "neck", "wrist", "ring_finger", "foot")
    found = {name: measured(human(name), keys) for name in PRESETS}
    if json:
        people = [{"body": name, "measures": _reached(measures, {})} for name, measures in found.items()]
        characters = [
            {
                "body": one.name,
                "measures": _reached({"height": float(one.height_mm)}, {}),
                "unwearable": dict(one.unwearable),
            }
            for one in CHARACTERS.values()
        ]
        result_json([*people, *characters])
        return 0
    rows = [("name, mm", *(key.replace("_", " ") for key in keys), "who")]
    rows += [(name, *(f"{measures[key]:.0f}" for key in keys), WHO[name]) for name, measures in found.items()]
    figures = [("character", "height, mm", "what it is", "cannot wear")]
    figures += [
        (one.name, f"{one.height_mm:g}", one.title, ", ".join(one.unwearable) or "-")
        for one in CHARACTERS.values()
    ]
    more = (
        "One of other measures: fabcraft bodies show woman --measure wrist=160 --measure ring_finger=US7\n"
        "A character of another height: fabcraft bodies show dinosaur --height 1000\n"
        "A scan (STL, OBJ, PLY, GLB or 3MF) of a head, hand, foot or body is a body too: fabcraft bodies show scan.ply"
    )
    result(f"{listed(rows)}\n\n{listed(figures)}\n\n{more}")
    return 0


@bodies.command(name="show")
def show_body(
    body: str,
    /,
    *,
    wearer: Wearer = ANYBODY,
    contacts: str | None = None,
    picture: str | None = None,
    json: bool = False,
) -> int:
    """Show a body's measures and landmarks.

    Parameters
    ----------
    body
        man, woman, teenager, child, toddler, a character, or the file of a scan.
    contacts
        File of contacts (.toml, .json) to lay on the body: its regions then are shown, and its places checked.
    picture
        Also write a picture of its parts with landmarks, regions and measured lines (.png).
    json
        Print JSON.
    """
    if picture is not None:
        require_png(picture, [body])
    from fabcraft.body.measures import folded_hands, measured

    whole = wearer.found(body)
    if contacts is not None:
        from fabcraft.body.contacts import read_contacts, with_contacts

        whole = with_contacts(whole, read_contacts(contacts))
    measures = measured(whole) | folded_hands(whole)
    told: dict[str, Any] = {
        "body": whole.name,
        "kind": whole.kind,
        "size_mm": rounded(whole.mesh.size_mm),
        "measures": _reached(measures, whole.measures),
        "landmarks": {name: rounded(point) for name, point in whole.landmarks.items()},
        "regions": sorted(whole.regions),
        "unwearable": dict(whole.unwearable),
        "notes": list(whole.notes),
    }
    if picture is not None:
        from fabcraft.write.bodies import body_picture

        told["files"] = written_png(picture, body_picture(whole))
    if json:
        result_json(told)
        return 0
    lines = [
        painted(f"{whole.name}: {' x '.join(f'{side:.0f}' for side in told['size_mm'])} mm", "bold"),
        "",
    ]
    rows: list[tuple[str, ...]] = [("measure, mm", "asked", "reached")]
    for name, one in told["measures"].items():
        asked = (
            f"{one['asked']:.1f}" + (f" ({one['size']})" if "size" in one else "") if "asked" in one else ""
        )
        rows.append((name, asked, f"{one['reached']:.1f}"))
    lines += [listed(rows), ""]
    rows = [("landmark, mm", "x", "y", "z")]
    rows += [(name, *(f"{one:.1f}" for one in point)) for name, point in told["landmarks"].items()]
    cannot = [f"It cannot wear {with_article(name)}: {reason}." for name, reason in whole.unwearable.items()]
    lines += [listed(rows), *(["", *whole.notes, *cannot] if whole.notes or cannot else []), *wrote(told)]
    result("\n".join(lines))
    return 0


def listed(rows: Sequence[tuple[str, ...]]) -> str:
    """A table whose first row is its heading."""
    heading, _, rest = table(rows).partition("\n")
    return f"{painted(heading, 'dim')}\n{rest}"


def _reached(measures: Mapping[str, float], asked: "Mapping[str, Measured]") -> dict[str, dict[str, Any]]:
    """The measures as JSON tells them, the asked ones first."""
    told: dict[str, dict[str, Any]] = {}
    for name, one in asked.items():
        told[name] = {"asked": round(one.asked_mm, 2), "reached": round(one.reached_mm, 2), "unit": "mm"}
        if one.words:
            told[name]["size"] = one.words
    for name, value in measures.items():
        told.setdefault(name, {"reached": round(value, 2), "unit": "mm"})
    return told


def rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 2) for value in values]


def worded(value: Any) -> str:
    """A value as a person writes it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join("from {:g}: {:g}".format(*one) if isinstance(one, tuple) else one for one in value)
    if isinstance(value, list):
        return (" x " if all(isinstance(one, float) for one in value) else ", ").join(
            worded(one) for one in value
        )
    return f"{value:g}" if isinstance(value, float) else str(value)
