"""A web service is asked: bounded in time and size, over http and https alone, tried again where that is safe.

The standard library does the talking, so that proxies and certificates are the system's.  There is no handler for any
other scheme, redirects are followed by hand, a key goes to no other host, and no answer is read beyond its limit.
"""

import contextlib
import email.utils
import http.client
import json
import secrets
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urljoin, urlsplit

from fabcraft import __version__
from fabcraft.backends.address import opener, origin_of
from fabcraft.errors import FabcraftError, InputError, MissingError

JSON_BYTES = 80_000_000
"""A picture as base64 fits into an answer."""
LINE_BYTES = 1_000_000
"""Of a stream of events."""
ATTEMPTS, FIRST_WAIT_S, LONGEST_WAIT_S, REDIRECTS = 4, 1.0, 30.0, 5
SILENCE_S = 90.0
"""Longest time without a byte."""
_BUSY = (429, 503)
_PASSING = (408, 429, 500, 502, 503, 504)


@dataclass(frozen=True)
class Reply:
    """A whole answer with a good status."""

    data: bytes
    content_type: str
    url: str


@dataclass(frozen=True)
class Web:
    """One service, for the time of one job."""

    who: str
    """As it is called in messages."""
    deadline: float
    """On the monotonic clock."""
    timeout_s: float
    """How long that was."""
    key: str = field(default="", repr=False)
    """Sent as a bearer token to `home` alone, and blotted out of every message."""
    home: str = ""
    key_hint: str = ""
    """What to do when the key is refused."""

    @classmethod
    def starting(cls, who: str, timeout_s: float, home: str, key: str = "", key_hint: str = "") -> "Web":
        """From now on for `timeout_s`."""
        return cls(who, time.monotonic() + timeout_s, timeout_s, key, home, key_hint)

    def get(self, url: str, limit: int) -> Reply:
        """The body at `url`; tried again when that may help."""
        return self._repeated("GET", url, None, {}, limit, _PASSING)

    def get_json(self, url: str) -> Any:
        """The JSON at `url`."""
        return self._json(self.get(url, JSON_BYTES))

    def post_json(self, url: str, value: Any) -> Any:
        """The JSON that comes back.  What was perhaps begun, and billed, is not asked for twice."""
        body = json.dumps(value).encode()
        headers = {"Content-Type": "application/json"}
        return self._json(self._repeated("POST", url, body, headers, JSON_BYTES, _BUSY))

    def post_form(
        self, url: str, values: Mapping[str, str], files: Mapping[str, tuple[str, str, bytes]]
    ) -> Any:
        """The JSON that comes back for a multipart form.  files : field to (file name, media type, bytes)."""
        line = secrets.token_hex(16)
        parts = [
            f'--{line}\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n'.encode()
            for name, value in values.items()
        ]
        for name, (file, kind, data) in files.items():
            head = f'--{line}\r\nContent-Disposition: form-data; name="{name}"; filename="{file}"\r\n'
            parts.append(f"{head}Content-Type: {kind}\r\n\r\n".encode() + data + b"\r\n")
        body = b"".join(parts) + f"--{line}--\r\n".encode()
        headers = {"Content-Type": f"multipart/form-data; boundary={line}"}
        return self._json(self._repeated("POST", url, body, headers, JSON_BYTES, _BUSY))

    def events(self, url: str, limit: int) -> Iterator[tuple[str, str]]:
        """(event, data) of a stream of server-sent events, until it ends."""
        event, data = "message", list[str]()
        try:
            with self._opened("GET", url, None, {"Accept": "text/event-stream"}) as response:
                self._require_good(response)
                for line in self._lines(response, limit):
                    name, _, value = line.partition(":")
                    value = value.removeprefix(" ")
                    if not line:
                        if data:
                            yield event, "\n".join(data)
                        event, data = "message", []
                    elif name == "event":
                        event = value
                    elif name == "data":
                        data.append(value)
        except _BrokenError as broken:
            raise broken.told from None

    def pause(self, seconds: float) -> None:
        """Wait, but not beyond the deadline."""
        left = self.deadline - time.monotonic()
        if left <= 0:
            raise self._late()
        time.sleep(min(seconds, left))

    def failed(
        self, why: str, next_step: str = "Try again later, or choose another one (fabcraft backends)."
    ) -> MissingError:
        """That the service cannot do it, in its own words: one line, bounded, without the key."""
        return MissingError(f"{self.who}: {self._plain(why)}", next_step)

    def useless(self, why: str) -> InputError:
        """That what it answered is of no use."""
        return InputError(
            f"the answer of {self.who} cannot be used: {self._plain(why)}",
            "Try again, or choose another one (fabcraft backends).",
        )

    def _plain(self, text: str) -> str:
        if self.key:
            text = text.replace(self.key, "***")
        return "".join(c for c in " ".join(text.split()) if c.isprintable())[:300]

    def _json(self, reply: Reply) -> Any:
        try:
            return json.loads(reply.data)
        except (ValueError, RecursionError):
            start = reply.data[:60].decode("utf-8", "replace")
            raise self.useless(f"JSON was expected, {start!r} came") from None

    def _repeated(
        self,
        method: str,
        url: str,
        body: bytes | None,
        headers: Mapping[str, str],
        limit: int,
        passing: tuple[int, ...],
    ) -> Reply:
        for attempt in range(ATTEMPTS):
            last = attempt == ATTEMPTS - 1
            wait_s = min(FIRST_WAIT_S * 2.0**attempt, LONGEST_WAIT_S)
            try:
                with self._opened(method, url, body, headers) as response:
                    if response.status in passing and not last:
                        wait_s = _asked_wait(response.headers.get("Retry-After"), wait_s)
                    else:
                        self._require_good(response)
                        data = b"".join(self._chunks(response, limit))
                        return Reply(data, response.headers.get_content_type(), response.url or url)
            except _BrokenError as broken:
                # a request that was perhaps heard is only repeated where that does no harm; nobody there is soon believed
                if last or (attempt > 0 if broken.unheard else method != "GET"):
                    raise broken.told from None
            self.pause(wait_s)
        raise AssertionError("the last attempt returns or raises")

    @contextlib.contextmanager
    def _opened(self, method: str, url: str, body: bytes | None, headers: Mapping[str, str]) -> Iterator[Any]:
        """The response, redirects followed, its socket shut when the deadline comes."""
        left = self.deadline - time.monotonic()
        if left <= 0:
            raise self._late()
        sockets: list[socket.socket] = []
        clock = threading.Timer(left, _shut, (sockets,))
        clock.daemon = True
        clock.start()
        response = None
        try:
            response = self._answered(
                opener(sockets.append), method, url, body, headers, min(left, SILENCE_S)
            )
            yield response
        except FabcraftError:
            raise
        except (OSError, http.client.HTTPException, ValueError) as error:
            if time.monotonic() >= self.deadline:
                raise self._late() from None
            cause = getattr(error, "reason", error)
            why = str(cause if isinstance(cause, BaseException) else error) or type(error).__name__
            unheard = isinstance(cause, (ConnectionRefusedError, socket.gaierror))
            what = "cannot be reached" if unheard else "broke off"
            told = self.failed(
                f"{urlsplit(url).netloc} {what}: {why}",
                "Check the address and that it is running; a proxy is taken from HTTPS_PROXY.",
            )
            raise _BrokenError(told, unheard) from error
        finally:
            clock.cancel()
            if response is not None:
                response.close()

    def _answered(
        self,
        opener: urllib.request.OpenerDirector,
        method: str,
        url: str,
        body: bytes | None,
        headers: Mapping[str, str],
        silence_s: float,
    ) -> Any:
        for _ in range(REDIRECTS):
            sent = {"User-Agent": f"fabcraft/{__version__}", "Accept-Encoding": "identity", **headers}
            if self.key and origin_of(url) == origin_of(self.home):
                sent["Authorization"] = f"Bearer {self.key}"
            request = urllib.request.Request(url, data=body, headers=sent, method=method)
            response = opener.open(request, timeout=silence_s)
            if response is None:
                raise self.useless(f"it leads to {url[:100]!r}, which is no web address")
            if response.status not in (301, 302, 303, 307, 308):
                return response
            target = urljoin(url, response.headers.get("Location", ""))
            response.close()
            if method != "GET":
                raise self.useless(f"it has moved to {target[:200]!r}")
            url = self.followed(target, url)
        raise self.useless(f"it redirects more than {REDIRECTS} times")

    def followed(self, target: str, origin: str) -> str:
        """`target`, named by what `origin` answered.  Raises `InputError` unless it is as safe as `origin`."""
        try:
            scheme, host = urlsplit(target).scheme, urlsplit(target).hostname
        except ValueError:
            scheme, host = "", None
        if scheme not in ("http", "https") or not host:
            raise self.useless(f"it leads to {target[:200]!r}, which is no web address")
        if scheme == "http" and urlsplit(origin).scheme == "https":
            raise self.useless(f"it leads from https to http ({host})")
        return target

    def _require_good(self, response: Any) -> None:
        if 200 <= response.status < 300:
            return
        why = ""
        with contextlib.suppress(OSError, http.client.HTTPException, FabcraftError):  # the status says enough
            why = _reason(b"".join(self._chunks(response, 100_000)))
        why = f"HTTP {response.status} {response.reason or ''}" + (f": {why}" if why else "")
        if response.status in (401, 403):
            raise self.failed(
                f"it refused the key ({why})" if self.key else f"it asks for a key ({why})",
                self.key_hint or "Ask who runs it.",
            )
        if response.status == 402:
            raise self.failed(
                f"the account has no credit left ({why})",
                "Top it up, or choose another one (fabcraft backends).",
            )
        if response.status in _PASSING:
            raise self.failed(f"it is too busy or out of order ({why})")
        raise self.useless(why)

    def _chunks(self, response: Any, limit: int) -> Iterator[bytes]:
        """The body in pieces.  Raises `InputError` beyond `limit` bytes, at once if it announces more."""
        if response.headers.get("Content-Encoding", "identity") not in ("identity", ""):
            raise self.useless("it is compressed, which was not asked for")
        announced = response.headers.get("Content-Length", "")
        expected = int(announced) if announced.isdecimal() else None
        if expected is not None and expected > limit:
            raise self.useless(f"it is {expected:,} bytes long; at most {limit:,} are taken")
        taken = 0
        while piece := response.read1(1 << 16):
            if time.monotonic() >= self.deadline:
                raise self._late()
            taken += len(piece)
            if taken > limit:
                raise self.useless(f"it is longer than {limit:,} bytes")
            yield piece
        if time.monotonic() >= self.deadline:  # a socket that the clock has shut reads like an end
            raise self._late()
        if expected is not None and taken < expected and response.status != 204:
            raise http.client.HTTPException(f"it was cut short after {taken:,} of {expected:,} bytes")

    def _lines(self, response: Any, limit: int) -> Iterator[str]:
        rest = b""
        for piece in self._chunks(response, limit):
            *lines, rest = (rest + piece).split(b"\n")
            if len(rest) > LINE_BYTES:
                raise self.useless(f"it has a line longer than {LINE_BYTES:,} bytes")
            for line in lines:
                yield line.rstrip(b"\r").decode("utf-8", "replace")

    def _late(self) -> MissingError:
        return MissingError(
            f"{self.who} gave no answer within {self.timeout_s:g} s",
            "Try again, or choose a faster one (fabcraft backends).",
        )


