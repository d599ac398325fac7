"""`openai[:MODEL]`: any server with OpenAI's images API makes a picture of words, or over a sketch.

`OPENAI_BASE_URL` and `OPENAI_API_KEY` say which one (https://platform.openai.com/docs/api-reference/images); a server on
this machine, such as LocalAI, needs no key.
"""

import base64
import binascii
import os
import re
from collections.abc import Mapping
from typing import Any, ClassVar
from urllib.parse import urlsplit

from fabcraft.backends.address import checked_url, is_local
from fabcraft.backends.backend import PICTURE_BYTES, Answer, Request, Said, Terms
from fabcraft.backends.web import Web
from fabcraft.errors import InputError, MissingError

MODEL, HOME, SIZE = "gpt-image-1", "https://api.openai.com/v1", "1024x1024"
_KEY, _HOME = "OPENAI_API_KEY", "OPENAI_BASE_URL"
_HINT = f"Set the server's key: export {_KEY}=..."


def _home() -> str:
    return checked_url(os.environ.get(_HOME) or HOME, _HOME)


class OpenAI:
    """/images/generations, and /images/edits where there is a sketch."""

    about: ClassVar[str] = "a server with OpenAI's images API, paid or your own (OPENAI_BASE_URL)"
    usage: ClassVar[str] = "openai[:MODEL]"

    def __init__(self, argument: str) -> None:
        self._model = argument or MODEL
        if not re.fullmatch(r"[\w.:/\-]{1,100}", self._model):
            raise InputError(
                f"{self._model[:60]!r} is no name of a model", f"Give one such as openai:{MODEL}."
            )
        self._home = _home()

    @classmethod
    def lacks(cls) -> MissingError | None:
        """The key, unless the server is on this machine."""
        key = os.environ.get(_KEY, "")
        if not key and not is_local(_home()):
            return MissingError(f"{urlsplit(_home()).netloc} needs a key, and {_KEY} is not set", _HINT)
        if not re.fullmatch(r"[\x21-\x7e]*", key):
            return MissingError(f"{_KEY} holds characters that no key has", _HINT)
        return None

    def terms(self, request: Request) -> Terms:
        """Cost and place; nothing for a server on this machine."""
        if is_local(self._home):
            return Terms()
        host = urlsplit(self._home).netloc
        sent = "the words and the sketch are" if request.picture else "the words are"
        return Terms(
            (
                f"{host} bills every picture to the account of {_KEY}",
                f"{sent} sent to {host} under its terms",
            ),
            "always",
        )

    def key(self) -> Mapping[str, str]:
        """The server and the model."""
        return {"url": self._home, "model": self._model}

    def make(self, request: Request, said: Said) -> Answer:
        """The picture, sent along or to be fetched."""
        web = Web.starting(
            urlsplit(self._home).netloc, request.timeout_s, self._home, os.environ.get(_KEY, ""), _HINT
        )
        wanted = {"model": self._model, "prompt": request.prompt, "size": SIZE}
        if request.picture:
            files = {"image": ("sketch.png", "image/png", request.picture)}
            told = web.post_form(f"{self._home}/images/edits", {**wanted, "n": "1"}, files)
        else:
            told = web.post_json(f"{self._home}/images/generations", {**wanted, "n": 1})
        return self._picture(web, told)

    def _picture(self, web: Web, told: Any) -> Answer:
        listed = told.get("data") if isinstance(told, dict) else None
        first = listed[0] if isinstance(listed, list) and listed else None
        if not isinstance(first, dict):
            raise web.useless("it holds no picture")
        if isinstance(text := first.get("b64_json"), str):
            try:
                return Answer(base64.b64decode(text, validate=True))
            except (binascii.Error, ValueError):
                raise web.useless("its picture is no base64") from None
        if isinstance(url := first.get("url"), str):
            return Answer(web.get(web.followed(url, self._home), PICTURE_BYTES).data)
        raise web.useless("it holds neither b64_json nor a url")
