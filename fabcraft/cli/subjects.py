"""`fabcraft subjects`: the library of line drawings that words are made of."""

from typing import TYPE_CHECKING, Any

from fabcraft.cli.console import painted, result, result_json, table
from fabcraft.cli.guidance import require_png, written_png, wrote

if TYPE_CHECKING:
    from fabcraft.guidance.subjects.library import Subject


def subjects(name: str = "", /, *, picture: str | None = None, json: bool = False) -> int:
    """List the drawings that --text knows, or show one.

    Examples:

      fabcraft subjects
      fabcraft subjects --picture gallery.png
      fabcraft subjects "a cat with a star" --picture cat.png

    Parameters
    ----------
    name
        A subject, another word for it, or words that --text could be given; of a whole object, as in "heart glasses".
    picture
        Also write a picture: of the one drawing, large, or a contact sheet of all (.png).
    json
        Print JSON.
    """
    if picture is not None:
        require_png(picture, [])
    told = _one(name, picture) if name else _all(picture)
    lines = told.pop("lines")
    if json:
        result_json(told)
        return 0
    result("\n".join([*lines, *wrote(told)]))
    return 0


def _all(picture: str | None) -> dict[str, Any]:
    from fabcraft.guidance.subjects.library import THEMES, drawing_of, objects
    from fabcraft.guidance.subjects.library import subjects as library

    known, whole = library(), objects()
    by_theme = {theme: [one for one in known.values() if one.theme == theme] for theme in THEMES}
    rows = [(theme, ", ".join(one.name for one in found)) for theme, found in by_theme.items()]
    rows.append(("objects", ", ".join(whole)))
    told: dict[str, Any] = {"subjects": [_told(one) for one in known.values()], "objects": list(whole)}
    heading = f"{len(known)} subjects, and {len(whole)} whole objects for --as object"
    told["lines"] = [painted(heading, "bold"), "", *_wrapped(rows)]
    if picture is not None:
        from fabcraft.write.gallery import gallery

        drawn = [(one.name, one.theme, drawing_of(one)) for one in (*known.values(), *whole.values())]
        told["files"] = written_png(picture, gallery(drawn))
    return told


def _one(name: str, picture: str | None) -> dict[str, Any]:
    from fabcraft.guidance.subjects.compose import composed
    from fabcraft.guidance.subjects.library import drawing_of, objects
    from fabcraft.guidance.subjects.library import subjects as library
    from fabcraft.guidance.subjects.words import plain, wish_of

    if whole := objects().get(plain(name)):
        notes: tuple[str, ...] = ()
        shown, drawing = whole, drawing_of(whole)
        told = _told(whole)
    else:
        wish = wish_of(name, library())
        shown, notes = wish.subject, wish.notes
        drawing = composed(wish, template="")
        told = _told(shown) | {"subject": wish.words}
    told |= {"eyes": len(drawing.eyes), "holes": len(drawing.holes), "regions": len(drawing.regions),
             "strokes": len(drawing.strokes), "notes": list(notes)}  # fmt: skip
    rows = [(key.replace("_", " "), _worded(value)) for key, value in told.items() if value not in ([], "")]
    told["lines"] = [painted(told["subject"], "bold"), "", table(rows[1:])]
    if picture is not None:
        from fabcraft.write.gallery import portrait

        told["files"] = written_png(picture, portrait(drawing, shown.theme))
    return told


def _told(subject: "Subject") -> dict[str, Any]:
    return {
        "subject": subject.name,
        "theme": subject.theme,
        "words": list(subject.words),
        "face": subject.face and subject.theme != "objects",
    }


def _worded(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return ", ".join(value) if isinstance(value, list) else str(value)


def _wrapped(rows: list[tuple[str, str]], width: int = 100) -> list[str]:
    """Two columns, the second broken into lines."""
    import textwrap

    indent = max(len(theme) for theme, _ in rows) + 2
    told = []
    for theme, names in rows:
        first, *more = textwrap.wrap(names, width - indent)
        told += [f"{theme:<{indent}}{first}", *(" " * indent + line for line in more)]
    return told
