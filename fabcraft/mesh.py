"""`Mesh`: the one currency between the stages.

Millimetres, Z up, right-handed, faces counter-clockwise seen from outside. Frozen; functions return new meshes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64, Int32

from fabcraft.errors import InputError


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    vertices : (V, 3) float64, millimetres.
    faces : (F, 3) int32, indices into `vertices`.
    name : what a slicer or a report calls it.

    Raises `InputError` when a coordinate is not finite or an index is out of range.
    """

    vertices: Float64[np.ndarray, "V 3"]
    faces: Int32[np.ndarray, "F 3"]
    name: str = field(default="")

    def __post_init__(self) -> None:
        # Always a copy: the arrays are made read-only, and a caller's own array must stay writable.
        vertices = np.array(self.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.array(self.faces, dtype=np.int32).reshape(-1, 3)
        if not np.isfinite(vertices).all():
            raise InputError(
                f"mesh {self.name or '(unnamed)'} has {int((~np.isfinite(vertices)).any(1).sum())} vertices "
                "with a coordinate that is not a finite number",
                "Re-export it from the program that made it.",
            )
        if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise InputError(
                f"mesh {self.name or '(unnamed)'} has a face index outside its {len(vertices)} vertices",
                "Re-export it from the program that made it.",
            )
        vertices.setflags(write=False)
        faces.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @property
    def bounds(self) -> Float64[np.ndarray, "2 3"]:
        """Lowest and highest corner of the axis-aligned box, mm."""
        return np.stack([self.vertices.min(0), self.vertices.max(0)])

    @property
    def size_mm(self) -> Float64[np.ndarray, "3"]:
        """Side lengths of the axis-aligned box, mm."""
        lower, upper = self.bounds
        return upper - lower

    @property
    def corners(self) -> Float64[np.ndarray, "F 3 3"]:
        """The three corners of every face, mm."""
        return self.vertices[self.faces]

    @property
    def area_vectors(self) -> Float64[np.ndarray, "F 3"]:
        """Face normal times face area, mm²."""
        a, b, c = self.corners.transpose(1, 0, 2)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def face_areas(self) -> Float64[np.ndarray, "F"]:
        """Area of every face, mm²."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @property
    def face_normals(self) -> Float64[np.ndarray, "F 3"]:
        """Unit normal of every face; zero for a face without area."""
        vectors = self.area_vectors
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)

    @property
    def vertex_normals(self) -> Float64[np.ndarray, "V 3"]:
        """Area-weighted unit normal of every vertex; zero where no face has area."""
        normals = np.zeros_like(self.vertices)
        vectors = self.area_vectors
        for corner in range(3):
            np.add.at(normals, self.faces[:, corner], vectors)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)

    @property
    def area_mm2(self) -> float:
        """Surface area, mm²."""
        return float(self.face_areas.sum())

    @property
    def volume_mm3(self) -> float:
        """Signed volume by the divergence theorem, mm³; meaningful for a closed mesh."""
        a, b, c = self.corners.transpose(1, 0, 2)
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)

    def transformed(self, matrix: Float64[np.ndarray, "4 4"]) -> "Mesh":
        """The mesh moved by an affine `matrix`; a mirroring one turns the faces so that outside stays outside."""
        moved = self.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        mirrored = np.linalg.det(matrix[:3, :3]) < 0
        return Mesh(moved, self.faces[:, ::-1] if mirrored else self.faces, self.name)

    def with_vertices(self, vertices: Float64[np.ndarray, "V 3"]) -> "Mesh":
        """The same connectivity at new positions."""
        return Mesh(vertices, self.faces, self.name)

    def submesh(self, keep: np.ndarray) -> "Mesh":
        """The faces where `keep` (boolean mask or face indices) says so, without unused vertices."""
        faces = self.faces[keep]
        used, compact = np.unique(faces, return_inverse=True)
        return Mesh(self.vertices[used], compact.reshape(-1, 3).astype(np.int32), self.name)


def concatenate(meshes: Sequence[Mesh], name: str = "") -> Mesh:
    """All `meshes` side by side in one, as separate parts."""
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(offset) for mesh, offset in zip(meshes, offsets, strict=True)]),
        name,
    )
