"""Profiles: what is shipped, where files are looked for, and what a wrong file is told."""

import dataclasses
import importlib.resources
import tomllib
from pathlib import Path

import pytest

from fabcraft import profile as profile_module
from fabcraft.errors import InputError
from fabcraft.profile import PrinterProfile, list_profiles, load_profile, read_profile

SHIPPED = Path(__file__).resolve().parents[1] / "profiles"
BASE = (SHIPPED / "prusa-mk4.toml").read_text(encoding="utf-8")


@pytest.fixture
def write(tmp_path):
    """Writes the shipped MK4 profile with one replacement to profiles/x.toml and returns its path."""

    def _write(old: str = "", new: str = "") -> Path:
        assert old in BASE
        folder = tmp_path / "profiles"
        folder.mkdir(exist_ok=True)
        (folder / "x.toml").write_text(BASE.replace(old, new, 1), encoding="utf-8")
        return folder / "x.toml"

    return _write


def test_the_mk4_has_its_published_build_volume():
    mk4 = load_profile("prusa-mk4")
    assert mk4.name == "prusa-mk4"
    assert mk4.build_mm == (250, 210, 220)
    assert mk4.process == "fdm"
    assert (mk4.min_wall_mm, mk4.wall_mm, mk4.max_overhang_deg) == (0.9, 1.2, 45)


def test_every_shipped_profile_is_listed_once_in_order():
    names = [one.name for one in list_profiles()]
    assert names == sorted(set(names))
    assert {path.stem for path in SHIPPED.glob("*.toml")} <= set(names)


def test_resin_profile_has_no_nozzle_and_a_drain_hole():
    form4 = load_profile("form4")
    assert form4.nozzle_mm == 0
    assert form4.drain_hole_mm == 3.5
    assert form4.min_wall_supported_mm < form4.min_wall_mm <= form4.wall_mm


def test_the_fifteen_printers_are_shipped_and_none_claims_to_be_verified():
    shipped = {path.stem: read_profile(path) for path in SHIPPED.glob("*.toml")}
    fdm = {"prusa-mk4", "prusa-xl", "prusa-core-one", "prusa-mini", "bambu-p1s", "bambu-a1", "ender3"}
    resin = {"form3", "form4", "prusa-sl1s", "photon-mono-x", "resin-service"}
    assert set(shipped) == fdm | resin | {"sls-pa12", "mjf-pa12", "mjf-tpu"}
    assert {name for name, one in shipped.items() if one.process == "fdm"} == fdm
    assert {name for name, one in shipped.items() if one.process == "sla"} == resin
    assert not any(one.verified for one in shipped.values())
    assert shipped["prusa-xl"].build_mm == (360, 360, 360)
    assert shipped["ender3"].clearance_moving_mm == 0.6
    assert shipped["mjf-tpu"].wall_mm == 1.5


def test_large_parts_of_a_resin_service_need_thicker_walls():
    service, mk4 = load_profile("resin-service"), load_profile("prusa-mk4")
    small, middle, large = (60.0, 60.0, 60.0), (99.0, 100.0, 1.0), (200.0, 200.0, 10.0)
    assert [service.for_size(size).min_wall_mm for size in (small, middle, large)] == [1, 2, 3]
    assert service.for_size(small) == service
    assert mk4.for_size(large) == mk4


def test_a_bead_is_as_wide_as_told_or_as_slicers_choose_it():
    mk4 = load_profile("prusa-mk4")
    assert mk4.bead_mm == pytest.approx(0.45)
    assert dataclasses.replace(mk4, line_width_mm=0.6).bead_mm == 0.6


def test_every_number_of_every_shipped_profile_names_its_source():
    for path in SHIPPED.glob("*.toml"):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        numbers = {k for k, v in table.items() if isinstance(v, (float, list)) or (type(v) is int)}
        assert numbers == set(table["sources"]), path.name


def test_underscores_and_capitals_find_the_same_profile():
    assert load_profile("Prusa_MK4") == load_profile("prusa-mk4")


def test_a_path_to_a_file_is_accepted(write):
    assert load_profile(write()).name == "x"
    assert load_profile(str(write())).build_mm == (250, 210, 220)


def test_an_unknown_name_suggests_close_ones():
    with pytest.raises(InputError, match="did you mean prusa-mk4") as caught:
        load_profile("prusa-mk3")
    assert "form4" in caught.value.next_step
    assert caught.value.exit_code == 2


