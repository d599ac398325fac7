"""`read_mesh`: known shapes come back in millimetres, hostile files end in one clear sentence."""

import json
import struct
import zipfile

import numpy as np
import pytest
import trimesh

from fabcraft.errors import InputError
from fabcraft.read.mesh_file import read_mesh

BOX = trimesh.creation.box((20.0, 30.0, 40.0))


def written(tmp_path, kind, mesh=BOX, name="part"):
    path = tmp_path / f"{name}.{kind}"
    data = mesh.export(file_type=kind)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def threemf(path, vertices, faces, unit="millimeter", item="", extra="", head=""):
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?>{head}<model unit="{unit}" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1" type="model"><mesh><vertices>{points}</vertices>'
        f"<triangles>{triangles}</triangles></mesh></object>{extra}</resources>"
        f'<build><item objectid="1" {item}/></build></model>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(
            "[Content_Types].xml",
            '<?xml version="1.0"?>'
            '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
            '<Default Extension="rels" '
            'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            '<Default Extension="model" '
            'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
            "</Types>",
        )
        archive.writestr(
            "_rels/.rels",
            '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/'
            'relationships"><Relationship Id="r" Target="/3D/3dmodel.model" '
            'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>',
        )
        archive.writestr("3D/3dmodel.model", model)
    return path


@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
def test_a_box_without_a_unit_is_read_as_millimetres(tmp_path, kind):
    mesh = read_mesh(written(tmp_path, kind))
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    assert mesh.volume_mm3 == pytest.approx(24000)
    assert mesh.name == "part"


@pytest.mark.parametrize(("units", "scale"), [("mm", 1), ("cm", 10), ("m", 1000), ("in", 25.4)])
def test_a_given_unit_scales_the_mesh(tmp_path, units, scale):
    assert read_mesh(written(tmp_path, "stl"), units).size_mm == pytest.approx(np.array([20, 30, 40]) * scale)


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_gltf_in_metres_with_y_up_becomes_millimetres_with_z_up(tmp_path, kind):
    box = trimesh.creation.box((0.02, 0.04, 0.03))
    box.apply_translation((0.0, 0.02, 0.1))  # stands on the floor, 0.1 m towards the viewer
    path = tmp_path / f"part.{kind}"
    data = box.export(file_type="glb") if kind == "glb" else None
    if data is None:
        files = box.export(file_type="gltf", embed_buffers=True)
        data = files["model.gltf"]
    path.write_bytes(data)
    mesh = read_mesh(path)
    assert mesh.bounds == pytest.approx(np.array([[-10, -115, 0], [10, -85, 40]]), abs=1e-3)
    assert mesh.volume_mm3 == pytest.approx(24000, rel=1e-4)


def test_the_unit_and_the_placement_of_a_3mf_are_honoured(tmp_path):
    path = threemf(
        tmp_path / "part.3mf",
        BOX.vertices / 10,
        BOX.faces,
        "centimeter",
        'transform="0 1 0 -1 0 0 0 0 1 5 0 0"',
    )
    mesh = read_mesh(path)
    assert mesh.size_mm == pytest.approx([30, 20, 40])
    assert mesh.bounds.mean(0) == pytest.approx([50, 0, 0])
    assert mesh.volume_mm3 == pytest.approx(24000)


def test_a_scene_keeps_every_placed_copy(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(BOX, node_name="a")
    scene.add_geometry(BOX, node_name="b", transform=trimesh.transformations.translation_matrix((100, 0, 0)))
    path = tmp_path / "two.glb"
    path.write_bytes(scene.export(file_type="glb"))
    assert len(read_mesh(path, "mm").faces) == 24


def refused(path, *words, units=None):
    with pytest.raises(InputError) as caught:
        read_mesh(path, units)
    for word in words:
        assert word in str(caught.value)


def test_a_missing_file_a_folder_and_an_empty_file_are_refused(tmp_path):
    refused(tmp_path / "none.stl", "no file")
    refused(tmp_path, "folder")
    empty = tmp_path / "empty.stl"
    empty.touch()
    refused(empty, "empty")


def test_an_unknown_format_or_unit_is_refused_with_the_list(tmp_path):
    other = tmp_path / "part.step"
    other.write_text("ISO-10303-21;")
    refused(other, "STL", "3MF")
    refused(written(tmp_path, "stl"), "parsec", "mm, cm, m, in", units="parsec")


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "glb", "gltf", "3mf"])
@pytest.mark.parametrize(
    "junk", [b"\x00" * 200, b"this is a letter, not a mesh\n" * 20, b"{}", b"\xff\xd8\xff\xe0" * 50]
)
def test_files_that_are_no_mesh_are_refused(tmp_path, kind, junk):
    path = tmp_path / f"junk.{kind}"
    path.write_bytes(junk)
    refused(path, "junk")


