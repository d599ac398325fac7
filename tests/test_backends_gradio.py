"""A Gradio app makes a mesh: spoken to as its own guide says, believed in nothing."""

import json

import pytest
from backed import alone, glb, png  # noqa: F401
from services import Told, as_json, dripping, endless, gradio, serving

from fabcraft.backends.answer import checked_mesh
from fabcraft.backends.backend import Answer, Request
from fabcraft.backends.gradio import Gradio
from fabcraft.errors import FabcraftError, InputError, MissingError

pytestmark = pytest.mark.usefixtures("alone")


def made(url: str, timeout_s: float = 10.0) -> Answer:
    return Gradio(url).make(Request(png(), seed=7, timeout_s=timeout_s), lambda done, of: None)


def stream(*events: tuple[str, object]):
    text = "".join(f"event: {name}\ndata: {json.dumps(data)}\n\n" for name, data in events)
    return lambda _: Told(text.encode(), headers={"Content-Type": "text/event-stream"})


def test_the_app_gets_the_picture_the_seed_and_its_own_defaults():
    with serving(gradio(glb())) as app:
        answer = made(app.url)
        assert answer.data == glb() and checked_mesh(answer, "gradio") == "glb"
        assert app.last("POST /gradio_api/upload").form == {"files": png()}
        picture, size, seed = app.last("POST .*/call/generate").json["data"]
        assert picture["path"] == "/tmp/gradio/12/picture.png" and picture["meta"] == {
            "_type": "gradio.FileData"
        }
        assert (size, seed) == (256, 7)


def test_an_app_of_gradio_4_has_its_api_at_the_top():
    app = gradio(glb(), config=lambda _: as_json({"version": "4.44.1", "components": []}))
    app.routes = {way.replace("/gradio_api", ""): route for way, route in app.routes.items()}
    with serving(app):
        assert made(f"{app.url}/#/generate").data == glb()


@pytest.mark.parametrize("name", ["/nope", "nope"])
def test_an_unknown_endpoint_is_told_with_those_there_are(name):
    with serving(gradio(glb())) as app:
        with pytest.raises(InputError, match="no endpoint /nope") as caught:
            made(f"{app.url}#{name}")
        assert "/generate" in caught.value.next_step


def test_two_that_fit_have_to_be_told_apart():
    app = gradio(glb())
    info = next(route for way, route in app.routes.items() if way.endswith("info"))(None)
    named = json.loads(info.body)
    named["named_endpoints"]["/other"] = named["named_endpoints"]["/generate"]
    with (
        serving(gradio(glb(), info=lambda _: as_json(named))) as app,
        pytest.raises(InputError, match="has 2 endpoints"),
    ):
        made(app.url)


def test_an_error_of_the_app_is_told_in_its_words():
    with (
        serving(gradio(glb(), events=stream(("error", {"error": "no face found"})))) as app,
        pytest.raises(MissingError, match="no face found"),
    ):
        made(app.url)


@pytest.mark.parametrize("file", ["file:///etc/passwd.glb", "ftp://127.0.0.1/m.glb", "gopher://h/m.glb"])
def test_a_mesh_elsewhere_is_fetched_from_the_web_or_not_at_all(file):
    with (
        serving(gradio(glb(), events=stream(("complete", [{"url": file}])))) as app,
        pytest.raises(InputError, match="no web address"),
    ):
        made(app.url)


@pytest.mark.parametrize(
    "changed",
    [
        {"config": lambda _: Told(b"<html>not gradio</html>")},
        {"config": lambda _: as_json([])},
        {"config": lambda _: as_json({"components": [], "api_prefix": "/a:b@elsewhere"})},
        {"info": lambda _: as_json({"named_endpoints": {"/a": {"parameters": [1], "returns": 2}, "/b": 3}})},
        {"upload": lambda _: as_json({"path": 1})},
        {"call": lambda _: as_json({"event_id": 5})},
        {"events": stream(("heartbeat", None))},
        {"events": lambda _: Told(b"event: complete\ndata: {{{\n\n")},
        {"events": stream(("complete", [[[{"path": 7}], None], "out.glb"]))},
        {"events": lambda _: Told(pieces=endless())},
        {"events": lambda _: Told(b"", status=404)},
        {"file": lambda _: Told(status=500)},
        {"file": lambda _: Told(b"x", length=10**12)},
    ],
)
def test_whatever_an_app_answers_is_a_sentence(changed):
    with serving(gradio(glb(), **changed)) as app, pytest.raises(FabcraftError) as caught:
        made(app.url)
    assert len(str(caught.value)) < 900 and caught.value.next_step


def test_an_app_that_never_ends_is_left_at_the_deadline():
    with (
        serving(gradio(glb(), events=lambda _: Told(pieces=dripping()))) as app,
        pytest.raises(MissingError, match="no answer within 1 s"),
    ):
        made(app.url, 1.0)


def test_a_token_goes_to_spaces_alone(monkeypatch):
    monkeypatch.setenv("HF_TOKEN", "hf_secret")
    with serving(gradio(glb())) as app:
        made(app.url)
        assert all("authorization" not in one.headers for one in app.asked)
    assert Gradio("https://me-app.hf.space")._token() == "hf_secret"
    assert Gradio("https://hf.space.example.org")._token() == ""
    assert Gradio("http://me-app.hf.space")._token() == ""


def test_what_leaves_this_machine_needs_a_yes():
    assert Gradio("http://127.0.0.1:7860").terms(Request()).ask == "never"
    terms = Gradio("https://me-hunyuan3d-2.hf.space").terms(Request())
    assert terms.ask == "always" and any("excludes" in one for one in terms.said)
    assert any("me-hunyuan3d-2.hf.space" in one for one in terms.said)


def test_a_real_gradio_app_is_spoken_to(tmp_path, monkeypatch):
    """With Gradio installed (it is in no extra: only its apps need it)."""
    monkeypatch.setenv("GRADIO_ANALYTICS_ENABLED", "False")
    gr = pytest.importorskip("gradio", reason="gradio is not installed")
    seen: list[tuple] = []

    def generate(image, size, seed, randomize_seed):
        seen.append((image.size, size, seed, randomize_seed))
        (tmp_path / "out.glb").write_bytes(glb())
        return str(tmp_path / "out.glb"), seed

    def failing(image):
        raise gr.Error("no face found")

    with gr.Blocks() as app:
        image, size = gr.Image(type="pil"), gr.Slider(32, 320, value=256)
        seed, chance = gr.Number(0, label="Seed"), gr.Checkbox(True, label="Randomize seed")
        model = gr.Model3D()
        gr.Button().click(generate, [image, size, seed, chance], [model, gr.Number()], api_name="generate")
        gr.Button().click(failing, [image], [gr.JSON()], api_name="failing")
    try:
        _, url, _ = app.launch(prevent_thread_lock=True, quiet=True, allowed_paths=[str(tmp_path)])
        assert made(url).data == glb()
        assert seen == [((96, 96), 256, 7, False)]
        with pytest.raises(MissingError, match="no face found"):
            made(f"{url}#/failing")
    finally:
        app.close()
