"""`fabcraft weights`: what there is and where it lies, and without a network the line to run later."""

import json
from pathlib import Path

import pytest

from fabcraft.cli import main
from fabcraft.guidance import encoder_weights
from fabcraft.guidance.clip import DEFAULT, KNOWN, weights_of


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and a network that fails a test when it is used."""
    import socket

    from huggingface_hub import constants

    def refused(*arguments, **named):
        raise OSError("no route")

    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setattr(socket.socket, "connect", refused)
    monkeypatch.setattr(socket, "getaddrinfo", refused)
    return tmp_path / "hub"


def laid_down(cache: Path, name: str = DEFAULT, file: str = "") -> Path:
    """A file of weights where the Hub's library would have put it."""
    wanted = weights_of(name)
    folder = cache / f"models--{wanted.repository.replace('/', '--')}"
    snapshot = folder / "snapshots" / ("1" * 40)
    snapshot.mkdir(parents=True)
    (folder / "refs").mkdir()
    (folder / "refs" / "main").write_text("1" * 40)
    path = snapshot / (file or wanted.files[0])
    path.write_bytes(b"weights")
    return path


def answered(capsys: pytest.CaptureFixture, *words: str) -> tuple[int, str, str]:
    code = main(["weights", *words])
    told = capsys.readouterr()
    return code, told.out, told.err


@pytest.mark.parametrize("words", [(), ("list",)])
def test_the_list_names_every_encoder_and_whether_it_is_here(words, cache, capsys):
    laid_down(cache)
    code, told, _ = answered(capsys, *words)
    assert code == 0
    rows = {line.split()[0]: line.split()[1] for line in told.split("\n\n")[0].splitlines()[1:]}
    assert rows == {name: "yes" if name == DEFAULT else "no" for name in KNOWN}


def test_the_list_as_json_holds_the_paths(cache, capsys):
    path = laid_down(cache)
    code, told, said = answered(capsys, "list", "--json")
    found = {one["name"]: one["path"] for one in json.loads(told)}
    assert (code, said) == (0, "")
    assert found == {name: str(path) if name == DEFAULT else None for name in KNOWN}


def test_the_path_is_the_folder_of_all_weights_or_the_file_of_one(cache, capsys):
    assert answered(capsys, "path") == (0, f"{cache}\n", "")
    path = laid_down(cache)
    assert answered(capsys, "path", DEFAULT) == (0, f"{path}\n", "")


def test_weights_without_code_are_preferred_and_others_are_taken(cache, capsys):
    path = laid_down(cache, file="open_clip_pytorch_model.bin")
    assert answered(capsys, "path", DEFAULT)[1] == f"{path}\n"
    safe = path.with_name("open_clip_model.safetensors")
    safe.write_bytes(b"weights")
    assert answered(capsys, "path", DEFAULT)[1] == f"{safe}\n"


def test_the_path_of_absent_weights_is_answered_with_the_line_to_run(cache, capsys):
    code, told, said = answered(capsys, "path", DEFAULT)
    assert (code, told) == (3, "")
    assert said.splitlines()[-1].strip() == f"fabcraft weights fetch {DEFAULT}"


def test_what_is_here_is_not_fetched_again(cache, capsys):
    path = laid_down(cache)
    code, told, said = answered(capsys, "fetch")
    assert (code, told) == (0, f"{path}\n") and "already here" in said


def test_fetching_asks_the_hub_for_one_file_after_the_other(cache, capsys, monkeypatch):
    import huggingface_hub
    from huggingface_hub.errors import RemoteEntryNotFoundError

    asked = []

    def download(repository: str, file: str) -> str:
        asked.append((repository, file))
        if file.endswith(".safetensors"):
            raise RemoteEntryNotFoundError.__new__(RemoteEntryNotFoundError)
        return f"/somewhere/{file}"

    monkeypatch.setattr(huggingface_hub, "hf_hub_download", download)
    code, told, said = answered(capsys, "fetch")
    wanted = weights_of(DEFAULT)
    assert asked == [(wanted.repository, file) for file in wanted.files]
    assert (code, told) == (0, f"/somewhere/{wanted.files[1]}\n") and "fetching" in said
    monkeypatch.setattr(encoder_weights, "cached", lambda weights: None)
    asked.clear()
    wanted = encoder_weights.Weights("tiny", "someone/tiny", ("a.safetensors",))
    with pytest.raises(encoder_weights.InputError, match=r"none of a\.safetensors"):
        encoder_weights.fetch(wanted)


def test_without_a_network_fetching_ends_with_3_and_the_line_to_run(cache, capsys, monkeypatch):
    import huggingface_hub
    from huggingface_hub.errors import LocalEntryNotFoundError

    def download(*arguments: str) -> str:
        raise LocalEntryNotFoundError("no connection")

    monkeypatch.setattr(huggingface_hub, "hf_hub_download", download)
    code, told, said = answered(capsys, "fetch")
    assert (code, told) == (3, "") and "cannot be reached" in said
    assert said.splitlines()[-1].strip() == f"fabcraft weights fetch {DEFAULT}"


def test_a_hub_that_is_switched_off_is_not_asked(cache, capsys, monkeypatch):
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    code, told, said = answered(capsys, "fetch")
    assert (code, told) == (3, "") and "HF_HUB_OFFLINE is set" in said
    assert said.splitlines()[-1].strip() == f"HF_HUB_OFFLINE=0 fabcraft weights fetch {DEFAULT}"


def test_an_encoder_that_could_not_be_used_is_not_fetched(cache, capsys):
    code, told, said = answered(capsys, "fetch", "ViT-B-16-SigLIP/webli")
    assert (code, told) == (2, "") and "fabcraft weights list" in said


def test_a_name_that_nobody_knows_is_answered_with_a_close_one(cache, capsys):
    for command in ("fetch", "path"):
        code, told, said = answered(capsys, command, "ViT-B-32-quickgelu/opnai")
        assert (code, told) == (2, "") and f"Did you mean {DEFAULT}?" in said
