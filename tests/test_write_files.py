"""Files: what was written comes back, equal input gives equal bytes, a failed write leaves nothing behind."""

import io
import json
import resource
import shutil
import signal
import struct
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import lib3mf
import numpy as np
import pytest
import trimesh

from fabcraft.errors import InputError, SolidError
from fabcraft.mesh import Mesh
from fabcraft.write import atomic
from fabcraft.write.atomic import write_atomically
from fabcraft.write.files import EXTENSIONS, checked_extension, write_mesh
from fabcraft.write.threemf import REPORT_PART, read_recipe, read_report


def ring(name: str = "ring") -> Mesh:
    """A torus of 1,280 faces, 20 mm across."""
    shape = trimesh.creation.torus(8.0, 2.0, major_sections=32, minor_sections=20)
    return Mesh(np.array(shape.vertices), np.array(shape.faces, dtype=np.int32), name)


def sheet() -> Mesh:
    """One open square."""
    return Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
    )


def read_strictly(path: Path):
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    return model, reader


@pytest.mark.parametrize("extension", [".stl", ".ply", ".glb"])
def test_a_mesh_comes_back_from_every_plain_format(tmp_path: Path, extension: str) -> None:
    mesh = ring()
    path = write_mesh(tmp_path / f"part{extension}", [mesh])
    loaded = trimesh.load_mesh(path)
    loaded.merge_vertices(merge_norm=True)
    vertices = loaded.vertices
    if extension == ".glb":  # metres, y up -> millimetres, z up
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1) * 1000.0
    back = Mesh(np.array(vertices), np.array(loaded.faces, dtype=np.int32))
    assert loaded.is_watertight
    assert np.allclose(back.bounds, mesh.bounds, atol=1e-5)
    assert back.volume_mm3 == pytest.approx(mesh.volume_mm3, rel=1e-5)
    assert len(back.faces) == len(mesh.faces)


def test_ply_keeps_every_bit_of_a_position_and_the_colours(tmp_path: Path) -> None:
    mesh = ring()
    colours = np.random.default_rng(0).integers(0, 255, (len(mesh.vertices), 3)).astype(np.uint8)
    loaded = trimesh.load_mesh(write_mesh(tmp_path / "a.ply", mesh, colours=[colours]), process=False)
    assert np.array_equal(loaded.vertices, mesh.vertices)
    assert np.array_equal(loaded.visual.vertex_colors[:, :3], colours)


def test_stl_is_binary_with_the_length_that_its_header_says(tmp_path: Path) -> None:
    data = write_mesh(tmp_path / "a.STL", ring()).read_bytes()
    assert not data.startswith(b"solid")
    assert len(data) == 84 + 50 * struct.unpack("<I", data[80:84])[0]


def test_3mf_reads_back_strictly_without_a_warning(tmp_path: Path) -> None:
    first, second = ring("left"), ring("right")
    path = write_mesh(tmp_path / "pair.3mf", [first, second], title="Pair", metadata={"Designer": "Ana"})
    model, reader = read_strictly(path)
    assert reader.GetWarningCount() == 0
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    items, names, counts = model.GetBuildItems(), [], []
    while items.MoveNext():
        mesh = model.GetMeshObjectByID(items.GetCurrent().GetObjectResource().GetResourceID())
        assert mesh.IsManifoldAndOriented()
        names.append(mesh.GetName())
        counts.append(mesh.GetTriangleCount())
    assert names == ["left", "right"]
    assert counts == [len(first.faces), len(second.faces)]


def test_3mf_carries_metadata_recipe_report_and_thumbnail(tmp_path: Path) -> None:
    recipe, report = 'template = "mask"\n# ü <&>\n', json.dumps({"schema": 1})
    path = write_mesh(
        tmp_path / "a.3mf",
        ring(),
        title="A <b>cat</b> & \x0b co",
        metadata={"LicenseTerms": "CC0", "printer profile": "mk4"},
        recipe=recipe,
        report_json=report,
        thumbnail_png=b"\x89PNG\r\n\x1a\nrest",
    )
    model, reader = read_strictly(path)
    group = model.GetMetaDataGroup()
    entries = [group.GetMetaData(index) for index in range(group.GetMetaDataCount())]
    known = {entry.GetName(): entry.GetValue() for entry in entries}
    assert reader.GetWarningCount() == 0
    assert known["Title"] == "A <b>cat</b> &  co"
    assert known["Application"].startswith("fabcraft ")
    assert known["LicenseTerms"] == "CC0"
    assert known["printer_profile"] == "mk4"
    assert "CreationDate" not in known
    assert read_recipe(path) == recipe
    assert read_report(path) == report
    assert zipfile.ZipFile(path).read("Metadata/thumbnail.png").startswith(b"\x89PNG")


