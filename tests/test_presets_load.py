"""Printers of slicers' files: the known numbers, what is missing, and files that are broken or hostile."""

import json
import random
import shutil
import subprocess
from pathlib import Path

import pytest
import slicer_files as files

from fabcraft.cli import main
from fabcraft.errors import InputError
from fabcraft.presets.load import import_printer, profile_name, profile_toml
from fabcraft.profile import list_profiles, load_profile, parse_profile, read_profile

real = pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="prusa-slicer is not installed")


@pytest.fixture
def bundle(tmp_path):
    return files.put(tmp_path, {"Some.ini": files.BUNDLE})


def test_a_preset_of_a_bundle_has_what_it_inherits_the_later_parent_over_the_earlier(bundle):
    found = import_printer(bundle, preset="Some Swing (0.6 mm nozzle)")
    assert found.name == "some-swing-0.6-mm-nozzle"
    assert found.title == "Some Swing (0.6 mm nozzle)"
    assert found.build_mm == (300, 220, 300)
    assert (found.nozzle_mm, found.layer_mm, found.line_width_mm) == (0.6, 0.24, 0.45)
    assert found.max_overhang_deg == 40
    assert found.density_g_cm3 == 1.24
    assert found.min_wall_mm == pytest.approx(0.9)
    assert found.sources["min_wall_mm"] == "derived: 2 x line width"
    assert found.sources["layer_mm"] == "Some.ini: layer_height"
    assert not found.verified


def test_a_resin_printer_of_a_bundle_is_one(bundle):
    found = import_printer(bundle, preset="Some Screen")
    assert (found.process, found.build_mm) == ("sla", (143.43, 89.6, 175))
    assert (found.layer_mm, found.nozzle_mm, found.exposure_s) == (0.05, 0, 2.5)


def test_a_bundle_of_several_printers_asks_which(bundle):
    with pytest.raises(InputError, match="a bundle of 3 printers") as caught:
        import_printer(bundle)
    assert "--preset" in caught.value.next_step and "Some Screen" in caught.value.next_step
    with pytest.raises(InputError, match=r"did you mean Some Swing \(0.4 mm nozzle\)"):
        import_printer(bundle, preset="Some Swing 0.4")


def test_the_printer_that_an_exported_bundle_selects_is_taken_with_its_own_settings(tmp_path):
    selected = "[print:Mine]\nlayer_height = 0.3\n[presets]\nprinter = Some Screen\nsla_print = Mine\n"
    selected += "[sla_print:Mine]\nlayer_height = 0.025\n"
    path = files.put(tmp_path, {"b.ini": files.BUNDLE + selected})
    assert import_printer(path).layer_mm == 0.025


