"""The meshes of a 3MF package, placed as on its build plate (3MF core specification 1.3).

A 3MF is a zip archive: its sizes are checked before lib3mf unpacks it, so that a small file cannot fill the
memory.
"""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fabcraft.errors import InputError
from fabcraft.mesh import Mesh

MAX_UNPACKED_BYTES = 1_500_000_000
MAX_RATIO = 200
"""Unpacked to packed size; XML meshes reach 5 to 30."""
SMALL_BYTES = 10_000_000
"""Below this unpacked size no ratio is harmful."""
_MAX_DEPTH = 32

_UNIT_MM = {
    "MicroMeter": 0.001,
    "MilliMeter": 1.0,
    "CentiMeter": 10.0,
    "Inch": 25.4,
    "Foot": 304.8,
    "Meter": 1000.0,
}


def read_threemf(path: Path, max_faces: int) -> tuple[Mesh, float]:
    """(all placed objects in one mesh, in the unit of the file; that unit in mm).

    Raises `InputError` for a file that is no 3MF, unpacks to too much, or holds more than `max_faces` faces.
    """
    check_archive(path)
    from lib3mf import Lib3MF, get_wrapper  # heavy: the native library is loaded where it is needed

    model = get_wrapper().CreateModel()
    try:
        model.QueryReader("3mf").ReadFromFile(str(path))
        parts: list[Mesh] = []
        items = model.GetBuildItems()
        while items.MoveNext():
            item = items.GetCurrent()
            _collect(
                path, model, item.GetObjectResource(), _matrix(item.GetObjectTransform()), parts, max_faces
            )
    except Lib3MF.ELib3MFException as error:
        reason = str(error).splitlines()[0][:120]
        raise InputError(f"{path.name} cannot be read as 3MF: {reason}", "Export it again.") from error
    if not parts:
        raise InputError(f"{path.name} places no mesh on its build plate", "Export the object itself as 3MF.")
    return together(parts), _UNIT_MM[model.GetUnit().name]


def together(parts: Sequence[Mesh]) -> Mesh:
    """All `parts` in one mesh."""
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = [part.faces + offset for part, offset in zip(parts, offsets, strict=True)]
    return Mesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces).astype(np.int32))


def check_archive(path: Path) -> None:
    """Raises `InputError` when the package is no zip archive, is damaged, or would unpack to too much."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            total = sum(entry.file_size for entry in entries)
            packed = sum(entry.compress_size for entry in entries)
            if total > MAX_UNPACKED_BYTES or (total > SMALL_BYTES and total > MAX_RATIO * max(packed, 1)):
                raise InputError(
                    f"{path.name} would unpack from {packed / 1e6:.1f} to {total / 1e6:.0f} MB",
                    "Export it again, or simplify the mesh.",
                )
            damaged = archive.testzip()  # reads at most the announced sizes
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        OSError,
        NotImplementedError,
        RuntimeError,
        ValueError,
    ) as error:
        raise InputError(f"{path.name} is not a 3MF package", "Export it again.") from error
    if damaged is not None:
        raise InputError(f"{path.name} is damaged ('{damaged[:80]}')", "Export or copy it again.")


def _collect(
    path: Path, model: Any, thing: Any, matrix: np.ndarray, parts: list[Mesh], max_faces: int, depth: int = 0
) -> None:
    """Appends `thing`, a mesh or a tree of components, placed by `matrix`."""
    if depth > _MAX_DEPTH:
        raise InputError(f"{path.name} nests its components too deeply", "Export it again as one object.")
    if thing.IsMeshObject():
        mesh = model.GetMeshObjectByID(thing.GetUniqueResourceID())
        count = mesh.GetTriangleCount()
        if count + sum(len(part.faces) for part in parts) > max_faces:
            raise InputError(
                f"{path.name} has more than {max_faces:,} triangles", "Simplify the mesh in its program."
            )
        if count:
            parts.append(_arrays(mesh).transformed(matrix))
    elif thing.IsComponentsObject():
        tree = model.GetComponentsObjectByID(thing.GetUniqueResourceID())
        for index in range(tree.GetComponentCount()):
            component = tree.GetComponent(index)
            below = matrix @ _matrix(component.GetTransform())
            _collect(path, model, component.GetObjectResource(), below, parts, max_faces, depth + 1)


def _arrays(mesh: Any) -> Mesh:
    from lib3mf import Lib3MF

    vertices, faces = mesh.GetVertices(), mesh.GetTriangleIndices()
    positions = (Lib3MF.Position * len(vertices))(*vertices)
    corners = (Lib3MF.Triangle * len(faces))(*faces)
    return Mesh(
        np.frombuffer(positions, dtype=np.float32).reshape(-1, 3).astype(np.float64),
        np.frombuffer(corners, dtype=np.uint32).reshape(-1, 3).astype(np.int32),
    )


def _matrix(transform: Any) -> np.ndarray:
    """lib3mf's 4 x 3 row-vector transform as a (4, 4) column-vector matrix."""
    matrix = np.eye(4)
    matrix[:3] = np.array([list(row) for row in transform.Fields], dtype=np.float64).T
    return matrix
