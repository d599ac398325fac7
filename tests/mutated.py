"""Bytes changed by chance, and files made to do harm."""

import io
import json
import struct
import zipfile

import numpy as np
import trimesh


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """A few bytes changed, sometimes a piece cut out, doubled or cut off, or a number made huge."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        out[rng.integers(len(out))] = rng.integers(256)
    at, length = rng.integers(len(out)), rng.integers(1, 60)
    kind = rng.integers(7)
    if kind == 0:
        del out[at:]
    elif kind == 1:
        del out[at : at + length]
    elif kind == 2:
        out[at:at] = out[at : at + length]
    elif kind == 3:
        at = rng.integers(min(len(out), 400))  # most counts are in the header
        out[at : at + 4] = rng.choice([b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"9999", b"1e99"])
    return bytes(out)


def mutated_zip(data: bytes, rng: np.random.Generator) -> bytes:
    """A package whose parts were changed before they were packed, so that the checksums hold."""
    output = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(data)) as source,
        zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as target,
    ):
        names = source.namelist()
        changed = names[rng.integers(len(names))]
        for name in names:
            part = source.read(name)
            target.writestr(name, mutated(part, rng) if name == changed and part else part)
    return output.getvalue()


def meshes() -> dict[str, bytes]:
    """The same small mesh in every format that is read; two STLs and two PLYs."""
    shape = trimesh.creation.icosphere(2, 20.0)
    out = {
        "ascii.stl": shape.export(file_type="stl_ascii"),
        "binary.stl": shape.export(file_type="stl"),
        "a.obj": shape.export(file_type="obj"),
        "ascii.ply": shape.export(file_type="ply", encoding="ascii"),
        "binary.ply": shape.export(file_type="ply"),
        "a.glb": shape.export(file_type="glb"),
        "a.gltf": shape.export(file_type="gltf", embed_buffers=True)["model.gltf"],
    }
    out = {name: data if isinstance(data, bytes) else data.encode() for name, data in out.items()}
    from fabcraft.mesh import Mesh
    from fabcraft.write.threemf import threemf_bytes

    solid = Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), "ball")
    return {**out, "a.3mf": threemf_bytes([solid], title="ball", metadata={}, recipe='template = "ring"\n')}


def bombs() -> dict[str, bytes]:
    """Files of a few kilobytes that announce, or unpack to, gigabytes."""
    zeros = io.BytesIO()
    with zipfile.ZipFile(zeros, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b"\x00" * 60_000_000)
    nested = io.BytesIO()
    with zipfile.ZipFile(nested, "w", zipfile.ZIP_DEFLATED) as archive:
        for index in range(30):
            archive.writestr(f"{index}.zip", zeros.getvalue())
        archive.writestr("3D/3dmodel.model", b"<model/>")
    header = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face {}\nproperty list {} int vertex_indices\nend_header\n"
    huge = 2_000_000_000
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"count": 3, "componentType": 5126, "type": "VEC3", "sparse": {"count": huge}}],
    }  # fmt: skip
    many = [{"mesh": 0} for _ in range(4_000)]
    copies = json.loads(json.dumps(meshes_tree()))
    copies["nodes"], copies["scenes"] = many, [{"nodes": list(range(len(many)))}]
    return {
        "zeros.3mf": zeros.getvalue(),
        "nested.3mf": nested.getvalue(),
        "count.stl": b"\x00" * 80 + struct.pack("<I", 0xFFFFFFFF) + b"\x00" * 500,
        "count.ply": header.format("binary_little_endian", huge, huge, "uchar").encode() + b"\x00" * 500,
        "count_ascii.ply": header.format("ascii", huge, huge, "uchar").encode() + b"0 0 0\n" * 50,
        "list.ply": header.format("binary_little_endian", 1, 1, "uint").encode()
        + b"\x00" * 12
        + b"\xff" * 400,
        "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 2000000000\n" * 20,
        "face.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + b" 1 2 3" * 100_000 + b"\n",
        "loop.gltf": json.dumps(tree).encode(),
        "copies.gltf": json.dumps(copies).encode(),
        "deep.gltf": b'{"a":' * 100_000,
    }


def meshes_tree() -> dict:
    """A glTF of one mesh of 1,280 faces with its buffers inside."""
    return json.loads(
        trimesh.creation.icosphere(3, 0.02).export(file_type="gltf", embed_buffers=True)["model.gltf"]
    )
