"""Back ends at the command line: listed, asked about, and written into recipes without a secret."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from backed import KEY, alone, glb, png  # noqa: F401
from services import Told, dripping, gradio, serving, tripo

from fabcraft import pipeline
from fabcraft.backends import registry
from fabcraft.backends.backend import Terms
from fabcraft.backends.registry import backend
from fabcraft.cli import main
from fabcraft.cli.backends import consent
from fabcraft.cli.make import Flags, recipe_from
from fabcraft.errors import InputError, MissingError
from fabcraft.recipe import Recipe, read_recipe, recipe_toml


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def agreed(
    terms: Terms, *, yes: bool = False, typed: frozenset[str] = frozenset(), said: str | None = None
) -> str:
    """What is told on stderr.  said : typed at a terminal; nobody sits there when None."""
    with pytest.MonkeyPatch.context() as patch:
        told = io.StringIO() if said is None else _Terminal()
        patch.setattr(sys, "stdin", io.StringIO() if said is None else _Terminal(said))
        patch.setattr(sys, "stderr", told)
        consent(yes, typed, contextlib.nullcontext)("image_to_3d", "x", terms)
        return told.getvalue()


PAID, FREE, CODE = Terms(("it costs",), "always"), Terms(("a licence",)), Terms(("runs y",), "unless typed")


def test_costs_are_told_and_a_yes_is_asked_for_at_a_terminal():
    for word in ("y\n", "YES\n"):
        assert "it costs" in agreed(PAID, said=word) and "go on?" in agreed(PAID, said=word)
    for word in ("\n", "n\n", "", "maybe\n"):
        with pytest.raises(InputError, match="was not called"):
            agreed(PAID, said=word)


def test_without_a_terminal_the_flag_is_the_yes():
    with pytest.raises(InputError) as caught:
        agreed(PAID)
    assert "--yes" in caught.value.next_step
    assert "it costs" in agreed(PAID, yes=True) and "go on?" not in agreed(PAID, yes=True, said="")


def test_what_needs_no_yes_is_told_all_the_same():
    assert "a licence" in agreed(FREE)


def test_a_command_that_was_typed_is_a_yes_and_one_from_a_recipe_is_none():
    assert "runs y" in agreed(CODE, typed=frozenset({"image_to_3d"}))
    for typed in (frozenset(), frozenset({"text_to_image"})):
        with pytest.raises(InputError):
            agreed(CODE, typed=typed)
    with pytest.raises(InputError):
        agreed(PAID, typed=frozenset({"image_to_3d"}))


def test_the_list_tells_what_is_there_and_what_is_missing(alone, capsys, monkeypatch):  # noqa: F811
    assert main(["backends"]) == 0
    told = capsys.readouterr().out
    for name in ("inflate", "file:MESH", "gradio:URL", "tripo", "command:", "diffusers", "openai"):
        assert name in told
    assert "export TRIPO_API_KEY=" in told and str(alone) in told
    monkeypatch.setenv("TRIPO_API_KEY", KEY)
    assert main(["backends", "--json"]) == 0
    text = capsys.readouterr().out
    rows = {(one["for"], one["name"]): one for one in json.loads(text)["backends"]}
    assert rows["image_to_3d", "tripo"]["here"] and not rows["text_to_image", "openai"]["here"]
    assert KEY not in text


def test_kept_answers_can_be_deleted(alone, capsys):  # noqa: F811
    alone.mkdir(parents=True)
    (alone / "x-1.glb").write_bytes(b"1")
    assert main(["backends", "clear"]) == 0
    assert "deleted 1 file from" in capsys.readouterr().out and not list(alone.iterdir())


class Their:
    """A back end of another package."""

    about, usage = "theirs", "their:X"

    def __init__(self, argument: str) -> None:
        self.argument = argument

    @classmethod
    def lacks(cls) -> MissingError | None:
        return None

    def terms(self, request) -> Terms:
        return Terms()

    def key(self):
        return {}

    def make(self, request, said):
        raise NotImplementedError


def test_other_packages_add_back_ends_and_take_none_over(monkeypatch):
    def points(group: str):
        here = "test_backends_cli"
        offered = {
            "their": f"{here}:Their",
            "tripo": f"{here}:Their",
            "broken": "no_such_module:X",
            "odd": f"{here}:FREE",
        }
        offered["inflate"] = f"{here}:Their"
        return (
            [EntryPoint(name, value, group) for name, value in offered.items()]
            if group.endswith("3d")
            else []
        )

    monkeypatch.setattr(registry, "entry_points", points)
    monkeypatch.setenv("TRIPO_API_KEY", KEY)
    name, found = backend("image_to_3d", "their:a:b")
    assert (name, type(found), found.argument) == ("their", Their, "a:b")
    assert type(backend("image_to_3d", "tripo")[1]) is not Their
    with pytest.raises(MissingError, match=r"broken.*cannot be loaded"):
        backend("image_to_3d", "broken")
    with pytest.raises(MissingError, match=r"odd.*has no"):
        backend("image_to_3d", "odd")
    rows = {one.name: one for one in registry.listed() if one.group == "image_to_3d"}
    assert rows["their"].lacks == "" and "cannot be loaded" in rows["broken"].lacks
    assert rows["inflate"].about.startswith("the drawing")


def test_flags_and_recipes_say_the_same(tmp_path):
    (tmp_path / "m.glb").write_bytes(glb())
    (tmp_path / "s.png").write_bytes(png())
    (tmp_path / "r.toml").write_text(
        'template = "ring"\nsketch = "s.png"\nimage_to_3d = "file:m.glb"\nseed = 2\n'
    )
    recipe = read_recipe(tmp_path / "r.toml")
    assert recipe.image_to_3d == f"file:{tmp_path / 'm.glb'}" and recipe.mesh_file == str(tmp_path / "m.glb")
    flags = Flags(sketch=recipe.sketch, image_to_3d=recipe.image_to_3d, seed=2)
    assert recipe_from("ring", flags) == recipe
    assert 'image_to_3d = "file:m.glb"' in recipe_toml(recipe) and str(tmp_path) not in recipe_toml(recipe)


def test_an_input_of_the_command_line_takes_the_place_of_a_recipe_s(tmp_path):
    path = tmp_path / "r.toml"
    path.write_text('text = "a cat"\ntext_to_image = "openai"\nimage_to_3d = "tripo"\n')
    mesh = recipe_from(str(path), Flags(guidance="m.glb"))
    assert (mesh.text, mesh.text_to_image, mesh.image_to_3d) == ("", "", "")
    over = recipe_from(str(path), Flags(sketch="s.png"))
    assert (over.sketch, over.text, over.text_to_image) == ("s.png", "a cat", "openai")
    plain = recipe_from(str(path), Flags(sketch="s.png", text_to_image="", image_to_3d="inflate"))
    assert (plain.text, plain.mesh_wanted) == ("", False)


def test_a_recipe_that_travels_tells_no_folder():
    command = "command:python3 /home/me/run.py --weights=/home/me/w.bin '/a b/x' {input} {output} http://h/a"
    text = recipe_toml(Recipe(image_to_3d=command, text_to_image="diffusers:/home/me/sd#org/net"))
    assert "/home" not in text and "/a b" not in text
    assert "run.py --weights=w.bin x" in text and "http://h/a" in text and '"diffusers:sd#org/net"' in text


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--image-to-3d", "tripo"], 3, "TRIPO_API_KEY"),
        (["--image-to-3d", "gradio:http://me:pw@h"], 2, "environment"),
        (["--image-to-3d", "gradio:https://example.invalid"], 2, "--yes"),
        (["--image-to-3d", "nothing"], 2, "There are: inflate, file"),
        (["--text-to-image", "openai", "--text", "a cat"], 3, "OPENAI_API_KEY"),
        (["--text-to-image", "openai"], 2, "--text"),
    ],
)
def test_what_is_missing_is_told_before_any_work(alone, tmp_path, capsys, words, code, said):  # noqa: F811
    (tmp_path / "s.png").write_bytes(png())
    line = ["make", "ring", "--sketch", str(tmp_path / "s.png"), *words, "-o", str(tmp_path / "o.3mf")]
    assert main(line) == code
    told = capsys.readouterr().err
    assert said in told and "pw@" not in told and "Traceback" not in told
    assert not (tmp_path / "o.3mf").exists()


def test_the_mesh_goes_on_as_a_guidance_mesh_and_the_recipe_stays_as_asked(alone, tmp_path, monkeypatch):  # noqa: F811
    seen: list[Recipe] = []

    class StopError(Exception):
        pass

    def road(recipe, *_):
        seen.append(recipe)
        raise StopError

    monkeypatch.setattr(pipeline, "shape_guided", road)
    monkeypatch.setenv("TRIPO_API_KEY", KEY)
    (tmp_path / "s.png").write_bytes(png())
    with serving(tripo(glb())) as service, pytest.raises(StopError):
        monkeypatch.setenv("TRIPO_BASE_URL", service.url)
        asked = Recipe(template="ring", sketch=str(tmp_path / "s.png"), image_to_3d="tripo")
        pipeline.make(asked, consent=lambda *_: None)
    assert seen[0].guidance.endswith(".glb") and seen[0].sketch == "" and KEY not in recipe_toml(asked)


def test_ctrl_c_during_a_call_is_exit_130_and_leaves_nothing(alone, tmp_path):  # noqa: F811
    (tmp_path / "s.png").write_bytes(png())
    with serving(gradio(glb(), events=lambda _: Told(pieces=dripping()))) as app:
        code = (
            "import sys; from fabcraft.cli import _guarded; from fabcraft.backends.ask import answered;"
            "from fabcraft.recipe import Recipe;"
            "sys.exit(_guarded(lambda: answered(Recipe(sketch=sys.argv[1], image_to_3d=sys.argv[2]))))"
        )
        process = subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path / "s.png"), f"gradio:{app.url}"],
            env={**os.environ, "PYTHONPATH": str(Path(pipeline.__file__).parents[1])},
            stderr=subprocess.PIPE,
            text=True,
            # a suite that was started in the background has Ctrl-C ignored, and so would what it starts
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        for _ in range(600):
            if app.count("GET .*/e1") or process.poll() is not None:
                break
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20)
    assert process.returncode == 130, said
    assert "interrupted, nothing written" in said
    assert not [path for path in alone.parent.rglob("*") if path.is_file()]
    assert "Traceback" not in said
