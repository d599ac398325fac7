"""What a back end is: something outside fabcraft that makes a picture of words, or a mesh of a picture.

A back end is a class, found by its name in an entry-point group (`registry`) and made from the text after that name:
`gradio:http://127.0.0.1:7860` calls `Gradio("http://127.0.0.1:7860")`.  It only turns a `Request` into an `Answer`:
asking the user, keeping answers and looking at what came back is done once for all of them (`ask`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol, runtime_checkable

from fabcraft.errors import MissingError

Said = Callable[[int, int], None]
"""Progress of one call: (done, of)."""

TIMEOUT_S = 1200.0
"""A large model on a processor takes minutes; nothing takes longer than this."""
MESH_BYTES, PICTURE_BYTES = 200_000_000, 40_000_000
"""Largest answers that are taken."""


@dataclass(frozen=True)
class Request:
    """What is asked for."""

    picture: bytes = b""
    """PNG, RGB, without metadata: what the mesh shall show, or the sketch that a picture is drawn over."""
    prompt: str = ""
    seed: int = 0
    timeout_s: float = TIMEOUT_S


@dataclass(frozen=True)
class Answer:
    """What came back, as it came; nobody has looked at it yet."""

    data: bytes
    name: str = ""
    """File name that the other side gave it."""


@dataclass(frozen=True)
class Terms:
    """What a user must know before a call: what it costs, what leaves this machine, whose licence binds."""

    said: tuple[str, ...] = ()
    ask: Literal["never", "unless typed", "always"] = "never"
    """Whether a yes is needed; `unless typed`: only when a recipe file, not the command line, names the back end."""


@runtime_checkable
class Backend(Protocol):
    """One back end; `argument` is what follows its name and a colon."""

    about: ClassVar[str]
    """What it is, in a line."""
    usage: ClassVar[str]
    """How it is named, such as `gradio:URL[#/api]`."""

    def __init__(self, argument: str) -> None:
        """Raises `InputError` for an argument that cannot be used."""

    @classmethod
    def lacks(cls) -> MissingError | None:
        """What has to be installed or set on this machine first."""

    def terms(self, request: Request) -> Terms:
        """What is said before the call.  Uses no network."""

    def key(self) -> Mapping[str, str]:
        """Everything besides the request that decides the answer, without secrets."""

    def make(self, request: Request, said: Said) -> Answer:
        """The answer.  Raises `MissingError` when it cannot be had here and now, `InputError` when it is of no use."""
