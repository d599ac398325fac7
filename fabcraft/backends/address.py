"""Addresses on the web: which are taken, whether two are the same place, and what opens them.

There is a handler for http and one for https, and none for anything else; proxies and certificates are the system's.
"""

import http.client
import ipaddress
import re
import socket
import ssl
import urllib.request
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from fabcraft.errors import InputError


def checked_url(url: str, what: str = "URL") -> str:
    """`url` without a trailing slash.  Raises `InputError` unless it is http(s), names a host and carries no secret."""
    try:
        parts = urlsplit(url)
        host, user = parts.hostname, parts.username
        _ = parts.port
    except ValueError as error:
        raise InputError(
            f"{what} {url[:200]!r} cannot be read: {error}", "Give one such as http://127.0.0.1:7860."
        ) from None
    if parts.scheme not in ("http", "https") or not host or re.search(r"[\s\x00-\x1f\x7f]", url):
        raise InputError(
            f"{what} {url[:200]!r} was given; an http or https address was expected",
            "Give one such as http://127.0.0.1:7860.",
        )
    if user is not None or parts.query:
        raise InputError(
            f"the {what} carries a name, password or query, which would be written into recipes",
            "Give the address alone; keys belong in the environment.",
        )
    return url.rstrip("/")


def is_local(url: str) -> bool:
    """Whether the host of `url` is this machine."""
    host = urlsplit(url).hostname or ""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def origin_of(url: str) -> tuple[str, str | None, int | None]:
    """(scheme, host, port): what a key is for."""
    parts = urlsplit(url)
    return parts.scheme, parts.hostname, parts.port


def opener(opened: Callable[[socket.socket], None]) -> urllib.request.OpenerDirector:
    """For http and https alone, through the system's proxies; hands every socket to `opened`."""

    def plain(host: str, **named: Any) -> http.client.HTTPConnection:
        return _watched(http.client.HTTPConnection(host, **named))

    def secure(host: str, **named: Any) -> http.client.HTTPConnection:
        return _watched(http.client.HTTPSConnection(host, context=ssl.create_default_context(), **named))

    def _watched(connection: http.client.HTTPConnection) -> http.client.HTTPConnection:
        connect = connection.connect

        def connected() -> None:
            connect()
            opened(connection.sock)

        connection.connect = connected  # type: ignore[method-assign]
        return connection

    class Handler(urllib.request.HTTPHandler):
        def http_open(self, request: Any) -> Any:
            return self.do_open(plain, request)

    class SecureHandler(urllib.request.HTTPSHandler):
        def https_open(self, request: Any) -> Any:
            return self.do_open(secure, request)

    director = urllib.request.OpenerDirector()
    for handler in (urllib.request.ProxyHandler(), Handler(), SecureHandler()):
        director.add_handler(handler)
    return director
