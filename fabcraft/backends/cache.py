"""What back ends answered, kept by what was asked, so that a run can be repeated without them.

One file for each answer in the user's cache folder, named by the back end and a hash of everything that decides the
answer.  Files appear whole or not at all; the oldest go when there are too many, and any may be deleted at any time.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path

from fabcraft.backends.backend import Request
from fabcraft.errors import InputError
from fabcraft.write.atomic import write_atomically

MOST_BYTES, MOST_FILES = 2_000_000_000, 200


def folder() -> Path:
    """Where answers lie; it need not exist."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("fabcraft", appauthor=False)) / "backends"


def name_of(backend: str, key: Mapping[str, str], request: Request) -> str:
    """The name, without an ending, of the answer to a request: the same for the same question alone."""
    asked = {
        "backend": backend,
        "key": dict(sorted(key.items())),
        "prompt": request.prompt,
        "seed": request.seed,
        "picture": hashlib.sha256(request.picture).hexdigest(),
    }
    return f"{backend}-{hashlib.sha256(json.dumps(asked).encode()).hexdigest()[:24]}"


def found(name: str, endings: tuple[str, ...]) -> Path | None:
    """The kept answer of that name, or None; it counts as used just now."""
    for ending in endings:
        path = folder() / f"{name}.{ending}"
        if path.is_file():
            with contextlib.suppress(OSError):  # a read-only cache is a cache too
                os.utime(path)
            return path
    return None


def kept(name: str, ending: str, data: bytes) -> Path:
    """The answer in its file, older ones making room.  Raises `InputError` when the folder refuses."""
    place = folder()
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"the cache folder {place} cannot be made: {error.strerror}",
            "Set XDG_CACHE_HOME to a folder that can be written.",
        ) from None
    path = write_atomically(place / f"{name}.{ending}", data)
    _make_room(path)
    return path


def _make_room(newest: Path) -> None:
    files = []
    for path in newest.parent.iterdir():
        with contextlib.suppress(OSError):  # another run has removed it
            stat = path.stat()
            files.append((path != newest, -stat.st_mtime_ns, stat.st_size, path))
    count = total = 0
    for _, _, size, path in sorted(files):
        count, total = count + 1, total + size
        if count > MOST_FILES or (total > MOST_BYTES and path != newest):
            with contextlib.suppress(OSError):
                path.unlink()


def cleared() -> int:
    """Delete every answer; returns how many files went."""
    count = 0
    for path in folder().glob("*-*.*"):
        with contextlib.suppress(OSError):
            path.unlink()
            count += 1
    return count