def test_3mf_without_a_recipe_has_none_and_other_files_are_refused(tmp_path: Path) -> None:
    assert read_recipe(write_mesh(tmp_path / "a.3mf", ring())) is None
    (tmp_path / "no.3mf").write_bytes(b"not a zip")
    for path in (tmp_path / "no.3mf", tmp_path / "absent.3mf"):
        with pytest.raises(InputError):
            read_recipe(path)


def test_a_recipe_that_unpacks_to_megabytes_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.3mf", "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr(REPORT_PART, b" " * 50_000_000)
    with pytest.raises(InputError, match="larger than"):
        read_report(tmp_path / "bomb.3mf")


def test_3mf_packs_with_valid_time_stamps_and_content_types_first(tmp_path: Path) -> None:
    package = zipfile.ZipFile(write_mesh(tmp_path / "a.3mf", ring()))
    assert package.testzip() is None
    assert package.namelist()[0] == "[Content_Types].xml"
    assert {entry.date_time for entry in package.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_3mf_of_an_open_surface_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(SolidError, match="not a closed"):
        write_mesh(tmp_path / "sheet.3mf", sheet())
    assert list(tmp_path.iterdir()) == []
    write_mesh(tmp_path / "sheet.ply", sheet())


def test_trimesh_reads_the_3mf_at_the_same_size(tmp_path: Path) -> None:
    pytest.importorskip("lxml", reason="trimesh reads 3MF with lxml")
    scene = trimesh.load(write_mesh(tmp_path / "a.3mf", ring()))
    assert np.allclose(scene.bounds, ring().bounds, atol=1e-5)


@pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="needs prusa-slicer")
def test_prusa_slicer_finds_a_manifold_of_the_same_volume(tmp_path: Path) -> None:
    path = write_mesh(tmp_path / "a.3mf", ring(), recipe="a = 1\n", report_json="{}")
    text = subprocess.run(["prusa-slicer", "--info", path], capture_output=True, text=True).stdout
    facts = dict(line.split(" = ") for line in text.splitlines() if line.count(" = ") == 1)
    assert facts["manifold"] == "yes"
    assert float(facts["volume"]) == pytest.approx(ring().volume_mm3, rel=1e-5)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_equal_input_gives_equal_bytes_and_other_input_other_bytes(tmp_path: Path, extension: str) -> None:
    first = write_mesh(tmp_path / f"a{extension}", ring(), title="t", recipe="a = 1").read_bytes()
    time.sleep(0.01)
    again = write_mesh(tmp_path / f"b{extension}", ring(), title="t", recipe="a = 1").read_bytes()
    moved = ring().with_vertices(ring().vertices + 1.0)
    other = write_mesh(tmp_path / f"c{extension}", moved, title="t", recipe="a = 1").read_bytes()
    assert first == again
    assert first != other


def test_3mf_does_not_depend_on_the_clock(tmp_path: Path) -> None:
    first = write_mesh(tmp_path / "a.3mf", ring(), title="t").read_bytes()
    time.sleep(2.1)  # a zip's clock ticks every two seconds
    assert write_mesh(tmp_path / "b.3mf", ring(), title="t").read_bytes() == first


def test_glb_is_valid_in_its_frame_and_says_its_bounds(tmp_path: Path) -> None:
    data = write_mesh(tmp_path / "a.glb", ring(), title='</script>"').read_bytes()
    magic, version, length, size, kind = struct.unpack("<4sIII4s", data[:20])
    document = json.loads(data[20 : 20 + size])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    position = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    assert np.allclose(position["max"], [0.010, 0.002, 0.010])
    assert all(view["byteOffset"] % 4 == 0 for view in document["bufferViews"])
    assert document["buffers"][0]["byteLength"] == len(data) - 28 - size