def test_a_missing_file_says_so():
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot be read"):
        load_profile("nowhere.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("build_mm = [250, 210, 220]", 'build_mm = "250"', r"profiles/x.toml: build_mm: expected a list"),
        (
            "build_mm = [250, 210, 220]",
            "build_mm = [250, 210]",
            r"build_mm: expected a list of length 3, got 2",
        ),
        ("[250, 210, 220]", '[250, 210, "a"]', r"build_mm\[2\]: expected a number, got text"),
        ("[250, 210, 220]", "[250, 210, -2]", r"build_mm\[2\]: expected a number > 0"),
        ("layer_mm = 0.2", "layer_mm = nan", r"layer_mm: expected a"),
        ("layer_mm = 0.2", "layer_mm = inf", r"layer_mm: expected a finite number, got inf"),
        ("layer_mm = 0.2", "layer_mm = true", r"layer_mm: expected a number, got true or false"),
        ("layer_mm = 0.2", "layer_mmm = 0.2", r"layer_mmm: unknown key, did you mean layer_mm\?"),
        ("layer_mm = 0.2\n", "", r"layer_mm: expected a value, found none"),
        ('"fdm"', '"fmd"', r"process: expected fdm or sla or sls or mjf, got 'fmd'"),
        ("nozzle_mm = 0.4", "nozzle_mm = 0", r"nozzle_mm: expected more than 0"),
        ("\nwall_mm = 1.2", "\nwall_mm = 0.2", r"wall_mm: expected at least .* \(0.9\), got 0.2"),
        (
            'min_hole_mm = "',
            'min_hole_nm = "',
            r"min_hole_mm: expected its source in \[sources\], found none",
        ),
        ("[sources]\n", '[sources]\nverified = "x"\n', r"sources: verified is not a number"),
        ("max_overhang_deg = 45.0", "max_overhang_deg = 100", r"max_overhang_deg: expected a number <= 90"),
        ("title =", "title = =", r"profiles/x.toml: is not valid TOML"),
        (
            "verified = false",
            'slicer_command = ["x", "-o", "{output}"]\nverified = false',
            r"slicer_command: expected \{input\}",
        ),
        (
            "verified = false",
            'slicer_command = "x {input}"\nverified = false',
            r"slicer_command: expected a list",
        ),
        (
            "verified = false",
            "wall_by_size = [[400, 3.0], [200, 2.0]]\nverified = false",
            r"wall_by_size: expected its source",
        ),
        ("verified = false", "line_width_mm = 0\nverified = false", r"line_width_mm: expected a number > 0"),
        ("verified = false", 'verified = "yes"', r"verified: expected true or false, got text"),
    ],
)
def test_a_wrong_file_is_told_which_key_and_what_was_expected(write, old, new, message):
    with pytest.raises(InputError, match=message):
        read_profile(write(old, new))


def test_a_file_that_is_not_text_is_refused(tmp_path):
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        read_profile(tmp_path / "x.toml")


def test_profiles_inside_the_package_come_first(tmp_path, monkeypatch):
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "prusa-mk4.toml").write_text(BASE.replace("250", "111", 1), encoding="utf-8")
    monkeypatch.setattr(profile_module, "files", lambda _package: tmp_path)
    assert load_profile("prusa-mk4").build_mm[0] == 111


def test_an_editable_install_finds_the_repository_folder():
    inside = importlib.resources.files("fabcraft") / "profiles"
    if inside.is_dir():
        pytest.skip("this is an installed package: its own folder is used")
    assert load_profile("prusa-mk4").title.startswith("Prusa MK4")


def test_own_profiles_are_found_through_the_environment(write, monkeypatch):
    monkeypatch.setenv("FABCRAFT_PROFILES", str(write().parent))
    assert load_profile("x").name == "x"
    assert "x" in [one.name for one in list_profiles()]


def test_own_profiles_are_found_in_the_configuration_folder(write, monkeypatch):
    monkeypatch.setattr("platformdirs.user_config_dir", lambda *_a, **_k: str(write().parent.parent))
    assert load_profile("x").name == "x"


def test_tolerance_is_the_larger_of_length_and_share():
    mk4 = load_profile("prusa-mk4")
    assert mk4.tolerance_at(10.0) == 0.3
    assert mk4.tolerance_at(200.0) == pytest.approx(0.6)


def test_a_profile_cannot_be_changed():
    with pytest.raises(AttributeError):
        load_profile("form4").wall_mm = 2.0  # type: ignore[misc]
    assert isinstance(load_profile("form4"), PrinterProfile)