class _BrokenError(Exception):
    """The connection failed; `unheard` when the request cannot have been heard."""

    def __init__(self, told: MissingError, unheard: bool) -> None:
        super().__init__(told.message)
        self.told, self.unheard = told, unheard


def _shut(sockets: list[socket.socket]) -> None:
    for one in sockets:
        with contextlib.suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)


def _asked_wait(retry_after: str | None, otherwise_s: float) -> float:
    """Seconds to wait by a Retry-After header, a number or a date, at most `LONGEST_WAIT_S`."""
    if not retry_after:
        return otherwise_s
    try:
        seconds = float(retry_after)
    except ValueError:
        try:
            seconds = email.utils.parsedate_to_datetime(retry_after).timestamp() - time.time()
        except (ValueError, OverflowError, OSError):
            return otherwise_s
    return min(max(seconds, 0.0), LONGEST_WAIT_S) if seconds == seconds else otherwise_s


def _reason(body: bytes) -> str:
    """What an error's body says, where it says it as services do."""
    try:
        told = json.loads(body)
    except (ValueError, RecursionError):
        return "" if body.lstrip()[:1] == b"<" else body[:300].decode("utf-8", "replace")
    for _ in range(3):
        if not isinstance(told, dict):
            break
        told = next((told[name] for name in ("error", "detail", "message") if told.get(name)), "")
    return told if isinstance(told, str) else ""