def test_an_unknown_extension_is_refused_with_the_known_ones() -> None:
    for path in ("part.obj", "part"):
        with pytest.raises(InputError) as caught:
            checked_extension(path)
        assert all(extension in str(caught.value) for extension in EXTENSIONS)


def test_nothing_to_write_is_an_error(tmp_path: Path) -> None:
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))
    for meshes in ([], [empty]):
        with pytest.raises(InputError, match="nothing to write"):
            write_mesh(tmp_path / "a.stl", meshes)


def test_a_missing_folder_a_folder_and_a_file_in_the_path_are_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for path, reason in (
        (tmp_path / "absent" / "a.stl", "folder does not exist"),
        (tmp_path, "there is a folder"),
        (tmp_path / "file" / "a.stl", "not a folder"),
        (tmp_path / ("n" * 300), "too long"),
        (tmp_path / "nul\0byte", "null"),
    ):
        with pytest.raises(InputError, match=reason):
            write_atomically(path, b"data")


@pytest.mark.parametrize("unnamed", [True, False])
def test_a_failed_rename_leaves_the_target_and_no_temporary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unnamed: bool
) -> None:
    target = tmp_path / "a.stl"
    target.write_bytes(b"before")
    if not unnamed:
        monkeypatch.delattr(atomic.os, "O_TMPFILE")

    def refuse(self: Path, other: Path) -> None:
        raise PermissionError(13, "denied")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(InputError, match="no permission"):
        write_atomically(target, b"after")
    assert target.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("unnamed", [True, False])
def test_a_file_larger_than_the_system_allows_leaves_the_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unnamed: bool
) -> None:
    target = tmp_path / "a.bin"
    write_atomically(target, b"before")
    if not unnamed:
        monkeypatch.delattr(atomic.os, "O_TMPFILE")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
        with pytest.raises(InputError, match="larger than the system allows"):
            write_atomically(target, bytes(1_000_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert target.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [target]


def test_a_full_disk_is_named_and_leaves_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.bin"
    write_atomically(target, b"before")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic.os, "fsync", full)
    with pytest.raises(InputError, match="disk is full"):
        write_atomically(target, b"after")
    assert target.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [target]


def test_an_interrupt_leaves_the_target_and_no_temporary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "a.bin"
    write_atomically(target, b"before")

    def interrupt(handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(atomic.os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(target, b"after")
    assert target.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.skipif(not hasattr(atomic.os, "O_TMPFILE"), reason="needs unnamed files")
def test_a_killed_process_leaves_the_target_and_no_temporary(tmp_path: Path) -> None:
    target = tmp_path / "a.bin"
    write_atomically(target, b"before")
    code = (
        "import os, signal, sys\n"
        "from fabcraft.write import atomic\n"
        "atomic.os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)\n"
        "atomic.write_atomically(sys.argv[1], b'after')\n"
    )
    done = subprocess.run([sys.executable, "-c", code, target])
    assert done.returncode == -signal.SIGKILL
    assert target.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [target]


def test_permissions_and_links_stay_as_they_were(tmp_path: Path) -> None:
    real, link = tmp_path / "real.bin", tmp_path / "link.bin"
    real.write_bytes(b"before")
    real.chmod(0o640)
    link.symlink_to(real)
    write_atomically(link, b"after")
    assert link.is_symlink()
    assert real.read_bytes() == b"after"
    assert real.stat().st_mode & 0o777 == 0o640


def test_a_device_is_written_to_and_not_replaced() -> None:
    write_atomically("/dev/null", b"data")
    assert Path("/dev/null").is_char_device()


def test_the_write_room_does_not_import_torch() -> None:
    code = (
        "import sys, fabcraft.write.files, fabcraft.write.page, fabcraft.write.maps\n"
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_a_3mf_is_a_zip_without_extra_fields_that_old_slicers_stumble_over(tmp_path: Path) -> None:
    data = write_mesh(tmp_path / "a.3mf", ring()).read_bytes()
    assert all(entry.extra == b"" for entry in zipfile.ZipFile(io.BytesIO(data)).infolist())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_device_without_room_says_that_it_is_full() -> None:
    with pytest.raises(InputError, match="disk is full"):
        write_atomically("/dev/full", b"data")
