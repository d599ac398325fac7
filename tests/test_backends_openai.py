"""A server with OpenAI's images API makes a picture: of words, or over a sketch."""

import base64

import pytest
from backed import KEY, alone, png  # noqa: F401
from services import Told, as_json, openai, serving

from fabcraft.backends.answer import checked_picture
from fabcraft.backends.backend import Request
from fabcraft.backends.openai import OpenAI
from fabcraft.backends.registry import backend
from fabcraft.errors import FabcraftError, InputError, MissingError

pytestmark = pytest.mark.usefixtures("alone")


def made(service, patch: pytest.MonkeyPatch, picture: bytes = b"") -> bytes:
    patch.setenv("OPENAI_BASE_URL", f"{service.url}/v1")
    request = Request(picture, "a cat", timeout_s=10.0)
    answer = OpenAI("tiny").make(request, lambda done, of: None)
    assert checked_picture(answer, "openai") == "png"
    return answer.data


def test_words_become_a_picture(monkeypatch):
    with serving(openai(png())) as service:
        monkeypatch.setenv("OPENAI_API_KEY", KEY)
        assert made(service, monkeypatch) == png()
        asked = service.last("POST /v1/images/generations")
        assert asked.json == {"model": "tiny", "prompt": "a cat", "size": "1024x1024", "n": 1}
        assert asked.headers["authorization"] == f"Bearer {KEY}"


def test_a_sketch_goes_along(monkeypatch):
    with serving(openai(png())) as service:
        assert made(service, monkeypatch, png(64)) == png()
        form = service.last("POST /v1/images/edits").form
        assert form == {
            "model": b"tiny",
            "prompt": b"a cat",
            "size": b"1024x1024",
            "n": b"1",
            "image": png(64),
        }
        assert "authorization" not in service.asked[0].headers, "no key is set"


def test_a_picture_elsewhere_is_fetched_without_the_key(monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    with serving(openai(png())) as store, serving(openai(png())) as service:
        told = {"data": [{"url": f"{store.url}/store/p.png"}]}
        service.routes["POST /v1/images/generations"] = lambda _: as_json(told)
        assert made(service, monkeypatch) == png()
        assert "authorization" not in store.asked[0].headers


@pytest.mark.parametrize(
    "told",
    [
        Told(b"<html>"),
        Told(b'{"data": [', length=5),
        as_json({"data": []}),
        as_json({"data": {"b64_json": ""}}),
        as_json({"data": [{"b64_json": "%%%"}]}),
        as_json({"data": [{"b64_json": ""}]}),
        as_json({"data": [{"b64_json": base64.b64encode(b"<html>not a picture").decode()}]}),
        as_json({"data": [{"b64_json": base64.b64encode(png()[:60]).decode()}]}),
        as_json({"data": [{"url": "file:///etc/passwd"}]}),
        as_json({"error": {"message": f"unknown key {KEY}"}}, 401),
        as_json({"error": {"message": "billing hard limit"}}, 402),
        as_json({"error": {"message": "your words are against our policy"}}, 400),
        as_json({"error": {"message": "slow down"}}, 429),
    ],
)
def test_whatever_it_answers_is_a_sentence(monkeypatch, told):
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    with (
        serving(openai(png(), generations=lambda _: told)) as service,
        pytest.raises(FabcraftError) as caught,
    ):
        made(service, monkeypatch)
    assert caught.value.next_step and KEY not in str(caught.value)


def test_only_a_server_elsewhere_needs_a_key_and_a_yes(monkeypatch):
    with pytest.raises(MissingError, match="OPENAI_API_KEY is not set"):
        backend("text_to_image", "openai")
    assert OpenAI("").terms(Request()).ask == "always"
    monkeypatch.setenv("OPENAI_BASE_URL", "http://127.0.0.1:8080/v1")
    _, here = backend("text_to_image", "openai:sd-1.5")
    assert here.terms(Request()).ask == "never"
    with pytest.raises(InputError):
        OpenAI("a model")
