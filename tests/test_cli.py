"""The command line: every command answers, every mistake ends in a sentence, a code and no file."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from drawn import eyes, head, page
from PIL import Image

import fabcraft
from fabcraft.body.human import human
from fabcraft.cli import main
from fabcraft.cli.console import Progress
from fabcraft.cli.make import Flags, recipe_from
from fabcraft.errors import MissingError, SolidError
from fabcraft.read.mesh_file import read_mesh
from fabcraft.write.files import write_mesh

EXAMPLES = Path(__file__).parents[1] / "examples"
CAT = str(EXAMPLES / "cat-mask.png")


def box(path: Path, size: tuple[float, float, float] = (20.0, 30.0, 10.0)) -> str:
    trimesh.creation.box(size).export(path)
    return str(path)


def sheet(path: Path) -> str:
    """A square of 30 mm without thickness."""
    x, y = np.meshgrid(np.linspace(0, 30, 7), np.linspace(0, 30, 7))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(49)])
    corner = (np.arange(6)[:, None] * 7 + np.arange(6)).ravel()
    faces = np.concatenate(
        [np.column_stack([corner, corner + 1, corner + 8]), np.column_stack([corner, corner + 8, corner + 7])]
    )
    trimesh.Trimesh(points, faces, process=False).export(path)
    return str(path)


def drawn(path: Path, image: np.ndarray) -> str:
    Image.fromarray(image).save(path)
    return str(path)


def huge_png(path: Path) -> str:
    """A header of 40,000 x 40,000 pixels and nothing behind it."""
    import struct
    import zlib

    head = b"IHDR" + struct.pack(">IIBBBBB", 40_000, 40_000, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT"))
    )
    return str(path)


def run(*words: str, folder: Path | None = None, **more) -> subprocess.CompletedProcess:
    environment = {**os.environ, "OMP_NUM_THREADS": "2"}
    command = [sys.executable, "-m", "fabcraft", *words]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=120, cwd=folder, env=environment, **more
    )


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    """Run a command that must fail in an empty folder: its stderr, after the checks that hold for every mistake."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)

    def refused(*words: str, code: int = 2) -> str:
        assert main(words) == code
        told = capsys.readouterr()
        assert told.out == ""
        assert "Traceback" not in told.err
        assert "defect" not in told.err
        assert list(work.iterdir()) == []
        return told.err

    return refused


# --- every command answers -------------------------------------------------------------------------------


def test_help_names_every_command_and_code(capsys: pytest.CaptureFixture) -> None:
    assert main([]) == 0
    told = capsys.readouterr().out
    for word in (
        "make",
        "check",
        "solid",
        "guidance",
        "bodies",
        "printers",
        "templates",
        "Exit codes",
        "Examples",
    ):
        assert word in told
    for command in ("make", "check", "solid", "guidance"):
        assert main([command, "--help"]) == 0
        assert f"fabcraft {command}" in capsys.readouterr().out


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == f"fabcraft {fabcraft.__version__}"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["printers"], "prusa-mk4"),
        (["printers", "show", "form4"], "layer_mm"),
        (["bodies"], "woman"),
        (["bodies", "show", "child"], "pronasale"),
        (["templates"], "mask"),
        (["templates", "show", "ring", "--body", "child"], "genus"),
    ],
)
def test_the_lists_answer_in_words_and_in_json(
    capsys: pytest.CaptureFixture, words: list[str], said: str
) -> None:
    assert main(words) == 0
    assert said in capsys.readouterr().out
    assert main([*words, "--json"]) == 0
    json.loads(capsys.readouterr().out)


