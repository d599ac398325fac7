"""Real local web services that speak the protocols of back ends, and can be made to misbehave."""

import base64
import json
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass(frozen=True)
class Asked:
    """A request that a service got."""

    method: str
    path: str
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def form(self) -> dict[str, bytes]:
        """The fields of a multipart form."""
        line = re.search(r"boundary=(\S+)", self.headers["content-type"])[1].encode()
        parts = (part.partition(b"\r\n\r\n") for part in self.body.split(b"--" + line)[1:-1])
        return {re.search(rb'name="(\w+)"', head)[1].decode(): data[:-2] for head, _, data in parts}


@dataclass(frozen=True)
class Told:
    """What a service answers."""

    body: bytes = b""
    status: int = 200
    headers: dict[str, str] = field(default_factory=dict)
    length: int | None = None
    """Announced instead of the true length."""
    pieces: Iterator[bytes] | None = None
    """Sent one after the other, without a length."""


def as_json(value: Any, status: int = 200, **headers: str) -> Told:
    return Told(json.dumps(value).encode(), status, {"Content-Type": "application/json", **headers})


Route = Callable[[Asked], Told]


@dataclass(eq=False)
class Service:
    """Routes by `METHOD /path` (a regular expression), the first that fits; what was asked is written down."""

    routes: dict[str, Route]
    asked: list[Asked] = field(default_factory=list)
    url: str = ""

    def count(self, pattern: str) -> int:
        return sum(bool(re.fullmatch(pattern, f"{one.method} {one.path}")) for one in self.asked)

    def last(self, pattern: str) -> Asked:
        return next(one for one in reversed(self.asked) if re.fullmatch(pattern, f"{one.method} {one.path}"))


@contextmanager
def serving(service: Service) -> Iterator[Service]:
    """The service on a free port of this machine."""
    gone = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def answer(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            headers = {name.lower(): value for name, value in self.headers.items()}
            asked = Asked(self.command, self.path, headers, body)
            service.asked.append(asked)
            line = f"{self.command} {self.path}"
            route = next((one for way, one in service.routes.items() if re.fullmatch(way, line)), None)
            told = route(asked) if route else Told(b"nothing here", 404)
            self.send_response(told.status)
            for name, value in told.headers.items():
                self.send_header(name, value)
            if told.pieces is None:
                self.send_header(
                    "Content-Length", str(len(told.body) if told.length is None else told.length)
                )
            self.end_headers()
            try:
                for piece in [told.body] if told.pieces is None else told.pieces:
                    self.wfile.write(piece)
                    self.wfile.flush()
                    if gone.is_set():
                        return
            except OSError:
                return  # the other side has heard enough

        do_GET = do_POST = answer  # noqa: N815

        def log_message(self, *arguments: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    service.url = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield service
    finally:
        gone.set()
        server.shutdown()
        server.server_close()
        thread.join(5)


def dripping(seconds: float = 0.05) -> Iterator[bytes]:
    """A byte now and then, for ever."""
    wait = threading.Event()
    while True:
        wait.wait(seconds)
        yield b" "


def endless() -> Iterator[bytes]:
    """Megabytes without an end."""
    while True:
        yield b"x" * (1 << 20)


def gradio(mesh: bytes, **changed: Route) -> Service:
    """An app of Gradio 6 with one function that makes a GLB of a picture (guides/querying-gradio-apps-with-curl)."""
    picture = {
        "component": "Image",
        "label": "Input",
        "parameter_name": "image",
        "parameter_has_default": False,
    }
    seed = {"component": "Number", "label": "Seed", "parameter_name": "seed", "parameter_has_default": True}
    size = {"component": "Slider", "label": "Size", "parameter_name": "size", "parameter_has_default": True}
    info = {
        "named_endpoints": {
            "/check": {"parameters": [picture], "returns": [{"component": "Image"}]},
            "/generate": {
                "parameters": [picture, {**size, "parameter_default": 256}, {**seed, "parameter_default": 0}],
                "returns": [{"component": "Model3d"}, {"component": "Number"}],
            },
        },
        "unnamed_endpoints": {},
    }
    file = {
        "path": "/tmp/gradio/ab c/out.glb",
        "url": None,
        "orig_name": "out.glb",
        "meta": {"_type": "gradio.FileData"},
    }
    events = f"event: heartbeat\ndata: null\n\nevent: complete\ndata: {json.dumps([file, 7])}\n\n"
    routes: dict[str, Route] = {
        "config": lambda _: as_json({"version": "6.31.0", "api_prefix": "/gradio_api", "components": []}),
        "info": lambda _: as_json(info),
        "upload": lambda _: as_json(["/tmp/gradio/12/picture.png"]),
        "call": lambda _: as_json({"event_id": "e1"}),
        "events": lambda _: Told(events.encode(), headers={"Content-Type": "text/event-stream"}),
        "file": lambda _: Told(mesh, headers={"Content-Type": "model/gltf-binary"}),
        **changed,
    }
    ways = {
        "config": "GET /config",
        "info": "GET /gradio_api/info",
        "upload": "POST /gradio_api/upload",
        "call": "POST /gradio_api/call/generate",
        "events": "GET /gradio_api/call/generate/e1",
        "file": r"GET /gradio_api/file=/tmp/gradio/ab%20c/out\.glb",
    }
    return Service({ways[name]: route for name, route in routes.items()})


def tripo(mesh: bytes, **changed: Route) -> Service:
    """Tripo's API v3 (https://platform.tripo3d.ai/docs): files, image-to-model, tasks, and where meshes lie."""
    service = Service({})
    states = iter([{"status": "queued", "progress": 0}, {"status": "running", "progress": 40}])

    def task(_: Asked) -> Told:
        done = {
            "status": "success",
            "progress": 100,
            "output": {"model_url": f"{service.url}/store/m.glb?sign=1"},
        }
        return as_json({"code": 0, "data": {"task_id": "t-1", **next(states, done)}})

    routes: dict[str, Route] = {
        "files": lambda _: as_json({"code": 0, "data": {"file_token": "file_1"}}),
        "begin": lambda _: as_json({"code": 0, "data": {"task_id": "t-1"}}),
        "task": task,
        "store": lambda _: Told(mesh),
        **changed,
    }
    ways = {
        "files": "POST /v3/files",
        "begin": "POST /v3/generation/image-to-model",
        "task": "GET /v3/tasks/t-1",
        "store": r"GET /store/m\.glb\?sign=1",
    }
    service.routes.update({ways[name]: route for name, route in routes.items()})
    return service


def openai(picture: bytes, **changed: Route) -> Service:
    """OpenAI's images API (https://platform.openai.com/docs/api-reference/images)."""
    told = {"created": 1, "data": [{"b64_json": base64.b64encode(picture).decode()}]}
    routes: dict[str, Route] = {
        "generations": lambda _: as_json(told),
        "edits": lambda _: as_json(told),
        "store": lambda _: Told(picture),
        **changed,
    }
    ways = {
        "generations": "POST /v1/images/generations",
        "edits": "POST /v1/images/edits",
        "store": "GET /store/p.png",
    }
    return Service({ways[name]: route for name, route in routes.items()})
