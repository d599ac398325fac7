"""`gradio:URL[#/api]`: any Gradio app that makes a mesh of a picture, here or elsewhere.

TripoSR, TRELLIS, Hunyuan3D and Stable Fast 3D each come with such an app.  Spoken is Gradio's own HTTP API
(https://www.gradio.app/guides/querying-gradio-apps-with-curl): what the app offers, upload, call, events, file.  Its
Python client is not used, because that downloads whatever an app answers without a bound.
"""

import json
import os
from collections.abc import Mapping
from typing import Any, ClassVar
from urllib.parse import quote, urldefrag, urlsplit

from fabcraft.backends.address import checked_url, is_local
from fabcraft.backends.answer import MESHES
from fabcraft.backends.backend import MESH_BYTES, Answer, Request, Said, Terms
from fabcraft.backends.web import Web
from fabcraft.errors import InputError, MissingError

_EVENTS_BYTES = 20_000_000
_PICTURES, _EDITORS = ("image", "imageeditor", "sketchpad", "file"), ("imageeditor", "sketchpad")
_TOKEN = "HF_TOKEN"
_HINT = f"Set {_TOKEN} for a private Space of Hugging Face, or ask who runs the app."


class Gradio:
    """One endpoint of one app."""

    about: ClassVar[str] = "a Gradio app by its address, such as that of TripoSR, TRELLIS or Hunyuan3D"
    usage: ClassVar[str] = "gradio:URL[#/api]"

    def __init__(self, argument: str) -> None:
        url, api = urldefrag(argument)
        self._home = checked_url(url, "address of the Gradio app")
        self._api = api.strip("/")

    @classmethod
    def lacks(cls) -> MissingError | None:
        """Nothing; whether the app runs is found out when it is called."""
        return None

    def terms(self, request: Request) -> Terms:
        """Place and licence."""
        said = ["the app's model has a licence of its own, which may limit what the mesh is used for"]
        if "hunyuan" in self._home.lower():
            said = ["the licence of Hunyuan3D excludes its use in the EU, the United Kingdom and South Korea"]
        if is_local(self._home):
            return Terms(tuple(said), "always" if "hunyuan" in self._home.lower() else "never")
        return Terms((f"the picture is sent to {urlsplit(self._home).netloc}", *said), "always")

    def key(self) -> Mapping[str, str]:
        """The app and its endpoint."""
        return {"url": self._home, "api": self._api}

    def make(self, request: Request, said: Said) -> Answer:
        """The mesh that the app makes of the picture; every other input of it has its default."""
        web = Web.starting("the Gradio app", request.timeout_s, self._home, self._token(), _HINT)
        root = self._home + self._prefix(web)
        api, parameters = self._endpoint(web, web.get_json(f"{root}/info"))
        places = web.post_form(f"{root}/upload", {}, {"files": ("picture.png", "image/png", request.picture)})
        if not (isinstance(places, list) and places and isinstance(places[0], str)):
            raise web.useless("it took the picture but did not say where")
        file = {
            "path": places[0],
            "orig_name": "picture.png",
            "mime_type": "image/png",
            "meta": {"_type": "gradio.FileData"},
        }
        data = [_value(web, one, file, request.seed) for one in parameters]
        call = f"{root}/call/{quote(api)}"
        event = web.post_json(call, {"data": data})
        number = event.get("event_id") if isinstance(event, dict) else None
        if not isinstance(number, str) or not number:
            raise web.useless("it took the call but gave no event_id")
        made = _mesh_of(web, self._outcome(web, f"{call}/{quote(number, safe='')}", said))
        # a path is fetched from the app's own host, whatever address it gives for it
        url = (
            f"{root}/file={quote(made['path'])}" if "path" in made else web.followed(made["url"], self._home)
        )
        return Answer(web.get(url, MESH_BYTES).data, (made.get("orig_name") or url).rpartition("/")[2])

    def _token(self) -> str:
        """A token for Hugging Face, if the app is one of its Spaces."""
        parts = urlsplit(self._home)
        ours = parts.scheme == "https" and (parts.hostname or "").endswith(".hf.space")
        return os.environ.get(_TOKEN, "") if ours else ""

    def _prefix(self, web: Web) -> str:
        """Where its API lies: Gradio 5 and later say so, 4 has it at the top."""
        config = web.get_json(f"{self._home}/config")
        if not isinstance(config, dict) or "components" not in config:
            raise web.useless("it is no Gradio app")
        prefix = config.get("api_prefix") or ""
        return prefix if isinstance(prefix, str) and prefix.startswith("/") and ":" not in prefix else ""

    def _endpoint(self, web: Web, info: Any) -> tuple[str, list[dict[str, Any]]]:
        """(name, parameters) of the endpoint asked for, or of the only one that makes a mesh of a picture."""
        named = info.get("named_endpoints") if isinstance(info, dict) else None
        if not isinstance(named, dict):
            raise web.useless("it does not say what it offers")
        offered = {
            name.strip("/"): one
            for name, one in named.items()
            if isinstance(one, dict) and all(_dicts(one.get(part)) for part in ("parameters", "returns"))
        }
        fitting = [name for name, one in offered.items() if _fits(one)]
        wanted = self._api or (fitting[0] if len(fitting) == 1 else "")
        if wanted not in offered:
            what = (
                f"has no endpoint /{self._api[:60]}"
                if self._api
                else f"has {len(fitting) or 'no'} endpoints that make a mesh of a picture"
            )
            names = ", ".join(f"/{name}"[:60] for name in (fitting or offered)) or "none"
            raise InputError(
                f"the Gradio app {what}",
                f"Name one as gradio:{self._home}#/NAME; it offers: {names}"[:600] + ".",
            )
        return wanted, offered[wanted]["parameters"]

    def _outcome(self, web: Web, url: str, said: Said) -> Any:
        """The data of the event that ends the call."""
        for event, data in web.events(url, _EVENTS_BYTES):
            if event in ("complete", "error"):
                try:
                    told = json.loads(data)
                except (ValueError, RecursionError):
                    raise web.useless(f"JSON was expected, {data[:60]!r} came") from None
                if event == "complete":
                    return told
                words = told.get("error") if isinstance(told, dict) else told
                raise web.failed(
                    f"it reports an error: {words or 'without saying why'}", "Its own page may tell more."
                )
            said(0, 1)
        raise web.failed("it ended the conversation without an answer")


