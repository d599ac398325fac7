"""`file:MESH`: the picture has been made a mesh by other means already."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from fabcraft.backends.backend import MESH_BYTES, Answer, Request, Said, Terms
from fabcraft.errors import InputError, MissingError


class File:
    """A mesh file that lies on this machine."""

    about: ClassVar[str] = "a mesh that another program made; the same as --guidance"
    usage: ClassVar[str] = "file:MESH"

    def __init__(self, argument: str) -> None:
        if not argument:
            raise InputError(
                "the back end file was given without a file", "Give file:MESH, for example file:cat.glb."
            )
        path = Path(argument)
        try:
            if not path.is_file():
                raise InputError(f"there is no file {path}", "Check the path.")
            if path.stat().st_size > MESH_BYTES:
                raise InputError(
                    f"{path} has {path.stat().st_size:,} bytes; at most {MESH_BYTES:,} are taken",
                    "Simplify it.",
                )
            self._answer = Answer(path.read_bytes(), path.name)
        except (OSError, ValueError) as error:
            raise InputError(
                f"{argument} cannot be read: {error}", "Check the path and its permissions."
            ) from None

    @classmethod
    def lacks(cls) -> MissingError | None:
        """Nothing."""
        return None

    def terms(self, request: Request) -> Terms:
        """Nothing leaves this machine."""
        return Terms()

    def key(self) -> Mapping[str, str]:
        """The file's content."""
        return {"sha256": hashlib.sha256(self._answer.data).hexdigest()}

    def make(self, request: Request, said: Said) -> Answer:
        """The file as it is."""
        return self._answer
