"""`write_atomically`: a file appears whole or not at all.

The bytes go into a temporary file in the target's own folder, are flushed to the disk (fsync), and only
then renamed over the target, so a reader, a full disk or a killed process never leaves half a file. Where
the system offers it (Linux, `O_TMPFILE`) the temporary has no name until it is complete: even a killed
process leaves nothing behind.
"""

import contextlib
import errno
import os
import secrets
import stat
from pathlib import Path
from typing import BinaryIO

from fabcraft.errors import InputError

REASONS: dict[int, tuple[str, str]] = {
    errno.ENOSPC: ("the disk is full", "Free some space or choose another folder."),
    errno.EDQUOT: ("the disk quota is used up", "Free some space or choose another folder."),
    errno.EFBIG: (
        "the file is larger than the system allows",
        "Raise the limit (ulimit -f) or simplify the mesh.",
    ),
    errno.EACCES: ("no permission to write there", "Choose a folder that you may write to."),
    errno.EPERM: ("no permission to write there", "Choose a folder that you may write to."),
    errno.EROFS: ("no permission to write there: the disk is read-only", "Choose another folder."),
    errno.ENOENT: ("the folder does not exist", "Create the folder first, or choose another one."),
    errno.ENOTDIR: ("a part of the path is a file, not a folder", "Choose another path."),
    errno.EISDIR: ("there is a folder of that name", "Give the path of a file."),
    errno.ENAMETOOLONG: ("the name is too long", "Choose a shorter name."),
}
"""What the system's error number means to a person, and the next step."""


def write_atomically(path: str | Path, data: bytes) -> Path:
    """Write `data` to `path`, whole or not at all; returns the path.

    An existing file keeps its permissions, a symbolic link stays a link, and a device such as /dev/null is
    written to, never replaced. Raises `InputError` with the reason when the system refuses; the target is
    then untouched.
    """
    try:
        _write(Path(os.path.realpath(path)), data)
    except ValueError as error:
        raise InputError(f"cannot write {str(path)!r}: {error}", "Choose another path.") from error
    except OSError as error:
        reason, step = REASONS.get(error.errno or 0, (error.strerror or str(error), "Choose another path."))
        raise InputError(f"cannot write {path}: {reason}", step) from error
    return Path(path)


def _write(target: Path, data: bytes) -> None:
    """The bytes into `target`, through a temporary unless it is a device or pipe."""
    mode = target.stat().st_mode if target.exists() else None
    if mode is not None and stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if mode is not None and not stat.S_ISREG(mode):
        target.write_bytes(data)
        return
    # A read-only target is the user's wish: rename would replace it without asking.
    if mode is not None and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    temporary = target.parent / f".{target.name[:80]}.{secrets.token_hex(6)}.tmp"
    try:
        _write_temporary(temporary, data, None if mode is None else stat.S_IMODE(mode))
        temporary.replace(target)
    except BaseException:  # KeyboardInterrupt too: nothing may stay behind
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    _flush_folder(target.parent)


def _write_temporary(temporary: Path, data: bytes, mode: int | None) -> None:
    """`data` on the disk under the name `temporary`, which appears only when it is complete where that is
    possible."""
    if hasattr(os, "O_TMPFILE"):
        # Not every file system has unnamed files; a real reason, such as a full disk, comes back from the
        # plain way.
        with contextlib.suppress(OSError):
            handle = os.open(temporary.parent, os.O_TMPFILE | os.O_WRONLY, 0o666)
            with os.fdopen(handle, "wb") as file:
                _fill(file, data, mode)
                # open(2) names /proc/self/fd as the way to give the file its name; a directory handle,
                # unused for an absolute path, makes Python call linkat with AT_SYMLINK_FOLLOW instead of
                # link, which cannot.
                os.link(f"/proc/self/fd/{handle}", temporary, src_dir_fd=handle, follow_symlinks=True)
            return
    with temporary.open("xb") as file:
        _fill(file, data, mode)


def _fill(file: BinaryIO, data: bytes, mode: int | None) -> None:
    """`data` and permissions into the open file and on to the disk."""
    file.write(data)
    file.flush()
    if mode is not None and hasattr(os, "fchmod"):  # Windows has none
        os.fchmod(file.fileno(), mode)
    os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """The rename on the disk, where the system lets a folder be flushed."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