def test_guidance_says_what_it_understood_in_words_and_in_json(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    sketch = drawn(tmp_path / "head.png", page([head(), *eyes()]))
    assert main(["guidance", sketch]) == 0
    assert "2 eyes" in capsys.readouterr().out
    picture = tmp_path / "seen.png"
    assert main(["guidance", CAT, "--json", "--show-input", str(picture)]) == 0
    told = json.loads(capsys.readouterr().out)
    keys = ["route", "understood", "outline_closed", "holes", "strokes", "residual", "warnings", "files"]
    assert list(told) == keys
    assert told["holes"] == 2
    assert Image.open(picture).size == (1000, 1000)


def test_guidance_takes_a_mesh(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    shape = trimesh.creation.icosphere(4, 1.0)
    shape.apply_scale((80.0, 30.0, 100.0))
    shape.export(tmp_path / "egg.stl")
    assert main(["guidance", str(tmp_path / "egg.stl"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["outline_closed"] is True
    assert told["route"][0].startswith("guidance mesh egg.stl")


def test_bodies_show_tells_asked_and_reached(capsys: pytest.CaptureFixture) -> None:
    words = ["bodies", "show", "woman", "--measure", "wrist=160", "--measure", "ring_finger=US7", "--json"]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["body"] == "woman"
    assert told["measures"]["wrist"] == {
        "asked": 160.0,
        "reached": pytest.approx(160, abs=0.05),
        "unit": "mm",
    }
    assert told["measures"]["ring_finger"]["asked"] == 54.35
    assert told["measures"]["ring_finger"]["size"] == "US 7"
    assert told["measures"]["hand_folded"]["reached"] > told["measures"]["hand"]["reached"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["bodies", "show", "woman", "--measure", "wirst=160"], "did you mean wrist"),
        (["bodies", "show", "woman", "--measure", "wrist"], "name=value"),
        (["bodies", "show", "woman", "--measure", "wrist=300"], "out of reach for woman: it can be"),
        (["bodies", "show", "scan.stl", "--measure", "head=570"], "is a scan, which has its own"),
        (["make", "mask", "--sketch", CAT, "--measure", "head=hut", "-o", "a.3mf"], "is not a size"),
    ],
)
def test_a_wrong_measure_is_refused(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert said in capsys.readouterr().err


def test_bodies_show_draws_parts_places_and_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    from fabcraft.write import bodies

    monkeypatch.setattr(bodies, "SIZE", (410, 355))
    picture = tmp_path / "woman.png"
    assert main(["bodies", "show", "woman", "--picture", str(picture), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["files"] == [str(picture)]
    assert told["size_mm"][2] == pytest.approx(1629, abs=0.1)
    assert told["measures"]["head"] == {"reached": pytest.approx(561, abs=0.1), "unit": "mm"}
    image = np.asarray(Image.open(picture))
    assert image.shape[1] > 2 * 410
    for colour in (bodies._LINE, bodies._DOT):
        assert (np.abs(image.astype(int) - colour).sum(2) < 12).sum() > 50


# --- check -----------------------------------------------------------------------------------------------


def test_a_sound_box_is_printable(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["check", box(tmp_path / "box.stl"), "--printer", "prusa-mk4"]) == 0
    told = capsys.readouterr()
    assert told.out.splitlines()[0] == "Prusa MK4 / MK4S, 0.4 mm nozzle, 0.20 mm layer: printable."
    assert "size 20 x 30 x 10 mm" in told.out
    assert told.err == ""


def test_an_open_box_fails_with_a_page_and_its_bad_faces(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    shape = trimesh.creation.box((20, 20, 20))
    shape.update_faces(np.arange(12) != 3)
    shape.export(tmp_path / "open.stl")
    page, bad = tmp_path / "r.html", tmp_path / "bad.ply"
    words = ["check", str(tmp_path / "open.stl"), "--printer", "prusa-mk4", "--json"]
    assert main([*words, "--html", str(page), "--problems", str(bad)]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["printable"] is False
    assert told["files"] == [str(page), str(bad)]
    assert "Not printable" in page.read_text("utf-8")
    loaded = trimesh.load_mesh(bad, process=False)
    assert len(loaded.faces) == 3  # those around the missing one
    assert (loaded.visual.vertex_colors[:, 0] > 200).all()


def test_a_thin_plate_is_handed_back_in_orange(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    plate = box(tmp_path / "plate.stl", (20.0, 20.0, 0.3))
    bad = tmp_path / "bad.ply"
    assert main(["check", plate, "--printer", "prusa-mk4", "--problems", str(bad)]) == 1
    assert "FAIL wall" in capsys.readouterr().out
    assert (trimesh.load_mesh(bad, process=False).visual.vertex_colors[:, 1] > 120).all()


def test_units_are_taken_at_their_word(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    small = box(tmp_path / "box.stl", (2.0, 3.0, 1.0))
    assert main(["check", small, "--printer", "prusa-mk4", "--units", "cm", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["metrics"]["size_mm"] == [20.0, 30.0, 10.0]


def test_the_slicer_is_asked_on_request(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["check", box(tmp_path / "box.stl"), "--printer", "prusa-mk4", "--slice", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    asked = "slicer_print_seconds" in told["metrics"]
    assert asked or any(finding["check"] == "slicer" for finding in told["findings"])


def test_checking_needs_neither_torch_nor_opencv(tmp_path: Path) -> None:
    box(tmp_path / "box.stl")
    code = (
        "import sys; from fabcraft.cli import main; code = main(['check', 'box.stl', '--printer', 'form4']); "
        "print(code, sorted({'torch', 'cv2', 'open_clip'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, timeout=60
    )
    assert done.stderr.strip() == "0 []"


# --- solid -----------------------------------------------------------------------------------------------


def test_a_sheet_becomes_a_solid_of_the_asked_wall(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    out = tmp_path / "out" / "part.3mf"
    words = [
        "solid",
        sheet(tmp_path / "s.stl"),
        "--wall",
        "2",
        "--printer",
        "prusa-mk4",
        "-o",
        str(out),
        "--json",
    ]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["files"] == [str(out)]
    assert told["metrics"]["open_edges"] == 0
    assert abs(read_mesh(out).size_mm[2] - 2.0) < 0.1


def test_without_a_printer_a_solid_is_only_checked_for_soundness(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert (
        main(["solid", sheet(tmp_path / "s.stl"), "--wall", "2", "-o", str(tmp_path / "p.stl"), "--quiet"])
        == 0
    )
    told = capsys.readouterr()
    assert "No printer was named" in told.out
    assert told.err == ""


def test_a_solid_keeps_clear_of_a_body(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    plate, ball = sheet(tmp_path / "s.stl"), trimesh.creation.icosphere(3, 8.0)
    ball.apply_translation((15, 15, -6))
    ball.export(tmp_path / "ball.stl")
    words = ["solid", plate, "--printer", "prusa-mk4", "--wall", "2", "--body", str(tmp_path / "ball.stl")]
    main([*words, "--clearance", "0.5", "-o", str(tmp_path / "p.stl"), "--json"])
    assert json.loads(capsys.readouterr().out)["metrics"]["clearance_min_mm"] > 0.45


@pytest.mark.parametrize(("error", "code"), [(SolidError("no", "try"), 4), (MissingError("no", "get it"), 3)])
def test_each_kind_of_error_has_its_code(
    refused, tmp_path: Path, monkeypatch, error: Exception, code: int
) -> None:
    from fabcraft.solid import thicken

    def fail(*arguments, **named):
        raise error

    monkeypatch.setattr(thicken, "solidify", fail)
    told = refused("solid", sheet(tmp_path / "s.stl"), "--wall", "2", "-o", "p.3mf", code=code)
    assert told.splitlines()[-2] == "fabcraft: no"


# --- mistakes --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["frobnicate"], "frobnicate"),
        (["mkae", "mask"], "Did you mean"),
        (["make"], "WHAT"),
        (["make", "maks", "-o", "a.3mf"], "did you mean mask"),
        (["make", "mask"], "-o"),
        (["make", "mask", "--json"], "-o"),
        (["make", "mask", "--sketch", CAT], "-o"),
        (["make", "mask", "-o", "a.3mf"], "neither"),
        (["make", "mask", "--sketch", CAT, "--guidance", "b.stl", "-o", "a.3mf"], "both"),
        (["make", "mask", "--sketch", CAT, "--skech", "x", "-o", "a.3mf"], "--skech"),
        (["make", "mask", "--sketch", CAT, "-o", "a.obj"], ".3mf"),
        (["make", "mask", "--sketch", CAT, "-o", "a"], "no extension"),
        (["make", "mask", "--sketch", CAT, "-o", "no/where/a.3mf"], "mkdir -p no/where"),
        (["make", "mask", "--sketch", CAT, "--up", "nan", "-o", "a.3mf"], "finite"),
        (["make", "mask", "--sketch", CAT, "--scale", "7", "-o", "a.3mf"], "0.5 and 2"),
        (["make", "mask", "--sketch", CAT, "--wall", "99", "-o", "a.3mf"], "1.6 and 5"),
        (["make", "mask", "--sketch", CAT, "--preset", "drfat", "-o", "a.3mf"], "draft"),
        (
            ["make", "mask", "--sketch", CAT, "--printer", "prusa-mk44", "-o", "a.3mf"],
            "did you mean prusa-mk4",
        ),
        (["make", "mask", "--sketch", CAT, "--body", "womann", "-o", "a.3mf"], "did you mean woman"),
        (["make", "mask", "--sketch", CAT, "--body", "nowhere.stl", "-o", "a.3mf"], "nowhere.stl"),
        (["make", "mask", "--sketch", CAT, "--body", "man", "--body-units", "ell", "-o", "a.3mf"], "ell"),
        (["make", "nowhere.toml"], "no recipe"),
        (["check", "nowhere.stl", "--printer", "prusa-mk4"], "no file"),
        (["check", "nowhere.stl"], "--printer"),
        (["check", CAT, "--printer", "prusa-mk4"], "not a mesh file"),
        (["check", "x.stl", "--printer", "prusa-mk4", "--problems", "bad.txt"], ".txt"),
        (["solid", "x.stl", "--wall", "2"], "-o"),
        (["solid", "x.stl", "-o", "a.3mf"], "--wall"),
        (["solid", "x.stl", "--wall", "2", "--clearance", "1", "-o", "a.3mf"], "--body"),
        (["solid", "x.stl", "--wall", "0", "-o", "a.3mf"], "0.0 mm"),
        (["printers", "show", "prusa-mk5"], "prusa-mk4"),
        (["bodies", "show", "mann"], "did you mean man"),
        (["bodies", "show", "man", "--picture", "a.jpg"], ".png"),
        (["templates", "show", "helmt"], "did you mean helmet"),
        (["guidance", "nowhere.png"], "no file"),
    ],
)
def test_a_mistake_ends_in_a_sentence_and_code_2(refused, words: list[str], said: str) -> None:
    told = refused(*words)
    assert said in told
    assert told.count("\nfabcraft: ") <= 3  # the stages before it, never a page of text


@pytest.mark.parametrize("command", ["make", "guidance"])
@pytest.mark.parametrize(
    ("make_file", "said"),
    [
        (lambda path: str(path / "none.png"), "there is no file"),
        (lambda path: str(path), "is a folder"),
        (lambda path: str((path / "e.png").write_bytes(b"") or path / "e.png"), "is empty"),
        (lambda path: str((path / "t.png").write_text("a cat") and path / "t.png"), "whatever its name says"),
        (lambda path: drawn(path / "s.png", np.zeros((1, 1, 3), np.uint8)), "1 x 1"),
        (lambda path: huge_png(path / "h.png"), "megapixels"),
        (lambda path: drawn(path / "b.png", np.full((300, 300, 3), 255, np.uint8)), "blank"),
    ],
)
def test_a_sketch_that_is_none_is_refused(
    refused, tmp_path: Path, command: str, make_file, said: str
) -> None:
    sketch = make_file(tmp_path)
    words = ["make", "mask", "--sketch", sketch, "-o", "a.3mf"] if command == "make" else ["guidance", sketch]
    assert said in refused(*words)


def test_two_drawings_on_a_page_are_warned_about(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    from drawn import arc

    path = drawn(tmp_path / "two.png", page([head(), *eyes(), (arc((100.0, 100.0), 95.0), None)]))
    assert main(["guidance", path, "--json"]) == 0
    assert any("drawing" in text for text in json.loads(capsys.readouterr().out)["warnings"])


@pytest.mark.parametrize("command", ["guidance", "make", "check", "solid"])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles"),
        ("", "is empty"),
    ],
)
def test_a_mesh_that_is_none_is_refused(refused, tmp_path: Path, command: str, text: str, said: str) -> None:
    path = tmp_path / "m.obj"
    path.write_text(text)
    words = {
        "guidance": ["guidance", str(path)],
        "make": ["make", "mask", "--guidance", str(path), "-o", "a.3mf"],
        "check": ["check", str(path), "--printer", "prusa-mk4"],
        "solid": ["solid", str(path), "--wall", "2", "-o", "a.3mf"],
    }
    assert said in refused(*words[command])


@pytest.mark.parametrize(
    ("line", "said"),
    [("layer_mm = 'thick'", "layer_mm"), ("layr_mm = 0.2", "layr_mm"), ("layer_mm =", "not valid TOML")],
)
def test_a_profile_that_is_none_is_refused(refused, tmp_path: Path, line: str, said: str) -> None:
    shipped = (EXAMPLES.parent / "profiles" / "prusa-mk4.toml").read_text("utf-8")
    lines = [line if row.startswith("layer_mm") and "#" not in row else row for row in shipped.splitlines()]
    path = tmp_path / "mine.toml"
    path.write_text("\n".join(lines))
    assert said in refused("check", box(tmp_path / "b.stl"), "--printer", str(path))


@pytest.mark.parametrize(
    ("text", "said"), [('skecth = "a.png"', "sketch"), ("sketch = 3", "sketch"), ("seed = 'x'", "seed")]
)
def test_a_recipe_that_is_none_is_refused(refused, tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "r.toml").write_text(text)
    assert said in refused("make", str(tmp_path / "r.toml"), "-o", "a.3mf")


def test_a_scan_in_metres_called_millimetres_is_questioned(refused, tmp_path: Path) -> None:
    mesh = human("man").part("head").mesh
    path = write_mesh(tmp_path / "scan.stl", mesh.with_vertices(mesh.vertices / 1000.0))
    for words in (
        ["make", "mask", "--sketch", CAT, "--body", str(path), "-o", "a.3mf"],
        ["bodies", "show", str(path)],
    ):
        told = refused(*words, "--body-units", "mm")
        assert "metres" in told
        assert "--body-units m" in told


def test_an_output_that_is_a_folder_or_an_input_is_refused(refused, tmp_path: Path) -> None:
    (tmp_path / "dir.3mf").mkdir()
    assert "folder of that name" in refused("make", "mask", "--sketch", CAT, "-o", str(tmp_path / "dir.3mf"))
    part = box(tmp_path / "b.stl")
    before = Path(part).read_bytes()
    assert "overwrite" in refused("solid", part, "--wall", "2", "-o", part)
    assert Path(part).read_bytes() == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_is_named(refused, tmp_path: Path) -> None:
    (tmp_path / "full.3mf").symlink_to("/dev/full")
    told = refused("solid", sheet(tmp_path / "s.stl"), "--wall", "2", "-o", str(tmp_path / "full.3mf"))
    assert "the disk is full" in told
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "fabcraft", "printers"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert (done.returncode, "the disk is full" in done.stderr) == (2, True)


def test_a_file_that_may_not_grow_leaves_nothing(tmp_path: Path) -> None:
    import resource

    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))

    path = sheet(tmp_path / "s.stl")
    done = run("solid", path, "--wall", "2", "-o", "out/p.3mf", folder=tmp_path, preexec_fn=small)
    assert done.returncode == 2
    assert "larger than the system allows" in done.stderr
    assert sorted(one.name for one in tmp_path.iterdir()) == ["s.stl"]


# --- streams, interruption, defects ----------------------------------------------------------------------


def test_a_reader_that_leaves_is_no_error(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "fabcraft", "bodies", "show", "man"]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, timeout=60)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_unforeseen_error_is_called_a_defect(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fabcraft import profile

    def fail() -> None:
        raise RuntimeError("the roof\nis on fire")

    monkeypatch.setattr(profile, "list_profiles", fail)
    monkeypatch.delenv("FABCRAFT_TRACEBACK", raising=False)
    assert main(["printers"]) == 70
    told = capsys.readouterr().err
    assert told.startswith("fabcraft: this is a defect in fabcraft: RuntimeError: the roof is on fire\n")
    assert "FABCRAFT_TRACEBACK=1" in told
    monkeypatch.setenv("FABCRAFT_TRACEBACK", "1")
    with pytest.raises(RuntimeError):
        main(["printers"])


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KeyboardInterrupt(), 130, "interrupted, nothing written"),
        (MemoryError(), 3, "not enough memory"),
        (ModuleNotFoundError("No module named 'lib3mf'", name="lib3mf"), 3, "lib3mf is not installed"),
    ],
)
def test_what_ends_a_run_from_outside_has_its_sentence(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, said: str
) -> None:
    from fabcraft import profile

    def fail() -> None:
        raise error

    monkeypatch.setattr(profile, "list_profiles", fail)
    assert main(["printers"]) == code
    assert said in capsys.readouterr().err


def test_ctrl_c_in_the_fit_keeps_the_best_so_far(
    tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture
) -> None:
    tell = Progress.tell

    def interrupting(self: Progress, stage: str, step: int, steps: int) -> None:
        tell(self, stage, step, steps)
        if stage == "fit: relief" and step == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "tell", interrupting)
    words = [
        "make",
        "ring",
        "--sketch",
        str(EXAMPLES / "objects" / "star.png"),
        "--preset",
        "draft",
        "--no-pictures",
        "--json",
    ]
    assert main([*words, "-o", str(tmp_path / "star.3mf")]) == 130
    told = capsys.readouterr()
    report = json.loads(told.out)
    assert [path.name for path in tmp_path.iterdir()] == ["star.3mf"]
    assert "interrupted: the best so far was written" in told.err
    assert any("stopped early" in finding["advice"] for finding in report["findings"])
    assert report["metrics"]["genus"] == 1
    assert report["metrics"]["pen_max_mm"] <= 0.05


def test_ctrl_c_before_the_fit_writes_nothing(refused, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupting(self: Progress, stage: str, step: int, steps: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "tell", interrupting)
    assert "nothing written" in refused("make", "mask", "--sketch", CAT, "-o", "out/a.3mf", code=130)


# --- flags and Python ------------------------------------------------------------------------------------


def test_flags_stand_over_the_recipe_file(tmp_path: Path) -> None:
    path = tmp_path / "r.toml"
    path.write_text('sketch = "a.png"\nwall_mm = 3.0\nseed = 2\n[placement]\nscale = 1.2\nup_mm = 4.0\n')
    recipe = recipe_from(str(path), Flags(wall=2.5, up=-1.0, swell=0.1, output=("b.3mf",), pictures=False))
    assert (recipe.sketch, recipe.wall_mm, recipe.seed, recipe.output) == ("a.png", 2.5, 2, ("b.3mf",))
    assert (recipe.placement.scale, recipe.placement.up_mm, recipe.inflate.swell) == (1.2, -1.0, 0.1)
    assert recipe.pictures is False
    other = recipe_from(str(path), Flags(guidance="m.stl"))
    assert (other.sketch, other.guidance) == ("", "m.stl")


def test_importing_fabcraft_imports_nothing_heavy() -> None:
    code = "import sys, fabcraft; print(sorted({'numpy', 'torch', 'cv2', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "[]"


def test_every_name_of_the_python_interface_is_there() -> None:
    for name in fabcraft.__all__:
        assert getattr(fabcraft, name) is not None
    assert set(fabcraft.__all__) <= set(dir(fabcraft))
    with pytest.raises(AttributeError, match="nonsense"):
        fabcraft.nonsense  # noqa: B018
