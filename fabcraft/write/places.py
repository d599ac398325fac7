"""Where files go: asked before the long work, and all of a set or none of it."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from fabcraft.errors import InputError
from fabcraft.write.atomic import REASONS


def require_places(paths: Iterable[Path | str], inputs: Iterable[str] = ()) -> None:
    """Raise `InputError` for a path that could not be written after the work, or that is one of `inputs`.

    One missing folder is fine (it will be created), two are taken for a misspelt path.
    """
    seen: set[str] = set()
    given = {os.path.realpath(one): one for one in inputs if one and Path(one).exists()}
    for path in map(Path, paths):
        real = os.path.realpath(path)
        if real in seen:
            raise InputError(f"{path} would be written twice", "Give every output a name of its own.")
        if real in given:
            raise InputError(
                f"{path} would overwrite {given[real]}, which is read", "Choose another name with -o."
            )
        seen.add(real)
        _require_place(path)


def _require_place(path: Path) -> None:
    folder = path.parent
    try:
        if path.is_dir():
            raise InputError(
                f"cannot write {path}: there is a folder of that name", "Give the path of a file."
            )
        if folder.exists() and not folder.is_dir():
            raise InputError(f"cannot write {path}: {folder} is a file, not a folder", "Choose another path.")
        if not folder.exists() and not folder.parent.is_dir():
            raise InputError(
                f"cannot write {path}: the folder {folder.parent} does not exist",
                f"Create it first: mkdir -p {folder}",
            )
        exists, folder_exists = path.exists(), folder.exists()
    except (OSError, ValueError) as error:  # a name that is too long, or holds a zero byte
        reason = REASONS.get(getattr(error, "errno", None) or 0, (str(error), ""))[0]
        raise InputError(f"cannot write {str(path)!r}: {reason}", "Choose another path.") from error
    if exists and not os.access(path, os.W_OK):
        raise InputError(f"cannot write {path}: no permission to replace it", "Choose another name.")
    try:  # to ask for permission is not enough: disks are read-only, quotas used up
        with tempfile.TemporaryFile(dir=folder if folder_exists else folder.parent):
            pass
    except OSError as error:
        reason, step = REASONS.get(error.errno or 0, (error.strerror or str(error), "Choose another folder."))
        raise InputError(f"cannot write {path}: {reason}", step) from error


def write_together(jobs: list[tuple[Path, Callable[[], object]]]) -> None:
    """Run every job, which writes the file beside it; when one fails, what the others created goes again."""
    created: list[Path] = []
    folders: list[Path] = []
    try:
        for path, write in jobs:
            if not path.parent.exists():
                _created(path.parent)
                folders.append(path.parent)
            fresh = not os.path.lexists(path)
            write()
            if fresh:
                created.append(path)
    except BaseException:  # Ctrl-C too
        for path in created:
            with contextlib.suppress(OSError):
                path.unlink()
        for folder in folders:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def _created(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        reason, step = REASONS.get(error.errno or 0, (str(error), "Choose another folder."))
        raise InputError(f"cannot create the folder {folder}: {reason}", step) from error
