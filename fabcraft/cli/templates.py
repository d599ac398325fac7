"""`fabcraft templates`: the kinds of wearable, what can be set of them, and how they sit on a body."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from fabcraft.cli.catalogue import PLAIN, listed, rounded, worded
from fabcraft.cli.console import painted, result, result_json, say, table
from fabcraft.cli.guidance import require_png, written_png, wrote
from fabcraft.cli.make import setting
from fabcraft.cli.own import NOTHING, OwnFlags
from fabcraft.cli.wearer import ANYBODY, Wearer
from fabcraft.errors import InputError
from fabcraft.template.kinds import KINDS, is_own, kind_of, known

if TYPE_CHECKING:
    from fabcraft.body.body import Body
    from fabcraft.fitting_room import Tried
    from fabcraft.template.own import OwnSettings

Repeated = Parameter(negative=(), show_default=False)

templates = App("templates", help="List the kinds of wearable, show one, or try them on a body.")
templates.default_parameter, templates.help_epilogue, templates.sort_key = PLAIN, "", 12


@templates.default
def list_templates(*, json: bool = False) -> int:
    """List the kinds of wearable.

    Parameters
    ----------
    json
        Print JSON.
    """
    if json:
        told = [
            {"template": name, "what": what, "parameters": _parameters(name)} for name, what in KINDS.items()
        ]
        result_json(told)
    else:
        result(table(list(KINDS.items())))
    return 0


@templates.command(name="show")
def show_template(
    name: str,
    /,
    *,
    body: str = "man",
    set: Annotated[tuple[str, ...], Repeated] = (),
    wearer: Wearer = ANYBODY,
    own: OwnFlags = NOTHING,
    json: bool = False,
) -> int:
    """Show what can be set of a template, and how it lies on a body before anything shapes it.

    Parameters
    ----------
    name
        A name from fabcraft templates, or the mesh file of your own one.
    body
        A name from fabcraft bodies, or the file of a scan.
    set
        A parameter as name=value, again for more.
    json
        Print JSON.
    """
    what = _what(name)
    _require_own([name], own)
    from fabcraft.fitting_room import plain

    template = plain(name, wearer.found(body), dict(map(setting, set)), own.settings())
    told: dict[str, Any] = {
        "template": name,
        "what": what,
        "parameters": _parameters(name, template.parameters),
        "body": template.body.name,
        "kind": template.kind,
        "faces": len(template.mesh.faces),
        "edge_mm": _two(template.edge_mm),
        "genus": template.genus,
        "size_mm": rounded(template.mesh.size_mm),
        "wall_mm": _two(template.wall_mm),
        "clearance_mm": dict(zip(("least", "usual"), map(_two, template.listed_mm), strict=True)),
        "rests_on": list(template.contacts),
        "frames": [
            {"name": one.name, "shows": one.reading, "size_mm": [_two(side) for side in one.size_mm]}
            for one in template.motifs
        ],
        "notes": [*template.notes, *template.body.notes],
    }
    if json:
        result_json(told)
        return 0
    rows = [
        (key.replace("_", " "), worded(told[key])) for key in told if key not in _APART and told[key] != []
    ]
    rows += [("clearance mm", f"{template.listed_mm[0]:.2f} at least, {template.listed_mm[1]:.2f} usually")]
    for one in template.motifs:
        rows.append((f"--as {one.reading}", f"{one.name}, {one.size_mm[0]:.0f} x {one.size_mm[1]:.0f} mm"))
    lines = [painted(f"{name}: {what}", "bold"), "", table(rows)]
    if told["parameters"]:
        lines += ["", listed([("--set", "here", "may be", "meaning"), *map(_row, told["parameters"])])]
    result("\n".join([*lines, *(["", *told["notes"]] if told["notes"] else [])]))
    return 0


@templates.command(name="check")
def check_templates(
    *names: str,
    body: Annotated[tuple[str, ...], Repeated] = ("man",),
    set: Annotated[tuple[str, ...], Repeated] = (),
    wearer: Wearer = ANYBODY,
    own: OwnFlags = NOTHING,
    contacts: str | None = None,
    picture: str | None = None,
    json: bool = False,
) -> int:
    """Build templates on a body, and measure what they promise: mesh, wall, clearance, and the way on.

    Parameters
    ----------
    names
        Names from fabcraft templates, or mesh files of your own; all of the built-in ones when left out.
    body
        A name from fabcraft bodies, or the file of a scan; again for more. [default: man]
    set
        A parameter as name=value, again for more; with one template only.
    contacts
        File of contacts, where it shall rest or keep away besides the template's own: .toml or .json.
    picture
        Also write a picture of all of them as they are worn (.png).
    json
        Print JSON.
    """
    chosen = list(names) or list(KINDS)
    for name in chosen:
        _what(name)
    _require_own(chosen, own)
    settings = dict(map(setting, set))
    if settings and len(chosen) != 1:
        raise InputError(f"--set was given for {len(chosen)} templates", "Name the one that it is for.")
    if settings and not is_own(chosen[0]):
        kind_of(chosen[0]).settled(settings)
    if picture is not None:
        require_png(picture, list(body))
    wearers = [wearer.found(name) for name in body]
    if contacts is not None:
        from fabcraft.body.contacts import read_contacts, with_contacts

        wanted = read_contacts(contacts)
        wearers = [with_contacts(one, wanted) for one in wearers]
    said = own.settings()
    tried = [[_tried(name, one, settings, said) for name in chosen] for one in wearers]
    told: list[dict[str, Any]] = [
        {"body": one.name, "templates": [row(*pair) for pair in zip(chosen, of_body, strict=True)]}
        for one, of_body in zip(wearers, tried, strict=True)
    ]
    if picture is not None:
        from fabcraft.write.wardrobe import wardrobe_picture

        shown = [
            [one if isinstance(one, str) else (one.template, one.object) for one in line] for line in tried
        ]
        image = wardrobe_picture(chosen, [one.name for one in wearers], shown)
        told[0]["files"] = written_png(picture, image)
    faults = [
        f"{name} on {who.name}: {fault}"
        for who, of_body in zip(wearers, tried, strict=True)
        for name, one in zip(chosen, of_body, strict=True)
        if not isinstance(one, str)
        for fault in one.faults
    ]
    if json:
        result_json(told[0] if len(told) == 1 else told)
    else:
        rows = [cells(of_body["body"], one) for of_body in told for one in of_body["templates"]]
        why = [
            f"{one['template']} on {of_body['body']}: not applicable, {one['why']}"
            for of_body in told
            for one in of_body["templates"]
            if not one["applicable"]
        ]
        bad = [painted("fail", "fail") + f" {text}" for text in faults]
        result("\n".join([listed([_HEADING, *rows]), *why, *bad, *wrote(told[0])]))
    return 1 if faults else 0


_APART = ("template", "what", "clearance_mm", "parameters", "frames", "notes")
_HEADING = ("template", "body", "faces", "genus", "tight", "crossing", "inside, mm", "clearance, mm", "wall, mm",
            "goes on", "seconds")  # fmt: skip


def row(name: str, tried: "Tried | str") -> dict[str, Any]:
    """One template on one body as JSON tells it; a string is the reason why it does not go on."""
    if isinstance(tried, str):
        return {"template": name, "applicable": False, "why": tried}
    told = {
        "template": name,
        "applicable": True,
        "why": "",
        "faces": tried.faces,
        "parts": tried.parts,
        "genus": tried.genus,
        "watertight": tried.watertight,
        "self_intersections": tried.self_intersections,
        "pen_max_mm": round(tried.pen_max_mm, 3),
        "clearance_min_mm": round(tried.clearance_min_mm, 3),
        "clearance_median_mm": round(tried.clearance_median_mm, 3),
        "clearance_listed_mm": [round(value, 3) for value in tried.template.listed_mm],
        "wall_min_mm": round(tried.wall_min_mm, 3),
        "wall_listed_mm": round(tried.template.wall_mm, 3),
        "donnable": tried.donning.donnable,
        "donning_pen_max_mm": round(tried.donning.pen_max_mm, 3),
        "donning_allowed_mm": round(tried.donning.allowed_mm, 3),
        "seconds": round(tried.seconds, 2),
        "faults": list(tried.faults),
    }
    if told["self_intersections"] is None:  # what was not measured is absent
        del told["self_intersections"]
    return told


def cells(body: str, one: Mapping[str, Any]) -> tuple[str, ...]:
    """The same as a line of a table."""
    if not one["applicable"]:
        return (one["template"], body, *["-"] * (len(_HEADING) - 2))
    least, usual = one["clearance_listed_mm"]
    return (
        one["template"],
        body,
        str(one["faces"]),
        str(one["genus"]) + (f", {one['parts']} parts" if one["parts"] > 1 else ""),
        worded(one["watertight"]),
        str(one.get("self_intersections", "?")),
        f"{one['pen_max_mm']:.2f}",
        f"{one['clearance_min_mm']:.2f}, median {one['clearance_median_mm']:.1f} (listed {least:.2f}, {usual:.1f})",
        f"{one['wall_min_mm']:.2f} (listed {one['wall_listed_mm']:.2f})",
        f"{worded(one['donnable'])}, presses {one['donning_pen_max_mm']:.2f} (may {one['donning_allowed_mm']:.2f})",
        f"{one['seconds']:.1f}",
    )


def _two(value: float) -> float:
    return round(float(value), 2)


def _what(name: str) -> str:
    """A template in a line.  Raises `InputError` for a name that is neither a template's nor a mesh file's."""
    if not is_own(name):
        return KINDS[known(name)]
    if not Path(name).is_file():
        raise InputError(f"there is no file {name}", f"Give a mesh file, or a template: {', '.join(KINDS)}.")
    return "a mesh of your own"


def _require_own(names: Sequence[str], own: OwnFlags) -> None:
    """Raise `InputError` when something is said of an own mesh, and another template is named."""
    if own.given() and not all(map(is_own, names)):
        raise InputError(
            f"{next(iter(own.given()))} was given for a built-in template",
            "It is for a mesh file of your own: name that file only.",
        )


def _tried(name: str, body: "Body", settings: Mapping[str, float | str], own: "OwnSettings") -> "Tried | str":
    """The template on the body, or why it does not go on; with a mesh of one's own that is an error."""
    from fabcraft.fitting_room import try_on

    say(f"trying the {name} on {body.name}")
    try:
        return try_on(name, body, settings, own)
    except InputError as error:
        if is_own(name):
            raise
        return error.message


def _parameters(name: str, here: Mapping[str, float] | None = None) -> list[dict[str, Any]]:
    """What can be set of a template, with the value that it has here."""
    told = []
    for one in () if is_own(name) else kind_of(name).parameters:
        entry: dict[str, Any] = {"name": one.name, "unit": one.unit, "meaning": one.meaning}
        if one.low < one.high:
            entry |= {"low": one.low, "high": one.high}
        if one.choices:
            entry["choices"] = list(one.choices)
        if here and one.name in here:
            entry["here"] = round(here[one.name], 2)
        told.append(entry)
    return told


def _row(one: Mapping[str, Any]) -> tuple[str, str, str, str]:
    """A parameter as a line of a table."""
    ways = [f"{one['low']:g} to {one['high']:g} {one['unit']}".rstrip()] if "low" in one else []
    return (one["name"], f"{one['here']:g}" if "here" in one else "", " or ".join([*ways, *one.get("choices", [])]),
            one["meaning"])  # fmt: skip