def test_a_users_preset_that_is_exported_whole_does_without_its_parent(tmp_path):
    whole = "[printer:Mine]\ninherits = Original Prusa MK4\nbed_shape = 0x0,250x0,250x210,0x210\n"
    path = files.put(tmp_path, {"b.ini": whole + "max_print_height = 220\nnozzle_diameter = 0.4,0.4\n"})
    found = import_printer(path)
    assert found.build_mm == (250, 210, 220)
    assert found.layer_mm == 0.2 and found.sources["layer_mm"] == "derived: half the nozzle"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[printer:A]\ninherits = Lost\nnozzle_diameter = 0.4\n",
            "inherits from 'Lost', which is not in the file",
        ),
        ("[printer:A]\ninherits = B\n[printer:*B*]\n", "inherits from 'B'"),
        ("[printer:A]\ninherits = *B*\n[printer:*B*]\ninherits = A\n", "inherits from itself"),
        ("[printer:A]\nmax_print_height = 9\n", "tells no bed"),
        ("bed_shape = 0x0,9x0\nmax_print_height = 9\n", "expected corners"),
        ("bed_shape = 0x0,9x0,nanx9\nmax_print_height = 9\n", "expected corners"),
        ("bed_shape = 0x0,9x0,9x9,0x9\n", "tells no height"),
        ("bed_shape = 0x0,9x0,9x9,0x9\nmax_print_height = inf\n", "max_print_height: expected a number"),
        ("bed_shape = 0x0,9x0,9x9,0x9\nmax_print_height = -5\n", "max_print_height: expected a number"),
        (
            "bed_shape = 0x0,9x0,9x9,0x9\nmax_print_height = 9\nlayer_height = tall\n",
            "layer_height: expected",
        ),
        ("bed_shape = 0x0,9x0,0x9\nmax_print_height = 9\n", "neither a rectangle nor round"),
        ("layer_height = 0.2\n", "tells no bed"),
        ("", "tells no bed"),
    ],
)
def test_a_wrong_ini_is_told_what_is_wrong(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        import_printer(files.put(tmp_path, {"a.ini": text}))


def test_many_parents_of_parents_take_no_time(tmp_path):
    doubled = "".join(f"[printer:*{n}*]\ninherits = *{n + 1}*; *{n + 1}*\n" for n in range(35))
    text = f"[printer:A]\ninherits = *0*\n{doubled}[printer:*35*]\nbed_shape = 0x0,9x0,9x9,0x9\nmax_print_height = 9\n"
    assert import_printer(files.put(tmp_path, {"a.ini": text})).build_mm == (9, 9, 9)


def test_a_round_bed_becomes_the_rectangle_in_it_and_says_so(tmp_path):
    from math import cos, pi, sin

    corners = ",".join(f"{90 * cos(pi * k / 30):.3f}x{90 * sin(pi * k / 30):.3f}" for k in range(60))
    path = files.put(tmp_path, {"delta.ini": f"bed_shape = {corners}\nmax_print_height = 300\n"})
    found = import_printer(path)
    assert found.build_mm[0] == pytest.approx(180 / 2**0.5, abs=0.1)
    assert "round bed" in found.sources["build_mm"]


@real
def test_what_prusa_slicer_saves_can_be_imported_and_sliced_with(tmp_path):
    settings = ["--layer-height=0.25", "--nozzle-diameter=0.5", "--bed-shape=0x0,150x0,150x140,0x140"]
    subprocess.run(
        ["prusa-slicer", *settings, "--save", str(tmp_path / "saved.ini")],
        check=True,
        capture_output=True,
        timeout=60,
    )
    found = import_printer(tmp_path / "saved.ini")
    assert found.build_mm[:2] == (150, 140)
    assert (found.layer_mm, found.nozzle_mm) == (0.25, 0.5)
    assert found.sources["line_width_mm"].startswith("derived")


def test_an_orca_machine_is_resolved_from_the_files_beside_it(tmp_path):
    found = import_printer(files.orca(tmp_path))
    assert found.build_mm == (220, 210, 250)
    assert (found.nozzle_mm, found.layer_mm) == (0.4, 0.2)
    assert found.line_width_mm == pytest.approx(0.42)  # 105 % of the nozzle
    assert found.max_overhang_deg == 50
    assert "0.20mm Standard @Some" in found.sources["layer_mm"]
    assert "excluded" in found.notes


def test_an_orca_machine_without_its_parent_names_it_and_where_it_is(tmp_path):
    path = files.orca(tmp_path)
    (path.parent / "fdm_machine_common.json").unlink()
    with pytest.raises(InputError, match="inherits from 'fdm_machine_common'") as caught:
        import_printer(path)
    assert "fdm_machine_common.json" in caught.value.next_step and "system/" in caught.value.next_step


def test_an_orca_machine_without_its_process_says_that_the_layer_is_derived(tmp_path):
    path = files.orca(tmp_path)
    (tmp_path / "process" / "fdm_process_common.json").unlink()
    assert import_printer(path).sources["layer_mm"] == "derived: half the nozzle"


def test_resolved_settings_need_no_parent(tmp_path):
    found = import_printer(files.put(tmp_path, {"project_settings.config": files.ORCA_RESOLVED}))
    assert found.title == "Some Box 0.4 nozzle"
    assert (found.build_mm, found.layer_mm, found.line_width_mm) == ((256, 256, 250), 0.16, 0.42)
    assert found.density_g_cm3 == 1.27


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"type": "process", "layer_height": "0.2"}, "is a process, not a machine"),
        ({"type": "machine_model"}, "is a machine model, not a machine"),
        ({"type": "machine", "name": "a"}, "tells no printable_area"),
        ({"type": "machine", "inherits": "../../etc/passwd"}, "does not lie beside it"),
        ({"type": "machine", "inherits": "/etc/passwd"}, "does not lie beside it"),
        ({"type": "machine", "inherits": "x" * 5000}, "does not lie beside it"),
        ({"type": "machine", "inherits": "a"}, "comes back to itself"),
        ({**files.ORCA_RESOLVED, "printable_area": {"x": 1}}, "expected corners"),
        ({**files.ORCA_RESOLVED, "nozzle_diameter": [["wide"]]}, "nozzle_diameter: expected a number"),
        ({**files.ORCA_RESOLVED, "layer_height": "9"}, "layer_height: expected a number"),
        ([1, 2], "no table of settings"),
    ],
)
def test_a_wrong_orca_file_is_told_what_is_wrong(tmp_path, table, message):
    with pytest.raises(InputError, match=message):
        import_printer(files.put(tmp_path, {"a.json": table}))


