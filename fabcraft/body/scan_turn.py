"""Up and front of a scan: which rotations are tried, and what was found, in the axes of the file."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from fabcraft.body.scan_search import even_rotations
from fabcraft.errors import InputError

AXES: Mapping[str, tuple[float, float, float]] = {
    "x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1),
}  # fmt: skip
_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
"""glTF's own axes to the frame that its meshes are read into."""
_WITHIN_DEG = 25.0
"""How far from a given axis a person may lean."""
_DENSE = 14_000
"""Rotations of which those near a given axis are tried."""


def file_frame(path: Path) -> Float64[np.ndarray, "3 3"]:
    """From the file's own axes to the frame that its mesh is read into."""
    return _Y_UP if path.suffix.lower() in (".glb", ".gltf") else np.eye(3)


def rotations_of(
    frame: tuple[np.ndarray, np.ndarray], up: str, front: str, path: Path
) -> Float64[np.ndarray, "N 3 3"]:
    """The rotations, part to scan, that are tried for a part whose up and front are `frame`."""
    rotations = even_rotations() if not (up or front) else even_rotations(_DENSE)
    to_scan = file_frame(path)
    for axis, own in ((up, frame[0]), (front, frame[1])):
        if axis:
            cosine = rotations @ own @ (to_scan @ np.array(AXES[axis], dtype=np.float64))
            rotations = rotations[cosine > np.cos(np.radians(_WITHIN_DEG))]
    return rotations


def require_axes(up: str, front: str) -> None:
    """Raises `InputError` for an axis that is none, or two along one line."""
    for flag, axis in (("up", up), ("front", front)):
        if axis and axis not in AXES:
            raise InputError(f"--body-{flag} '{axis}' is not an axis", f"Axes: {', '.join(AXES)}.")
    if up and front and up[-1] == front[-1]:
        raise InputError(
            f"--body-up {up} and --body-front {front} lie along one line", "Give two axes that are square."
        )


def turn_note(
    rotation: Float64[np.ndarray, "3 3"],
    frame: tuple[np.ndarray, np.ndarray],
    up: str,
    front: str,
    path: Path,
) -> str:
    """Where up and front are in the file.  rotation : part to scan."""
    own = [file_frame(path).T @ rotation @ axis for axis in frame]
    said = [f"{name} is {_worded(axis)}" for name, axis in zip(("up", "front"), own, strict=True)]
    given = [name for name, axis in (("up", up), ("front", front)) if axis]
    how = f"with {' and '.join(given)} as given" if given else "found from the shape"
    return f"In the file {said[0]} and {said[1]} ({how}); the scan was turned upright."


def _worded(axis: Float64[np.ndarray, "3"]) -> str:
    """A direction as the axis it lies within 15 degrees of, or as its components."""
    for name, unit in AXES.items():
        if axis @ np.array(unit) > np.cos(np.radians(15.0)):
            return name
    return "({:.2f}, {:.2f}, {:.2f})".format(*axis)
