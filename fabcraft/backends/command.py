"""`command:PROGRAM ... {input} ... {output}`: a program on this machine makes the mesh, or the picture.

It runs without a shell, in the folder where fabcraft runs, under a time limit, and its children go with it.
`{input}` is the picture (PNG), `{output}` the file to write, `{prompt}` the words, `{seed}` a number; what it prints is
told when it fails.
"""

import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from fabcraft.backends.answer import MESHES, PICTURES
from fabcraft.backends.backend import MESH_BYTES, PICTURE_BYTES, Answer, Request, Said, Terms
from fabcraft.errors import InputError, MissingError
from fabcraft.program import filled, run_program

_HEARD_BYTES = 4000


class _Command:
    """What both kinds of command have in common."""

    about: ClassVar[str] = ""
    usage: ClassVar[str] = ""
    endings: ClassVar[tuple[str, ...]] = ()
    most_bytes: ClassVar[int] = 0
    wanted: ClassVar[tuple[str, ...]] = ()
    """Places that the command must name."""

    def __init__(self, argument: str) -> None:
        try:
            self._words = shlex.split(argument)
        except ValueError as error:
            raise InputError(
                f"the command {argument[:200]!r} cannot be split into words: {error}", "Close its quotes."
            ) from None
        missing = [place for place in self.wanted if not any(place in word for word in self._words[1:])]
        if not self._words or missing:
            raise InputError(
                f"the command {argument[:200]!r} names no {' and no '.join(missing) or 'program'}",
                f"Give {self.usage}.",
            )
        if "\0" in argument:
            raise InputError("the command holds a NUL character", f"Give {self.usage}.")

    @classmethod
    def lacks(cls) -> MissingError | None:
        """Nothing that is known before the command is."""
        return None

    def terms(self, request: Request) -> Terms:
        """It is another program's code that runs; a recipe from elsewhere must not start it unseen."""
        return Terms((f"this runs on your machine: {shlex.join(self._words)}",), "unless typed")

    def key(self) -> Mapping[str, str]:
        """The whole command."""
        return {"command": shlex.join(self._words)}

    def make(self, request: Request, said: Said) -> Answer:
        """What the command wrote."""
        name = self._words[0]
        program = shutil.which(name)
        if program is None:
            raise MissingError(f"the program {name} was not found", "Install it, or give its whole path.")
        with tempfile.TemporaryDirectory(prefix="fabcraft-command-", ignore_cleanup_errors=True) as temporary:
            folder = Path(temporary)
            given, made = folder / "input.png", folder / f"output.{self.endings[0]}"
            given.write_bytes(request.picture)
            places = {
                "{input}": str(given),
                "{output}": str(made),
                "{prompt}": request.prompt,
                "{seed}": str(request.seed),
            }
            words = [str(Path(program).absolute()), *(filled(word, places) for word in self._words[1:])]
            try:
                code, printed = run_program(
                    words, request.timeout_s, heard_bytes=_HEARD_BYTES, watch=lambda: self._made(made)
                )
            except (OSError, ValueError) as error:  # ValueError: a NUL character in the words
                raise MissingError(f"{name} could not be started: {error}", "Check the command.") from None
            except subprocess.TimeoutExpired:
                raise MissingError(
                    f"{name} was not done within {request.timeout_s:g} s",
                    "Run it by hand and give what it makes.",
                ) from None
            heard = _last_line(printed)
            if code != 0:
                raise MissingError(
                    f"{name} stopped with code {code}{heard}", "Run the command by hand to see why."
                )
            found = self._made(made)
            if found is None:
                raise InputError(
                    f"{name} ended well but wrote no {made.name}{heard}", "Let it write to {output}."
                )
            return Answer(found.read_bytes(), found.name)

    def _made(self, made: Path) -> Path | None:
        """The file that was written.  Raises `InputError` when it grows too large."""
        for ending in self.endings:
            path = made.with_suffix(f".{ending}")
            if path.is_file() and not path.is_symlink():
                if (size := path.stat().st_size) > self.most_bytes:
                    raise InputError(
                        f"{self._words[0]} wrote {size:,} bytes; at most {self.most_bytes:,} are taken",
                        "Let it write less.",
                    )
                return path
        return None


class MeshCommand(_Command):
    """A mesh of a picture."""

    about = "a program on this machine; {output} ends in .glb, other endings beside it are found"
    usage = '"command:PROGRAM {input} {output}"'
    endings, most_bytes, wanted = MESHES, MESH_BYTES, ("{input}", "{output}")


class PictureCommand(_Command):
    """A picture of words."""

    about = "a program on this machine; {input} is the sketch, if there is one"
    usage = '"command:PROGRAM {prompt} {output}"'
    endings, most_bytes, wanted = PICTURES, PICTURE_BYTES, ("{prompt}", "{output}")


def _last_line(printed: str) -> str:
    """The last it printed, as an addition to a sentence."""
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    return ": " + "".join(c for c in lines[-1] if c.isprintable())[:300] if lines else ""
