"""`write_mesh`: one call, the extension chooses the format.

.3mf : millimetres, for the slicer; carries metadata, recipe, report and thumbnail (the default).
.stl : binary, millimetres, for older slicers; carries nothing but triangles.
.glb : metres, Y up, for viewers.
.ply : binary, millimetres, for meshing tools; may carry colours.
Every file is written whole or not at all, and equal input gives equal bytes.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from fabcraft import __version__
from fabcraft.errors import InputError
from fabcraft.mesh import Mesh
from fabcraft.write.atomic import write_atomically
from fabcraft.write.glb import glb_bytes
from fabcraft.write.threemf import threemf_bytes

EXTENSIONS = (".3mf", ".stl", ".glb", ".ply")
"""What `write_mesh` knows."""


def write_mesh(
    path: str | Path,
    meshes: Sequence[Mesh] | Mesh,
    *,
    title: str = "",
    metadata: Mapping[str, str] | None = None,
    recipe: str | None = None,
    report_json: str | None = None,
    thumbnail_png: bytes | None = None,
    colours: Sequence[UInt8[np.ndarray, "_ 3"] | None] | None = None,
) -> Path:
    """Write `meshes` (mm) to `path`; returns the path.

    title : what a slicer or viewer shows; the file's name when empty.
    metadata : core names such as Designer or LicenseTerms, or own ones (3MF, GLB).
    recipe, report_json, thumbnail_png : carried by 3MF; other formats have no place for them.
    colours : sRGB (V, 3) uint8 per mesh, or None (GLB, PLY).

    Raises `InputError` for an unknown extension, nothing to write or a place that refuses (the target is then
    untouched), `SolidError` when a 3MF is asked of a surface that is not a closed manifold.
    """
    path, extension = Path(path), checked_extension(path)
    meshes = [meshes] if isinstance(meshes, Mesh) else list(meshes)
    if not meshes or not all(len(mesh.faces) for mesh in meshes):
        raise InputError(f"nothing to write to {path}: a mesh without faces", "Check the step before.")
    title, metadata = title or path.stem, metadata or {}
    if extension == ".3mf":
        data = threemf_bytes(
            meshes,
            title=title,
            metadata=metadata,
            recipe=recipe,
            report_json=report_json,
            thumbnail_png=thumbnail_png,
        )
    elif extension == ".glb":
        data = glb_bytes(meshes, title=title, metadata=metadata, colours=colours)
    else:
        data = stl_bytes(meshes) if extension == ".stl" else ply_bytes(meshes, colours)
    return write_atomically(path, data)


def checked_extension(path: str | Path) -> str:
    """The lower-case extension of `path`; ask before hours of work. Raises `InputError` naming all."""
    extension = Path(path).suffix.lower()
    if extension not in EXTENSIONS:
        raise InputError(
            f"cannot write {path}: {extension or 'no extension'} is not a mesh format that fabcraft writes",
            f"End the name in one of {', '.join(EXTENSIONS)}.",
        )
    return extension


def stl_bytes(meshes: Sequence[Mesh]) -> bytes:
    """Binary STL, mm, little-endian, float32; all meshes in one list of triangles."""
    # A header that begins with "solid" makes some readers take the file for text.
    header = f"fabcraft {__version__} binary STL, millimetres".encode().ljust(80, b"\0")
    fields = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records = []
    for mesh in meshes:
        record = np.zeros(len(mesh.faces), dtype=fields)
        record["normal"] = mesh.face_normals
        record["corners"] = mesh.corners
        records.append(record.tobytes())
    count = sum(len(mesh.faces) for mesh in meshes)
    return header + count.to_bytes(4, "little") + b"".join(records)


def ply_bytes(
    meshes: Sequence[Mesh], colours: Sequence[UInt8[np.ndarray, "_ 3"] | None] | None = None
) -> bytes:
    """Binary little-endian PLY, mm: float64 positions, so that nothing is lost; vertex colours where given.

    A mesh without colours among others with them is white.
    """
    coloured = colours is not None and any(colour is not None for colour in colours)
    fields: list[tuple] = [("position", "<f8", 3)]
    if coloured:
        fields.append(("colour", "u1", 3))
    vertex_parts, face_parts, offset = [], [], 0
    for mesh, colour in zip(meshes, colours or [None] * len(meshes), strict=True):
        vertices = np.zeros(len(mesh.vertices), dtype=fields)
        vertices["position"] = mesh.vertices
        if coloured:
            vertices["colour"] = 255 if colour is None else colour
        faces = np.zeros(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        faces["count"] = 3
        faces["corners"] = mesh.faces + offset
        vertex_parts.append(vertices.tobytes())
        face_parts.append(faces.tobytes())
        offset += len(vertices)
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment fabcraft {__version__}, millimetres, Z up",
        f"element vertex {offset}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {channel}" for channel in ("red", "green", "blue") if coloured),
        f"element face {sum(len(mesh.faces) for mesh in meshes)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(head).encode("ascii") + b"".join(vertex_parts) + b"".join(face_parts)