def _dicts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, dict) for one in value)


def _component(value: dict[str, Any]) -> str:
    return str(value.get("component")).lower()


def _fits(endpoint: dict[str, Any]) -> bool:
    takes = any(_component(one) in _PICTURES for one in endpoint["parameters"])
    return takes and any(_component(one) == "model3d" for one in endpoint["returns"])


def _value(web: Web, parameter: dict[str, Any], file: dict[str, Any], seed: int) -> Any:
    """What a parameter gets: the picture, the seed, or its default."""
    component = _component(parameter)
    name = str(parameter.get("parameter_name") or parameter.get("label") or "")
    if component in _EDITORS:
        return {"background": file, "layers": [], "composite": file}
    if component in _PICTURES:
        return file
    if name.lower() in ("seed", "random_seed"):
        return seed
    if name.lower() in ("randomize_seed", "randomise_seed", "random"):
        return False
    if parameter.get("parameter_has_default"):
        return parameter.get("parameter_default")
    raise web.useless(f"its input {name[:60]!r} has no default; only a picture and a seed are given")


def _mesh_of(web: Web, outputs: Any) -> dict[str, str]:
    """The first mesh file in what the app answered: its path or url, and its name."""
    waiting = [outputs]
    seen = 0
    while waiting and (seen := seen + 1) < 1000:
        one = waiting.pop(0)
        if isinstance(one, list):
            waiting = [*one, *waiting]
        elif isinstance(one, dict):
            said = {
                name: one[name]
                for name in ("path", "url", "orig_name")
                if isinstance(one.get(name), str) and one[name]
            }
            names = [text.partition("?")[0].lower() for text in said.values()]
            if any(name.endswith(f".{ending}") for name in names for ending in MESHES) and (
                "path" in said or "url" in said
            ):
                return said
            waiting = [*one.values(), *waiting]
    raise web.useless(f"it holds no mesh file ({', '.join(MESHES)})")
