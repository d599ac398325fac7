"""A mesh file becomes a `Mesh` in millimetres, or an `InputError` that says what is wrong with it.

STL, OBJ and PLY carry no unit and are taken as millimetres unless `units` says otherwise; GLB and glTF are
metres with Y up by their standard and are turned to Z up; 3MF names its unit.  Nothing outside the file
itself is ever opened: materials, textures and external buffers are refused.
"""

import io
import json
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int, Int32

from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.read.threemf_file import read_threemf, together

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
"""Names of units and their length in mm."""

MAX_BYTES = 500_000_000
MAX_FACES = 5_000_000
MAX_SIZE_MM = 1e6

_SILENT = logging.NullHandler()
FORMATS = ("stl", "obj", "ply", "glb", "gltf", "3mf")


def read_mesh(path: Path | str, units: str | None = None, largest_mm: float = MAX_SIZE_MM) -> Mesh:
    """The surface in the file `path`, mm, Z up, identical vertices merged.

    units : mm, cm, m or in; overrides what the format says.  largest_mm : a longer mesh is refused; its unit is wrong.
    Raises `InputError` for a file that is missing, empty, no mesh, too large, or refers to other files.
    """
    path = Path(path)
    if units is not None and units not in UNITS_MM:
        raise InputError(f"'{units}' is not a unit", f"Units: {', '.join(UNITS_MM)}.")
    kind = _checked_kind(path)
    if kind == "3mf":
        mesh, file_mm = read_threemf(path, MAX_FACES)
    else:
        mesh, file_mm = _read_with_trimesh(path, kind), 1000.0 if kind in ("glb", "gltf") else 1.0
    vertices = mesh.vertices * (file_mm if units is None else UNITS_MM[units])
    if kind in ("glb", "gltf"):
        vertices = vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0]  # Y up to Z up: a quarter turn about x
    vertices, faces = merged(vertices, mesh.faces)
    if not len(faces):
        raise InputError(f"{path.name} holds no triangle with an area", "Export a mesh with faces.")
    mesh = Mesh(vertices, faces, path.stem)  # raises for coordinates that are not finite
    if mesh.size_mm.max() > largest_mm:
        raise InputError(
            f"{path.name} would be {mesh.size_mm.max() / 1e6:.3g} km large", "Check the unit, or the export."
        )
    return mesh


def merged(
    vertices: Float64[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Float64[np.ndarray, "W 3"], Int32[np.ndarray, "G 3"]]:
    """Vertices at exactly the same place become one; faces that lose a corner and unused vertices go."""
    rows = np.ascontiguousarray(vertices + 0.0)  # -0.0 and 0.0 are the same place
    _, first, place = np.unique(rows.view("V24").ravel(), return_index=True, return_inverse=True)
    faces = first[place.ravel()][faces]
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    used, compact = np.unique(faces[proper], return_inverse=True)
    return vertices[used], compact.reshape(-1, 3).astype(np.int32)


def _checked_kind(path: Path) -> str:
    """The format by the name's ending, after the checks that need no reading."""
    if path.is_dir():
        raise InputError(f"{path} is a folder, expected a mesh file", "Give one file of the folder.")
    if not path.is_file():
        raise InputError(f"there is no file {path}", "Check the path.")
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InputError(
            f"{path.name} is not a mesh file that can be read",
            f"Formats: {', '.join(name.upper() for name in FORMATS)}.",
        )
    size = path.stat().st_size
    if size == 0:
        raise InputError(f"{path.name} is empty", "Export it again.")
    if size > MAX_BYTES:
        raise InputError(
            f"{path.name} has {size / 1e6:.0f} MB, at most {MAX_BYTES / 1e6:.0f} MB are read",
            "Simplify the mesh in the program that made it.",
        )
    return kind


class _Sealed(Mapping[str, bytes]):
    """What lies beside a file, for trimesh: nothing that it may have."""

    def __getitem__(self, name: str) -> bytes:
        raise InputError(
            f"the file refers to another file, '{str(name)[:80]}', which is not opened",
            "Export one self-contained file (GLB, STL or 3MF).",
        )

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0

    def __bool__(self) -> bool:
        return True  # an empty mapping that counts as none would let trimesh look for files itself


def _read_with_trimesh(path: Path, kind: str) -> Mesh:
    """The surface in the file's own unit and axes."""
    import trimesh

    logging.getLogger("trimesh").addHandler(_SILENT)  # it prints the tracebacks of broken files otherwise
    data = path.read_bytes()
    if kind in ("glb", "gltf"):
        _check_gltf(path, data)
    try:
        with np.errstate(all="ignore"):  # normals of a file that are not numbers; they are not used
            scene = trimesh.load_scene(
                io.BytesIO(data), file_type=kind, resolver=_Sealed(), process=False, skip_materials=True
            )
            parts = _parts(path, scene)
    except InputError:
        raise
    except Exception as error:  # the parsers raise whatever comes up in a broken file
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise InputError(
            f"{path.name} cannot be read as {kind.upper()}: {reason}", "Open it in the program that made it."
        ) from error
    if not parts:
        raise InputError(
            f"{path.name} holds no triangles (a point cloud, curves or nothing)", "Export a mesh with faces."
        )
    return together(parts)


def _parts(path: Path, scene: Any) -> list[Mesh]:
    """Every placed copy of every mesh of a trimesh scene."""
    import trimesh

    placed = [(scene.graph[node], scene.geometry) for node in scene.graph.nodes_geometry]
    placed = [(matrix, geometry[name]) for (matrix, name), geometry in placed]
    meshes = [(matrix, mesh) for matrix, mesh in placed if isinstance(mesh, trimesh.Trimesh)]
    check_face_count(path.name, sum(len(mesh.faces) for _, mesh in meshes))
    return [
        Mesh(
            np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int32), path.stem
        ).transformed(np.asarray(matrix, dtype=np.float64))
        for matrix, mesh in meshes
        if len(mesh.faces)
    ]


def check_face_count(name: str, count: int) -> None:
    """Raises `InputError` above `MAX_FACES` faces."""
    if count > MAX_FACES:
        raise InputError(
            f"{name} has {count:,} triangles, at most {MAX_FACES:,} are read",
            "Simplify the mesh in the program that made it.",
        )


def _check_gltf(path: Path, data: bytes) -> None:
    """Refuses external files and counts that no honest file of this size has, before anything is unpacked."""
    try:
        if data[:4] == b"glTF":
            length = int.from_bytes(data[12:16], "little")
            tree = json.loads(data[20 : 20 + length])
        else:
            tree = json.loads(data)
        counts = [int(accessor.get("count", 0)) for accessor in tree.get("accessors", [])]
        uris = [
            str(item["uri"]) for key in ("buffers", "images") for item in tree.get(key, []) if "uri" in item
        ]
    except (ValueError, AttributeError, TypeError, RecursionError) as error:
        raise InputError(f"{path.name} is not a glTF file", "Export it again as GLB.") from error
    if outside := [uri for uri in uris if not uri.startswith("data:")]:
        _Sealed()[outside[0]]
    if max(counts, default=0) > min(3 * MAX_FACES, len(data)):
        raise InputError(
            f"{path.name} announces {max(counts):,} numbers, which its {len(data):,} bytes cannot hold",
            "Export it again as GLB.",
        )
