"""`tripo[:MODEL]`: Tripo's paid service makes a mesh of a picture (HTTP API v3, https://platform.tripo3d.ai/docs).

Upload, task, questions about the task, download.  A task costs credits from the moment that it is accepted, so it is
asked for once; its number is kept until the mesh is here, and a run that was broken off goes on with the same task.
"""

import hashlib
import os
import re
from collections.abc import Mapping
from typing import Any, ClassVar
from urllib.parse import urlsplit

from fabcraft.backends import cache
from fabcraft.backends.address import checked_url
from fabcraft.backends.backend import MESH_BYTES, Answer, Request, Said, Terms
from fabcraft.backends.web import Web
from fabcraft.errors import InputError, MissingError

MODEL = "v2.5-20250123"
HOME = "https://openapi.tripo3d.ai"
_KEY, _HOME = "TRIPO_API_KEY", "TRIPO_BASE_URL"
_HINT = f"Make a key at https://platform.tripo3d.ai and set it: export {_KEY}=tsk_..."
_OVER = ("failed", "cancelled", "banned", "expired")
_POLL_S = (2.0, 15.0)


class Tripo:
    """Image to model, without texture: a print has none."""

    about: ClassVar[str] = "Tripo's service, paid: about 20 credits (0.20 USD) a mesh"
    usage: ClassVar[str] = "tripo[:MODEL]"

    def __init__(self, argument: str) -> None:
        self._model = argument or MODEL
        if not re.fullmatch(r"[\w.\-]{1,60}", self._model):
            raise InputError(
                f"{self._model[:60]!r} is no name of a Tripo model", f"Give one such as tripo:{MODEL}."
            )
        self._home = checked_url(os.environ.get(_HOME) or HOME, _HOME)

    @classmethod
    def lacks(cls) -> MissingError | None:
        """The key."""
        key = os.environ.get(_KEY, "")
        if not key:
            return MissingError(f"Tripo needs a key, and {_KEY} is not set", _HINT)
        if not re.fullmatch(r"tsk_[\x21-\x7e]+", key):
            return MissingError(f"{_KEY} holds no key of Tripo, which starts with tsk_", _HINT)
        return None

    def terms(self, request: Request) -> Terms:
        """Cost, place and licence."""
        if _task_kept(self._name(request)):
            return Terms(("the task that was paid for before goes on; no new one is made",))
        host = urlsplit(self._home).netloc
        return Terms(
            (
                "Tripo is paid: an image-to-model task without texture took 20 credits (0.20 USD) in 2026, "
                "40 with the P1 models; see https://platform.tripo3d.ai",
                f"the picture is sent to {host}; Tripo's terms say what may be done with it and with the mesh",
            ),
            "always",
        )

    def key(self) -> Mapping[str, str]:
        """The model; the seed is the request's."""
        return {"model": self._model}

    def make(self, request: Request, said: Said) -> Answer:
        """The mesh of a new task, or of the one that was begun for the same question."""
        web = Web.starting("Tripo", request.timeout_s, self._home, os.environ[_KEY], _HINT)
        name = self._name(request)
        task = _task_kept(name)
        if not task:
            task = self._begun(web, request)
            cache.kept(name, "task", task.encode())
        url = self._finished(web, task, name, said)
        data = web.get(url, MESH_BYTES).data
        _forget(name)
        return Answer(data, urlsplit(url).path.rpartition("/")[2])

    def _name(self, request: Request) -> str:
        account = hashlib.sha256(os.environ.get(_KEY, "").encode()).hexdigest()
        return cache.name_of("tripo-task", {**self.key(), "home": self._home, "account": account}, request)

    def _begun(self, web: Web, request: Request) -> str:
        """The number of a new task."""
        files = {"file": ("picture.png", "image/png", request.picture)}
        token = _data(web, web.post_form(f"{self._home}/v3/files", {}, files)).get("file_token")
        if not isinstance(token, str) or not token:
            raise web.useless("it took the picture but gave no file_token")
        wanted = {
            "input": token,
            "model": self._model,
            "texture": False,
            "pbr": False,
            "model_seed": request.seed,
        }
        task = _data(web, web.post_json(f"{self._home}/v3/generation/image-to-model", wanted)).get("task_id")
        if not isinstance(task, str) or not re.fullmatch(r"[\w\-]{1,100}", task):
            raise web.useless("it gave no task_id")
        return task

    def _finished(self, web: Web, task: str, name: str, said: Said) -> str:
        """The address of the mesh, once the task is done."""
        wait_s = _POLL_S[0]
        address = f"{self._home}/v3/tasks/{task}"
        while True:
            told = _data(web, web.get_json(address))
            status = str(told.get("status", "")).lower()
            if status in _OVER:
                _forget(name)
                raise web.failed(
                    f"its task {task} is {status}: {told.get('error_msg') or told.get('error_message') or ''}"
                )
            if status == "success":
                output = told.get("output")
                url = output.get("model_url") or output.get("model") if isinstance(output, dict) else None
                if not isinstance(url, str):
                    raise web.useless(f"task {task} is done but names no model_url")
                return web.followed(url, self._home)
            progress = told.get("progress")
            said(
                min(max(int(progress), 0), 100)
                if isinstance(progress, (int, float)) and progress == progress
                else 0,
                100,
            )
            web.pause(wait_s)
            wait_s = min(1.5 * wait_s, _POLL_S[1])


def _data(web: Web, told: Any) -> dict[str, Any]:
    """What is in the envelope {code, data}.  Raises `MissingError` for a code that says no."""
    if isinstance(told, dict) and told.get("code", 0) == 0 and isinstance(told.get("data"), dict):
        data: dict[str, Any] = told["data"]
        return data
    if isinstance(told, dict) and told.get("code", 0) != 0:
        raise web.failed(
            f"{told.get('message') or 'it refuses'} (code {told['code']}) {told.get('suggestion') or ''}"
        )
    raise web.useless("it is not {code, data}")


def _task_kept(name: str) -> str:
    """The number of a task that was begun, or nothing."""
    path = cache.found(name, ("task",))
    text = path.read_text("ascii", "replace") if path else ""
    return text if re.fullmatch(r"[\w\-]{1,100}", text) else ""


def _forget(name: str) -> None:
    if path := cache.found(name, ("task",)):
        path.unlink(missing_ok=True)
