"""Another program is run: without a shell, under a time limit, what it prints bounded, its children taken with it."""

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

_LOOK_S = 0.25


def run_program(
    command: Sequence[str],
    timeout_s: float,
    *,
    folder: Path | None = None,
    heard_bytes: int = 200_000,
    watch: Callable[[], object] | None = None,
) -> tuple[int, str]:
    """(exit code, the end of what it printed, at most `heard_bytes`).

    folder : where it runs; here when left out.
    watch : called a few times a second; what it raises ends the program.
    Whatever happens, Ctrl-C too, the program and the children of its session are gone afterwards.
    Raises `OSError` when it cannot be started, `subprocess.TimeoutExpired`.
    """
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    assert process.stdout is not None
    heard: deque[bytes] = deque()
    listener = threading.Thread(
        target=_listen, args=(process.stdout.fileno(), heard, heard_bytes), daemon=True
    )
    listener.start()
    deadline = time.monotonic() + timeout_s
    try:
        while True:
            left = deadline - time.monotonic()
            try:
                code = process.wait(min(_LOOK_S, max(left, 0.0)))
                break
            except subprocess.TimeoutExpired:
                if left <= 0:
                    raise subprocess.TimeoutExpired(command, timeout_s) from None
            if watch is not None:
                watch()
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()
        process.wait()
        listener.join(2.0)  # a grandchild in a session of its own may hold the pipe; it is not waited for
        if not listener.is_alive():
            process.stdout.close()
    return code, b"".join(heard)[-heard_bytes:].decode("utf-8", errors="replace")


def _listen(pipe: int, heard: deque[bytes], most: int) -> None:
    """Read until the end, keeping at least the last `most` bytes."""
    size = 0
    while True:
        try:
            piece = os.read(pipe, 1 << 16)
        except OSError:  # closed from the other side
            return
        if not piece:
            return
        heard.append(piece)
        size += len(piece)
        while size - len(heard[0]) >= most:
            size -= len(heard.popleft())


def filled(word: str, places: Mapping[str, str]) -> str:
    """`word` with its places filled, from left to right: what is filled in is not filled again."""
    done = ""
    while word:
        name = next((place for place in places if word.startswith(place)), "")
        done += places[name] if name else word[0]
        word = word[len(name) or 1 :]
    return done
