"""The body that a recipe names: a person, a character, or a scan."""

from difflib import get_close_matches
from pathlib import Path

from fabcraft.body.body import Body
from fabcraft.body.character import CHARACTERS, character
from fabcraft.body.human import PRESETS, human
from fabcraft.errors import InputError


def find_body(name: str, units: str = "", height_mm: float = 0.0) -> Body:
    """The body called `name`, or the head scan in that file.

    height_mm : of a character; 0 is its own.  Raises `InputError` when there is neither, or the height is not for it.
    """
    path = Path(name)
    if name in CHARACTERS:
        return character(name, height_mm)
    if height_mm:
        raise InputError(
            f"a height of {height_mm:g} mm was asked for {name}, which is no character",
            f"Leave out --height, or choose a character: {', '.join(CHARACTERS)}.",
        )
    if name in PRESETS:
        return human(name)
    if path.suffix or path.exists():
        from fabcraft.body.scan import scan

        return scan(path, units or None)
    known = (*PRESETS, *CHARACTERS)
    close = get_close_matches(name, known, n=1)
    raise InputError(
        f"there is no body called {name!r}" + (f"; did you mean {close[0]}?" if close else ""),
        f"Choose one of: {', '.join(known)}; or give the path of a head scan.",
    )


def require_wearable(body: Body, template: str) -> None:
    """Raise `InputError` when `template` does not go on `body`, with the reason."""
    if template in body.unwearable:
        raise InputError(
            f"the {body.name} cannot wear a {template}: {body.unwearable[template]}",
            "Choose another template or another body (fabcraft bodies).",
        )