def test_a_cura_definition_is_resolved_up_to_its_root(tmp_path):
    found = import_printer(files.cura(tmp_path))
    assert found.build_mm == (230, 220, 260)
    assert found.nozzle_mm == 0.5 and "some_extruder_0" in found.sources["nozzle_mm"]
    assert found.line_width_mm == 0.5  # it names the nozzle's size
    assert (found.layer_mm, found.max_overhang_deg) == (0.2, 50)


def test_an_expression_that_is_not_computed_counts_as_not_told(tmp_path):
    path = files.cura(tmp_path)
    table = json.loads(path.read_text()) | {
        "overrides": {"line_width": {"value": "machine_nozzle_size * 0.875"}}
    }
    path.write_text(json.dumps(table))
    found = import_printer(path)
    assert found.sources["line_width_mm"].startswith("derived")
    assert found.line_width_mm == pytest.approx(1.125 * 0.5, abs=1e-4)


def test_a_cura_definition_without_its_parent_names_it_and_where_it_is(tmp_path):
    path = files.cura(tmp_path)
    (path.parent / "fdmprinter.def.json").unlink()
    with pytest.raises(InputError, match="inherits from 'fdmprinter'") as caught:
        import_printer(path)
    assert "definitions" in caught.value.next_step


def test_cura_definitions_that_inherit_in_a_circle_are_refused(tmp_path):
    path = files.cura(tmp_path)
    (path.parent / "fdmprinter.def.json").write_text(json.dumps({"inherits": "some_swing", "overrides": {}}))
    with pytest.raises(InputError, match="comes back to itself"):
        import_printer(path)


def test_an_elliptic_bed_of_cura_is_round(tmp_path):
    path = files.cura(tmp_path)
    table = json.loads(path.read_text())
    table["overrides"]["machine_shape"] = {"default_value": "elliptic"}
    path.write_text(json.dumps(table))
    assert import_printer(path).build_mm[0] == pytest.approx(230 / 2**0.5, abs=0.5)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PK\x03\x04rest", "is an archive"),
        (b"\xff\xfe\x00", "not text in UTF-8"),
        (b'{"a": ', "not valid JSON"),
        (b"[" * 100_000, "not valid JSON"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not valid JSON"),
        (b"x" * 8_000_001, "has fewer than"),
    ],
)
def test_a_file_of_another_kind_is_refused(tmp_path, data, message):
    (tmp_path / "a.json").write_bytes(data)
    with pytest.raises(InputError, match=message):
        import_printer(tmp_path / "a.json")


@pytest.mark.parametrize("path", ["nowhere.ini", ".", "a\0b"])
def test_a_path_that_is_no_file_is_refused(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError):
        import_printer(path)


def test_a_profile_as_toml_is_the_same_profile():
    for one in list_profiles():
        assert parse_profile(profile_toml(one), "again", one.name) == one


def test_a_title_cannot_break_the_toml(tmp_path):
    name = 'A "quoted" \\ \u007f \ud800 name\nprocess = "sls"'
    found = import_printer(
        files.put(tmp_path, {"a.json": {**files.ORCA_RESOLVED, "printer_settings_id": name}})
    )
    assert found.process == "fdm" and 'A "quoted" \\' in found.title


def test_a_name_is_made_of_letters_and_digits():
    assert profile_name("Creality Ender-3 (0.4 mm nozzle)") == "creality-ender-3-0.4-mm-nozzle"
    with pytest.raises(InputError, match="makes no name"):
        profile_name("///")


