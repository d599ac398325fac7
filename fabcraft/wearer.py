"""The body that a recipe names: a person, a character, or a scan."""

import tempfile
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path

from fabcraft.body.body import Body
from fabcraft.body.character import CHARACTERS, character
from fabcraft.body.human import PRESETS, human
from fabcraft.errors import InputError
from fabcraft.recipe import Recipe
from fabcraft.template.kinds import with_article


def find_body(
    name: str,
    units: str = "",
    height_mm: float = 0.0,
    measures: Mapping[str, str | float | int] | None = None,
    **scanned: str,
) -> Body:
    """The body called `name`, or the scan in that file.

    height_mm : of a character; 0 is its own.  measures : of a person, mm or sizes.
    scanned : what else is known of a scan, by the names of `ScanSettings`: kind, up, front, landmarks.
    Raises `InputError` when there is neither, and for what does not belong to that body.
    """
    path = Path(name)
    is_file = name not in (*PRESETS, *CHARACTERS) and bool(path.suffix or path.exists())
    if height_mm and name not in CHARACTERS:
        raise InputError(
            f"a height of {height_mm:g} mm was asked for {name}, which is no character",
            "People have it as a measure: --measure height=1700; scans have their own.",
        )
    if measures and (is_file or name in CHARACTERS):
        kind = "a scan, which has its own" if is_file else "a character: its height decides (--height)"
        raise InputError(
            f"measures were given ({', '.join(measures)}), but {path.name} is {kind}",
            f"Leave them out, or give one of {', '.join(PRESETS)} as the body.",
        )
    if name in CHARACTERS:
        return character(name, height_mm)
    if name in PRESETS:
        return human(name, measures)
    if is_file:
        known = {key: value for key, value in scanned.items() if value}
        return _scanned(path, {"units": units, **known})
    known_names = (*PRESETS, *CHARACTERS)
    close = get_close_matches(name, known_names, n=1)
    raise InputError(
        f"there is no body called {name!r}" + (f"; did you mean {close[0]}?" if close else ""),
        f"Choose one of: {', '.join(known_names)}; or give the path of a scan.",
    )


def _scanned(path: Path, known: Mapping[str, str]) -> Body:
    """The scan in a file; where nobody is found in it, the error names a picture of what was."""
    from fabcraft.body.scan import NotFoundError, ScanSettings, scan

    try:
        return scan(path, ScanSettings(**known))
    except NotFoundError as error:
        from fabcraft.write.atomic import write_atomically
        from fabcraft.write.bodies import body_picture
        from fabcraft.write.picture import png_bytes

        place = Path(tempfile.mkdtemp(prefix="fabcraft-")) / f"{path.stem}-found.png"
        write_atomically(place, png_bytes(body_picture(error.found)))
        raise InputError(f"{error.message}; a picture of what was found: {place}", error.next_step) from None


def body_of(recipe: Recipe) -> Body:
    """The body that `recipe` is for."""
    return find_body(
        recipe.body,
        recipe.body_units,
        recipe.height_mm,
        recipe.measures,
        kind=recipe.body_kind,
        up=recipe.body_up,
        front=recipe.body_front,
        landmarks=recipe.body_landmarks,
    )


def require_wearable(body: Body, template: str) -> None:
    """Raise `InputError` when `template` does not go on `body`, with the reason."""
    if template in body.unwearable:
        raise InputError(
            f"the {body.name} cannot wear {with_article(template)}: {body.unwearable[template]}",
            "Choose another template or another body (fabcraft bodies).",
        )
