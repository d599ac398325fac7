"""A recipe that names back ends becomes one without; what they answered is kept, and nothing is called unseen."""

import io
import os
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from backed import alone, glb, png  # noqa: F401
from PIL import Image
from services import gradio, openai, serving, tripo

from fabcraft.backends import ask, cache
from fabcraft.backends.ask import agree, answered, refuse
from fabcraft.backends.backend import Request, Terms
from fabcraft.errors import InputError, MissingError
from fabcraft.read.mesh_file import read_mesh
from fabcraft.recipe import Recipe


@pytest.fixture
def sketch(tmp_path: Path) -> Path:
    path = tmp_path / "cat.png"
    path.write_bytes(png())
    return path


def test_a_sketch_becomes_a_guidance_mesh(alone, sketch):  # noqa: F811
    with serving(gradio(glb())) as app:
        told: list[tuple[str, int, int]] = []
        recipe = Recipe(template="ring", sketch=str(sketch), image_to_3d=f"gradio:{app.url}")
        found = answered(recipe, refuse, lambda *step: told.append(step))
        assert (
            found.recipe.sketch == "" and found.recipe.image_to_3d == "" and found.recipe.template == "ring"
        )
        assert len(read_mesh(found.recipe.guidance).faces) == 320
        assert "mesh of cat.png by gradio" in found.route[0] and app.url in found.route[0]
        assert told and told[0][0] == "ask: gradio"
    assert Path(found.recipe.guidance).parent == alone


def test_a_run_is_repeated_without_the_service(alone, sketch):  # noqa: F811
    with serving(gradio(glb())) as app:
        recipe = Recipe(sketch=str(sketch), image_to_3d=f"gradio:{app.url}")
        first = answered(recipe)
    again = answered(recipe)
    assert again.recipe == first.recipe and "kept from an earlier run" in again.route[0]
    with pytest.raises(MissingError, match="cannot be reached"):
        answered(Recipe(sketch=str(sketch), image_to_3d=f"gradio:{app.url}", seed=1))


def test_what_is_kept_needs_no_yes_but_a_call_does(alone, sketch, monkeypatch):  # noqa: F811
    monkeypatch.setenv("TRIPO_API_KEY", "tsk_1")
    recipe = Recipe(sketch=str(sketch), image_to_3d="tripo")
    with serving(tripo(glb())) as service:
        monkeypatch.setenv("TRIPO_BASE_URL", service.url)
        with pytest.raises(InputError, match=r"needs a yes.*paid"):
            answered(recipe)
        assert service.asked == [] and not alone.exists(), "nothing is sent before the yes"
        heard: list[tuple[str, Terms]] = []
        answered(recipe, lambda group, name, terms: heard.append((name, terms)))
        assert [name for name, _ in heard] == ["tripo"]
        answered(recipe)
        assert len(service.asked) == 6


def test_a_useless_answer_is_not_kept(alone, sketch):  # noqa: F811
    with serving(gradio(b"<html>busy</html>")) as app, pytest.raises(InputError, match="a web page"):
        answered(Recipe(sketch=str(sketch), image_to_3d=f"gradio:{app.url}"))
    assert not alone.exists() or not list(alone.iterdir())


def test_ctrl_c_leaves_nothing_half_written(alone, sketch):  # noqa: F811
    def interrupted(_):
        raise KeyboardInterrupt

    with serving(gradio(glb())) as app, pytest.raises(KeyboardInterrupt):
        answered(
            Recipe(sketch=str(sketch), image_to_3d=f"gradio:{app.url}"), refuse, lambda *_: interrupted(_)
        )
    assert not alone.exists() or not list(alone.iterdir())


def test_words_become_a_picture_that_is_read_as_a_drawing(alone, monkeypatch):  # noqa: F811
    with serving(openai(png())) as service:
        monkeypatch.setenv("OPENAI_BASE_URL", f"{service.url}/v1")
        found = answered(Recipe(text="a cat", via="picture", text_to_image="openai"))
        prompt = service.asked[0].json["prompt"]
    assert found.recipe.text == "" and found.recipe.text_to_image == ""
    assert Path(found.recipe.sketch).read_bytes() == png()
    assert prompt.startswith("a cat, ") and "line drawing" in prompt
    assert 'picture of "a cat" by openai' in found.route[0]


def test_words_over_a_sketch_become_a_mesh_by_two_back_ends(alone, sketch, monkeypatch):  # noqa: F811
    with serving(openai(png())) as service, serving(gradio(glb())) as app:
        monkeypatch.setenv("OPENAI_BASE_URL", f"{service.url}/v1")
        recipe = Recipe(
            sketch=str(sketch), text="a cat", text_to_image="openai", image_to_3d=f"gradio:{app.url}"
        )
        found = answered(recipe)
        assert "line drawing" not in service.last("POST .*edits").form["prompt"].decode()
    assert Path(found.recipe.guidance).suffix == ".glb" and found.recipe.sketch == ""
    assert len(found.route) == 2 and "over the sketch cat.png" in found.route[0]


def test_what_a_camera_wrote_into_a_picture_stays_here(alone, tmp_path):  # noqa: F811
    image = Image.open(io.BytesIO(png())).convert("RGBA")
    image.putalpha(Image.fromarray(np.eye(96, dtype=np.uint8) * 255))
    exif = Image.Exif()
    exif[0x010F] = "MyCamera"
    exif.get_ifd(0x8825)[1] = "N"
    image.save(tmp_path / "photo.png", exif=exif)
    assert b"MyCamera" in (tmp_path / "photo.png").read_bytes()
    with serving(gradio(glb())) as app:
        answered(Recipe(sketch=str(tmp_path / "photo.png"), image_to_3d=f"gradio:{app.url}"))
        sent = app.last("POST /gradio_api/upload").form["files"]
    assert b"MyCamera" not in sent and b"eXIf" not in sent
    with Image.open(io.BytesIO(sent)) as seen:
        assert seen.mode == "RGB" and seen.getpixel((1, 0)) == (255, 255, 255), "what is clear is white"