def replaced(table: dict, dice: random.Random) -> bytes:
    """The JSON with one of its values, at any depth, made something else."""
    odd = [
        None,
        [],
        {},
        "",
        0,
        -1,
        True,
        1e308,
        "nan",
        "0x0",
        "x" * 300,
        [[["0x0"]]],
        {"value": "="},
        ["a", {}],
        "inherits",
    ]
    places = []
    waiting: list = [table]
    while waiting:
        one = waiting.pop()
        keys = list(one) if isinstance(one, dict) else range(len(one))
        places += [(one, key) for key in keys]
        waiting += [one[key] for key in keys if isinstance(one[key], (dict, list))]
    for _ in range(dice.randint(1, 3)):
        one, key = dice.choice(places)
        one[key] = dice.choice(odd)
    return json.dumps(table).encode()


def mutated(data: bytes, dice: random.Random) -> bytes:
    """A value of JSON replaced, or a few bytes cut out, doubled or replaced, by what parsers stumble over."""
    if data[:1] == b"{" and dice.random() < 0.6:
        return replaced(json.loads(data), dice)
    awkward = [
        b"{",
        b"]",
        b"\0",
        b"nan",
        b"-1",
        b"1e999",
        b"%",
        b"\xff",
        b"inherits",
        b"9" * 400,
        b"\n[printer:",
        b"x",
        b",",
    ]
    text = bytearray(data)
    for _ in range(dice.randint(1, 6)):
        at = dice.randrange(len(text) + 1)
        end = min(len(text), at + dice.choice((0, 1, 3, 40)))
        piece = dice.choice(
            (b"", bytes(text[at:end]) * 2, dice.choice(awkward), bytes([dice.randrange(128)]))
        )
        text[at:end] = piece
    return bytes(text)


def test_mutated_files_give_a_profile_or_an_error_for_people(tmp_path):
    dice = random.Random(7)
    sources = [
        files.put(tmp_path, {"Some.ini": files.BUNDLE}),
        files.orca(tmp_path / "orca"),
        files.cura(tmp_path / "cura"),
        files.put(tmp_path, {"whole.json": files.ORCA_RESOLVED}),
    ]
    good = refused = 0
    for turn in range(240):
        source = sources[turn % len(sources)]
        victim = source.with_name(f"mutated{source.suffix}")
        victim.write_bytes(mutated(source.read_bytes(), dice))
        try:
            found = import_printer(victim, preset="Some Screen" if source.suffix == ".ini" else None)
        except InputError as error:
            assert error.next_step
            refused += 1
        else:
            assert all(0 < side <= 10_000 for side in found.build_mm)
            good += 1
    assert good > 20 and refused > 20


def test_the_command_writes_a_profile_that_checks_find(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FABCRAFT_PROFILES", str(tmp_path / "own"))
    bundle = str(files.put(tmp_path, {"Some.ini": files.BUNDLE}))
    words = ["printers", "import", bundle, "--preset", "Some Screen"]
    assert main([*words, "--name", "My Screen"]) == 0
    told = capsys.readouterr().out
    assert "--printer my-screen" in told and "derived" in told
    assert load_profile("my-screen").process == "sla"
    assert main([*words, "--name", "My Screen"]) == 2  # never over one that is there
    assert "already" in capsys.readouterr().err
    assert main([*words, "--name", "prusa-mk4"]) == 2
    capsys.readouterr()
    assert main([*words, "-o", str(tmp_path / "x.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == [str(tmp_path / "x.toml")]
    assert read_profile(tmp_path / "x.toml").build_mm == (143.43, 89.6, 175)


@pytest.mark.parametrize(
    "words", [["nowhere.ini"], ["a.ini", "-o", "a.txt"], ["a.ini", "--name", "!"], ["a.ini", "--preset", "x"]]
)
def test_wrong_words_exit_with_two_and_no_traceback(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FABCRAFT_PROFILES", str(tmp_path / "own"))
    Path("a.ini").write_text("bed_shape = 0x0,9x0,9x9,0x9\nmax_print_height = 9\n")
    assert main(["printers", "import", *words]) == 2
    told = capsys.readouterr()
    assert told.out == "" and "Traceback" not in told.err and "defect" not in told.err
