"""GLB (binary glTF 2.0): for viewers, phones and shops.

glTF wants metres with Y up and the front towards +Z; fabcraft has millimetres with Z up and the front
towards -Y: (x, y, z) mm becomes (x, z, -y) / 1000. Vertices are split at creases so that every viewer
shades them alike.
"""

import json
import struct
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import UInt8

from fabcraft import __version__
from fabcraft.mesh import Mesh
from fabcraft.write.colours import OBJECT, to_linear
from fabcraft.write.normals import split_at_creases

_FLOAT, _UNSIGNED, _BYTE = 5126, 5125, 5121
_ARRAY, _ELEMENTS = 34962, 34963


def glb_bytes(
    meshes: Sequence[Mesh],
    *,
    title: str,
    metadata: Mapping[str, str],
    colours: Sequence[UInt8[np.ndarray, "_ 3"] | None] | None = None,
) -> bytes:
    """The GLB of `meshes`, one node each; `colours`: sRGB (V, 3) per mesh, or None for the house blue."""
    package = _Package()
    nodes, shapes = [], []
    for index, mesh in enumerate(meshes):
        shade = None if colours is None else colours[index]
        shapes.append(
            {"primitives": [_primitive(package, mesh, shade)], "name": mesh.name or f"part {index + 1}"}
        )
        nodes.append({"mesh": index, "name": shapes[-1]["name"]})
    document = {
        "asset": {
            "version": "2.0",
            "generator": f"fabcraft {__version__}",
            "extras": {"title": title, **metadata},
        },
        "scene": 0,
        "scenes": [{"name": title, "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": shapes,
        "materials": [_material("object", to_linear(np.array(OBJECT))), _material("coloured", np.ones(3))],
        "accessors": package.accessors,
        "bufferViews": package.views,
        "buffers": [{"byteLength": len(package.data)}],
    }
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode("utf-8", "replace")
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(package.data)
    return b"".join([
        struct.pack("<4sII", b"glTF", 2, length),
        struct.pack("<I4s", len(text), b"JSON"), text,
        struct.pack("<I4s", len(package.data), b"BIN\0"), bytes(package.data),
    ])  # fmt: skip


class _Package:
    """The binary buffer with its views and accessors, filled one array at a time."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict] = []
        self.accessors: list[dict] = []

    def add(self, array: np.ndarray, kind: str, component: int, target: int, **extra: object) -> int:
        """Append `array` (its rows 4-byte aligned); returns the accessor's index."""
        self.views.append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes, "target": target}
        )
        self.data += array.tobytes()
        self.data += b"\0" * (-len(self.data) % 4)
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": component,
                "count": len(array),
                "type": kind,
                **extra,
            }
        )
        return len(self.accessors) - 1


def _primitive(package: _Package, mesh: Mesh, colours: UInt8[np.ndarray, "V 3"] | None) -> dict:
    """Positions, normals, colours and indices of one mesh in the package."""
    source, faces, normals = split_at_creases(mesh)
    positions = (_y_up(mesh.vertices) / 1000.0).astype("<f4")[source]
    box = {"min": positions.min(0).tolist(), "max": positions.max(0).tolist()}
    attributes = {
        "POSITION": package.add(positions, "VEC3", _FLOAT, _ARRAY, **box),
        # a corner without area has no normal; glTF asks for unit length
        "NORMAL": package.add(
            _y_up(np.where((normals**2).sum(1, keepdims=True) > 0.5, normals, (0.0, 0.0, 1.0))).astype("<f4"),
            "VEC3",
            _FLOAT,
            _ARRAY,
        ),
    }
    if colours is not None:
        light = np.round(to_linear(colours[source] / 255.0) * 255.0)
        rgba = np.column_stack([light, np.full(len(source), 255.0)]).astype(np.uint8)
        attributes["COLOR_0"] = package.add(rgba, "VEC4", _BYTE, _ARRAY, normalized=True)
    indices = package.add(faces.reshape(-1).astype("<u4"), "SCALAR", _UNSIGNED, _ELEMENTS)
    return {"attributes": attributes, "indices": indices, "material": 0 if colours is None else 1}


def _y_up(vectors: np.ndarray) -> np.ndarray:
    """Z up to Y up, a rotation about x by -90°."""
    return np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], axis=1)


def _material(name: str, light: np.ndarray) -> dict:
    """A matt plastic."""
    return {
        "name": name,
        "doubleSided": True,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*np.round(light, 6).tolist(), 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.55,
        },
    }