@pytest.mark.parametrize("kind", ["stl", "ply", "glb", "3mf"])
def test_a_file_cut_in_half_is_refused(tmp_path, kind):
    path = (
        written(tmp_path, kind, trimesh.creation.icosphere(3))
        if kind != "3mf"
        else threemf(tmp_path / "part.3mf", BOX.vertices, BOX.faces)
    )
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    refused(path, "part")


def test_a_coordinate_that_is_no_number_is_refused(tmp_path):
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n")
    refused(path, "finite")


def test_points_without_faces_are_refused(tmp_path):
    path = tmp_path / "cloud.ply"
    path.write_bytes(trimesh.PointCloud(np.eye(3)).export(file_type="ply"))
    refused(path, "no triangles")


def test_too_large_files_and_meshes_are_refused(tmp_path, monkeypatch):
    path = written(tmp_path, "stl")
    monkeypatch.setattr("fabcraft.read.mesh_file.MAX_FACES", 11)
    refused(path, "12 triangles")
    monkeypatch.setattr("fabcraft.read.mesh_file.MAX_BYTES", 100)
    refused(path, "MB")


def test_a_mesh_of_many_kilometres_is_refused(tmp_path):
    far = BOX.copy()
    far.apply_scale(1e6)
    refused(written(tmp_path, "stl", far), "km")


def test_a_zip_bomb_is_refused_before_it_is_unpacked(tmp_path):
    path = tmp_path / "bomb.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b"\x00" * 50_000_000)
    refused(path, "unpack")


def test_an_archive_that_lies_about_its_size_is_refused(tmp_path):
    path = tmp_path / "liar.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b"\x00" * 50_000_000)
    small = struct.pack("<I", 1000)
    path.write_bytes(path.read_bytes().replace(struct.pack("<I", 50_000_000), small))
    refused(path, "liar")


def test_xml_entities_in_a_3mf_are_not_expanded(tmp_path):
    head = '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
    path = threemf(tmp_path / "entities.3mf", BOX.vertices, BOX.faces, head=head)
    try:
        mesh = read_mesh(path)
    except InputError:
        return
    assert mesh.volume_mm3 == pytest.approx(24000)


def test_a_material_library_beside_an_obj_is_never_opened(tmp_path):
    path = tmp_path / "part.obj"
    (tmp_path / "secret.mtl").write_text("newmtl a\nmap_Kd ../../secret.png\n")
    path.write_text(
        "mtllib secret.mtl\nmtllib ../../../etc/passwd\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    )
    assert len(read_mesh(path).faces) == 1


@pytest.mark.parametrize(
    "uri", ["../../etc/passwd", "geometry.bin", "file:///etc/passwd", "http://example.org/a"]
)
def test_a_gltf_with_an_external_buffer_is_refused(tmp_path, uri):
    path = tmp_path / "part.gltf"
    path.write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 4}]}))
    refused(path, "another file", uri)


def test_a_gltf_that_announces_more_than_it_holds_is_refused(tmp_path):
    accessor = {"count": 10**9, "componentType": 5126, "type": "VEC3"}
    tree = {"asset": {"version": "2.0"}, "accessors": [accessor]}
    path = tmp_path / "part.gltf"
    path.write_text(json.dumps(tree))
    refused(path, "announces")


def test_reading_twice_gives_the_same_bytes(tmp_path):
    path = written(tmp_path, "stl", trimesh.creation.icosphere(3))
    first, second = read_mesh(path), read_mesh(path)
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()