def test_a_mesh_file_is_a_back_end_too(alone, sketch, tmp_path):  # noqa: F811
    (tmp_path / "m.glb").write_bytes(glb())
    found = answered(Recipe(sketch=str(sketch), image_to_3d=f"file:{tmp_path / 'm.glb'}"))
    assert Path(found.recipe.guidance).read_bytes() == glb()
    for wrong in ("file:", f"file:{tmp_path}", "file:none.glb", "file:\0"):
        with pytest.raises(InputError):
            answered(Recipe(sketch=str(sketch), image_to_3d=wrong))


def test_a_command_out_of_a_recipe_is_not_run_unseen(alone, sketch, tmp_path):  # noqa: F811
    code = f"import pathlib; pathlib.Path({str(tmp_path / 'ran')!r}).touch()"
    asked = f"command:{shlex.join([sys.executable, '-c', code])} {{input}} {{output}}"
    with pytest.raises(InputError, match="needs a yes"):
        answered(Recipe(sketch=str(sketch), image_to_3d=asked))
    assert not (tmp_path / "ran").exists()
    with pytest.raises(InputError, match="wrote no"):
        answered(Recipe(sketch=str(sketch), image_to_3d=asked), agree)
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"text_to_image": "openai"}, "without words"),
        ({"text_to_image": "openai", "text": "a\0cat"}, "cannot be written"),
        ({"text_to_image": "openai", "text": "a\udcffcat"}, "cannot be written"),
        ({"text_to_image": "openai", "text": "cat" * 1000}, "3,000 characters"),
        ({"text_to_image": "openai", "text": "a cat", "via": "clip"}, "both --text-to-image and --via clip"),
        (
            {"text_to_image": "openai", "text": "a cat", "encoder": "tiny"},
            "both --text-to-image and the encoder",
        ),
        ({"image_to_3d": "tripo"}, "without a picture"),
        ({"image_to_3d": "tripo", "text": "a cat"}, "without a picture"),
        ({"image_to_3d": "tripo", "sketch": "s.png", "guidance": "m.glb"}, "both"),
        ({"image_to_3d": "trippo", "sketch": "SKETCH"}, "no back end 'trippo'"),
        ({"text_to_image": "gradio:http://h", "text": "a cat"}, "no back end 'gradio'"),
        ({"image_to_3d": "gradio", "sketch": "SKETCH"}, "http or https"),
    ],
)
def test_a_recipe_that_makes_no_sense_is_told(alone, sketch, asked, words):  # noqa: F811
    asked = {key: str(sketch) if value == "SKETCH" else value for key, value in asked.items()}
    with pytest.raises(InputError, match=words):
        answered(Recipe(**asked))


def test_the_built_in_road_asks_nobody(alone):  # noqa: F811
    recipe = Recipe(sketch="cat.png", image_to_3d="inflate")
    assert not recipe.mesh_wanted
    assert answered(recipe).recipe == Recipe(sketch="cat.png")


def test_the_cache_has_an_end_and_the_oldest_go_first(alone, monkeypatch):  # noqa: F811
    monkeypatch.setattr(cache, "MOST_FILES", 3)
    for number in range(5):
        path = cache.kept(f"x-{number}", "glb", b"12345")
        os.utime(path, (number, number))
    assert sorted(path.name for path in alone.iterdir()) == ["x-2.glb", "x-3.glb", "x-4.glb"]
    assert cache.found("x-2", ("glb",)) is not None, "and is the newest now"
    cache.kept("x-5", "glb", b"12345")
    assert sorted(path.name for path in alone.iterdir()) == ["x-2.glb", "x-4.glb", "x-5.glb"]
    monkeypatch.setattr(cache, "MOST_BYTES", 9)
    cache.kept("x-6", "glb", b"123456789012")
    assert [path.name for path in alone.iterdir()] == ["x-6.glb"], "the newest stays, however large"
    assert cache.cleared() == 1 and cache.cleared() == 0


def test_another_question_has_another_name():
    key = {"model": "a"}
    names = {
        cache.name_of("x", key, Request(b"1", "p", 0)),
        cache.name_of("y", key, Request(b"1", "p", 0)),
        cache.name_of("x", {"model": "b"}, Request(b"1", "p", 0)),
        cache.name_of("x", key, Request(b"2", "p", 0)),
        cache.name_of("x", key, Request(b"1", "q", 0)),
        cache.name_of("x", key, Request(b"1", "p", 1)),
    }
    assert len(names) == 6
    assert cache.name_of("x", key, Request(b"1", "p", 0, timeout_s=5.0)) in names


def test_a_cache_that_cannot_be_written_is_told(alone, sketch):  # noqa: F811
    alone.parent.mkdir(parents=True)
    alone.write_text("a file where the folder should be")
    with serving(gradio(glb())) as app, pytest.raises(InputError, match="cache folder"):
        answered(Recipe(sketch=str(sketch), image_to_3d=f"gradio:{app.url}"))


def test_nobody_agrees_by_accident():
    for need in ("always", "unless typed"):
        with pytest.raises(InputError, match="needs a yes"):
            refuse("image_to_3d", "x", Terms(("it costs",), need))
    refuse("image_to_3d", "x", Terms())
    assert "{}" in ask.DRAWN and "{}" in ask.SHOWN
