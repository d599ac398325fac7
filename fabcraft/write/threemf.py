"""3MF: the printable file, with its recipe, report and thumbnail inside.

Millimetres; one mesh object per build item (a slicer's `--info` counts only the first part of a components
object). Names, UUIDs, packing order and time stamps come from the content, so equal input gives equal
bytes. The schema is checked by lib3mf's strict mode; the geometry by `IsManifoldAndOriented`, which strict
mode leaves out. 3MF core specification 1.3 (well-known metadata names), production extension (UUIDs).
"""

import hashlib
import io
import re
import uuid
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fabcraft import __version__
from fabcraft.errors import InputError, SolidError
from fabcraft.mesh import Mesh

NAMESPACE = "urn:fabcraft:3mf:1"
"""Of fabcraft's own metadata and relations inside the package."""
RECIPE_PART = "Metadata/fabcraft_recipe.toml"
REPORT_PART = "Metadata/fabcraft_report.json"
WELL_KNOWN = (
    "Title", "Designer", "Description", "Copyright", "LicenseTerms", "Rating", "CreationDate",
    "ModificationDate", "Application",
)  # fmt: skip
"""Metadata names of the core specification; every other name goes into `NAMESPACE`."""

LARGEST_PART_BYTES = 4_000_000
"""A recipe or report larger than this is not ours: a small zip can unpack to gigabytes."""

_EPOCH = (1980, 1, 1, 0, 0, 0)
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def threemf_bytes(
    meshes: Sequence[Mesh],
    *,
    title: str,
    metadata: Mapping[str, str],
    recipe: str | None = None,
    report_json: str | None = None,
    thumbnail_png: bytes | None = None,
) -> bytes:
    """The 3MF package of `meshes`, mm.

    Raises `SolidError` when a mesh is not a closed, consistently oriented manifold: a 3MF promises a solid.
    """
    from lib3mf import ModelUnit, get_wrapper  # heavy: the native library is loaded where it is needed

    wrapper = get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(ModelUnit.MilliMeter)
    for index, mesh in enumerate(meshes):
        _add_mesh(wrapper, model, mesh, index)
    model.SetBuildUUID(_uuid("build", *(_fingerprint(mesh) for mesh in meshes)))
    _add_metadata(model, title, metadata)
    if thumbnail_png is not None:
        model.CreatePackageThumbnailAttachment().ReadFromBuffer(thumbnail_png)
    for part, text, kind in ((RECIPE_PART, recipe, "toml"), (REPORT_PART, report_json, "json")):
        if text is not None:
            model.AddCustomContentType(kind, f"application/{kind}")
            model.AddAttachment(f"/{part}", f"{NAMESPACE}/{Path(part).stem}").ReadFromBuffer(text.encode())
    writer = model.QueryWriter("3mf")
    writer.SetStrictModeActive(True)
    return _repacked(bytes(writer.WriteToBuffer()))


def read_recipe(path: str | Path) -> str | None:
    """The recipe (TOML text) that a fabcraft 3MF carries, or None. Raises `InputError` for what is no 3MF."""
    return _read_part(path, RECIPE_PART)


def read_report(path: str | Path) -> str | None:
    """The report (JSON text) that a fabcraft 3MF carries, or None. Raises `InputError` for what is no 3MF."""
    return _read_part(path, REPORT_PART)


def clean_text(text: str) -> str:
    """`text` without the control characters that XML 1.0 cannot hold."""
    return _NOT_XML.sub("", text)


def _add_mesh(wrapper: Any, model: Any, mesh: Mesh, index: int) -> None:
    """One mesh object and its build item."""
    import lib3mf

    vertices = np.ascontiguousarray(mesh.vertices, dtype="<f4")
    faces = np.ascontiguousarray(mesh.faces, dtype="<u4")
    item = model.AddMeshObject()
    item.SetName(clean_text(mesh.name) or f"part {index + 1}")
    item.SetGeometry(
        (lib3mf.Position * len(vertices)).from_buffer_copy(vertices.tobytes()),
        (lib3mf.Triangle * len(faces)).from_buffer_copy(faces.tobytes()),
    )
    if not item.IsManifoldAndOriented():
        raise SolidError(
            f"part {mesh.name or index + 1} is not a closed, oriented surface, and a 3MF holds solids",
            "Thicken it first (fabcraft solid), or write it as .ply, .glb or .stl.",
        )
    fingerprint = _fingerprint(mesh)
    item.SetUUID(_uuid("object", str(index), fingerprint))
    model.AddBuildItem(item, wrapper.GetIdentityTransform()).SetUUID(_uuid("item", str(index), fingerprint))


def _add_metadata(model: Any, title: str, metadata: Mapping[str, str]) -> None:
    """Title, application and the maker's metadata, in a fixed order."""
    group = model.GetMetaDataGroup()
    entries = {"Title": title, "Application": f"fabcraft {__version__}"} | dict(metadata)
    for name in WELL_KNOWN:
        if name in entries:
            group.AddMetaData("", name, clean_text(entries[name]), "xs:string", True)
    own = {_xml_name(name): entries[name] for name in sorted(entries.keys() - set(WELL_KNOWN))}
    for name, value in own.items():
        group.AddMetaData(NAMESPACE, name, clean_text(value), "xs:string", True)


def _xml_name(name: str) -> str:
    """`name` as an XML name: letters, digits, - and _, starting with a letter or _."""
    safe = re.sub(r"[^A-Za-z0-9_-]+", "_", name)
    return safe if re.match(r"[A-Za-z_]", safe) else f"_{safe}"


def _fingerprint(mesh: Mesh) -> str:
    """A hash of name, vertices and faces."""
    digest = hashlib.sha256(mesh.name.encode("utf-8", "surrogatepass"))
    digest.update(mesh.vertices.astype("<f8").tobytes() + mesh.faces.astype("<i4").tobytes())
    return digest.hexdigest()


def _uuid(*parts: str) -> str:
    """A UUID that depends on `parts` alone (RFC 4122, version 5)."""
    return str(uuid.uuid5(uuid.uuid5(uuid.NAMESPACE_URL, NAMESPACE), "\n".join(parts)))


def _repacked(package: bytes) -> bytes:
    """The package with valid, fixed time stamps (lib3mf writes month 0) and the content types first, as OPC
    advises."""
    source = zipfile.ZipFile(io.BytesIO(package))
    output = io.BytesIO()
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as target:
        for name in sorted(source.namelist(), key=lambda name: (name != "[Content_Types].xml", name)):
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 0  # the same on every system
            target.writestr(entry, source.read(name))
    return output.getvalue()


def _read_part(path: str | Path, part: str) -> str | None:
    """The text of one part of the package, or None where it has none."""
    try:
        with zipfile.ZipFile(path) as package:
            if part not in package.namelist():
                return None
            if package.getinfo(part).file_size > LARGEST_PART_BYTES:
                raise InputError(
                    f"{path}: {part} is larger than {LARGEST_PART_BYTES} bytes", "Write it again."
                )
            return package.read(part).decode("utf-8")
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist", "Check the path.") from error
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path} is not a readable 3MF: {error}", "Write it again.") from error
