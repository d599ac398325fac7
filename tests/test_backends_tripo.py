"""Tripo's service: a task is paid for once, its key is kept, and what comes back is believed in nothing."""

import pytest
from backed import KEY, alone, glb, png  # noqa: F401
from services import Told, as_json, serving, tripo

from fabcraft.backends.backend import Answer, Request
from fabcraft.backends.registry import backend
from fabcraft.backends.tripo import Tripo
from fabcraft.errors import FabcraftError, InputError, MissingError

BEGIN = "POST /v3/generation/image-to-model"


@pytest.fixture
def key(alone, monkeypatch: pytest.MonkeyPatch):  # noqa: F811
    monkeypatch.setenv("TRIPO_API_KEY", KEY)
    return monkeypatch


def made(service, patch: pytest.MonkeyPatch, seed: int = 0) -> Answer:
    patch.setenv("TRIPO_BASE_URL", service.url)
    return Tripo("").make(Request(png(), seed=seed, timeout_s=10.0), lambda done, of: None)


def test_upload_task_and_download(key):
    with serving(tripo(glb())) as service:
        answer = made(service, key, seed=3)
        assert answer.data == glb() and answer.name == "m.glb"
        assert service.last("POST /v3/files").form == {"file": png()}
        assert service.last(BEGIN).json == {
            "input": "file_1",
            "model": "v2.5-20250123",
            "texture": False,
            "pbr": False,
            "model_seed": 3,
        }
        assert service.count("GET /v3/tasks/t-1") == 3
        assert all(
            one.headers["authorization"] == f"Bearer {KEY}" for one in service.asked if "/v3/" in one.path
        )


def test_the_key_does_not_go_to_where_the_meshes_lie(key):
    with serving(tripo(glb())) as store, serving(tripo(glb())) as service:
        url = f"{store.url}/store/m.glb?sign=1"
        done = {"code": 0, "data": {"status": "success", "output": {"model_url": url}}}
        service.routes["GET /v3/tasks/t-1"] = lambda _: as_json(done)
        assert made(service, key).data == glb()
        assert "authorization" not in store.last("GET /store.*").headers


def test_a_task_that_is_paid_for_goes_on_after_a_run_broke_off(key):
    with serving(tripo(glb(), store=lambda _: Told(status=500))) as service:
        with pytest.raises(MissingError):
            made(service, key)
        assert "goes on" in Tripo("").terms(Request(png())).said[0]
        assert Tripo("").terms(Request(png(), seed=1)).ask == "always", "another question is another task"
        service.routes[r"GET /store/m\.glb\?sign=1"] = lambda _: Told(glb())
        assert made(service, key).data == glb()
        assert service.count(BEGIN) == 1
        made(service, key)
        assert service.count(BEGIN) == 2, "what is done is forgotten"


def test_a_task_that_failed_is_not_asked_after_again(key):
    failed = as_json({"code": 0, "data": {"status": "failed", "error_msg": "no object"}})
    with serving(tripo(glb(), task=lambda _: failed)) as service:
        for _ in range(2):
            with pytest.raises(MissingError, match="failed: no object"):
                made(service, key)
        assert service.count(BEGIN) == 2


def test_a_server_that_breaks_while_a_task_is_made_is_not_asked_twice(key):
    with serving(tripo(glb(), begin=lambda _: Told(status=500))) as service:
        with pytest.raises(MissingError, match="500"):
            made(service, key)
        assert service.count(BEGIN) == 1


def test_a_busy_server_is_asked_again(key):
    answers = [
        Told(status=429, headers={"Retry-After": "0"}),
        as_json({"code": 0, "data": {"task_id": "t-1"}}),
    ]
    with serving(tripo(glb(), begin=lambda _: answers.pop(0))) as service:
        assert made(service, key).data == glb()
        assert service.count(BEGIN) == 2


def test_an_unknown_key_is_exit_3_without_the_key(key):
    refused = as_json({"code": 1001, "message": f"{KEY} is unknown"}, 401)
    with serving(tripo(glb(), files=lambda _: refused)) as service, pytest.raises(MissingError) as caught:
        made(service, key)
    assert KEY not in str(caught.value) and "TRIPO_API_KEY" in caught.value.next_step


@pytest.mark.parametrize("url", ["file:///etc/passwd", "ftp://h/m.glb", 7, None])
def test_a_mesh_lies_on_the_web_or_nowhere(key, url):
    done = as_json({"code": 0, "data": {"status": "success", "output": {"model_url": url}}})
    with serving(tripo(glb(), task=lambda _: done)) as service, pytest.raises(InputError):
        made(service, key)


@pytest.mark.parametrize(
    "told",
    [
        Told(b"<html>maintenance</html>"),
        Told(b"{"),
        as_json([]),
        as_json({"code": 0}),
        as_json({"code": 0, "data": []}),
        as_json({"code": 2010, "message": "not enough credit"}),
        as_json({"code": 0, "data": {"file_token": 5, "task_id": "../../x", "progress": "much"}}),
        as_json({"code": 0, "data": {"status": "success", "output": "here"}}),
    ],
)
@pytest.mark.parametrize("where", ["files", "begin"])
def test_whatever_it_answers_is_a_sentence(key, where, told):
    with serving(tripo(glb(), **{where: lambda _: told})) as service, pytest.raises(FabcraftError) as caught:
        made(service, key)
    assert caught.value.next_step and KEY not in str(caught.value)


@pytest.mark.parametrize("value", ["", "sk-other", "tsk_\n"])
def test_no_key_is_exit_3_with_the_line_to_type(alone, monkeypatch, value):  # noqa: F811
    monkeypatch.setenv("TRIPO_API_KEY", value)
    with pytest.raises(MissingError) as caught:
        backend("image_to_3d", "tripo")
    assert caught.value.exit_code == 3 and "export TRIPO_API_KEY=" in caught.value.next_step


def test_cost_and_place_are_told_and_need_a_yes(key):
    terms = Tripo("").terms(Request(png()))
    assert terms.ask == "always" and "credits" in terms.said[0] and "openapi.tripo3d.ai" in terms.said[1]
    with pytest.raises(InputError):
        Tripo("a b")
