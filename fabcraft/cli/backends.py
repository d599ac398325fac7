"""`fabcraft backends`: what makes pictures of words and meshes of pictures, and the question before a call."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from cyclopts import App

from fabcraft.cli.catalogue import PLAIN
from fabcraft.cli.console import is_terminal, result, result_json, say, table
from fabcraft.errors import InputError

if TYPE_CHECKING:
    from fabcraft.backends.ask import Consent
    from fabcraft.backends.backend import Terms
    from fabcraft.backends.registry import Group

backends = App("backends", help="List what makes pictures of words and meshes of pictures.")
backends.default_parameter, backends.help_epilogue, backends.sort_key = PLAIN, "", 14


@backends.default
def list_backends(*, json: bool = False) -> int:
    """List the back ends, and which of them can be used on this machine.  Calls none of them.

    Parameters
    ----------
    json
        Print JSON.
    """
    from fabcraft.backends.cache import folder
    from fabcraft.backends.registry import listed

    found = listed()
    if json:
        told = [
            {
                "for": one.group,
                "name": one.name,
                "about": one.about,
                "usage": one.usage,
                "here": not one.lacks,
                "lacks": one.lacks,
                "next_step": one.next_step,
            }
            for one in found
        ]
        result_json({"backends": told, "cache": str(folder())})
        return 0
    lines = []
    for group, title in (("image_to_3d", "--image-to-3d"), ("text_to_image", "--text-to-image")):
        rows = [(title, "here", "about")]
        rows += [(one.usage, "no" if one.lacks else "yes", one.about) for one in found if one.group == group]
        lines += [table(rows), ""]
    lines += [f"{one.name}: {one.lacks}\n  {one.next_step}" for one in found if one.lacks]
    result("\n".join([*lines, f"What they answer is kept in {folder()}"]))
    return 0


@backends.command
def clear() -> int:
    """Delete the answers that are kept."""
    from fabcraft.backends.cache import cleared, folder

    count = cleared()
    result(f"deleted {count} file{'' if count == 1 else 's'} from {folder()}")
    return 0


def consent(
    yes: bool, typed: frozenset[str], paused: Callable[[], AbstractContextManager[None]]
) -> "Consent":
    """What the person at the terminal agrees to: told on stderr, asked where an answer can come from.

    yes : --yes was given.  typed : the keys of back ends that the command line itself named.
    paused : the progress, put aside for the time of a question.
    """

    def asked(group: "Group", name: str, terms: "Terms") -> None:
        with paused():
            for sentence in terms.said:
                say(f"{name}: {sentence}")
            if yes or terms.ask == "never" or (terms.ask == "unless typed" and group in typed):
                return
            if not (is_terminal(sys.stdin) and is_terminal(sys.stderr)):
                raise InputError(
                    f"the back end {name} needs a yes, and nobody can be asked", "Give --yes to go on."
                )
            say("go on? [y/N]")
            if sys.stdin.readline(100).strip().lower() not in ("y", "yes"):
                raise InputError(f"the back end {name} was not called", "Give another one, or none.")

    return asked
