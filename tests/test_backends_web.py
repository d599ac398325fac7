"""A web service is asked: bounded in time and size, over http(s) alone, again where that is safe, its key kept."""

import time

import pytest
from backed import KEY, alone  # noqa: F401
from services import Service, Told, as_json, dripping, endless, serving

from fabcraft.backends.address import checked_url, is_local
from fabcraft.backends.web import ATTEMPTS, Web
from fabcraft.errors import FabcraftError, InputError, MissingError

pytestmark = pytest.mark.usefixtures("alone")


def asking(service: Service, timeout_s: float = 10.0, key: str = "") -> Web:
    return Web.starting("the service", timeout_s, service.url, key, "Get a key.")


def turns(*told: Told):
    """A route that answers these in turn, the last for ever."""
    rest = list(told)
    return lambda _: rest.pop(0) if len(rest) > 1 else rest[0]


@pytest.mark.parametrize("status", [408, 429, 500, 502, 503, 504])
def test_what_may_pass_is_asked_again(status):
    with serving(Service({"GET /x": turns(Told(status=status), Told(b"here"))})) as service:
        assert asking(service).get(f"{service.url}/x", 100).data == b"here"
        assert service.count("GET /x") == 2


def test_retry_after_is_heeded_but_bounded():
    busy = Told(status=429, headers={"Retry-After": "3600"})
    with serving(Service({"GET /x": turns(busy, busy, Told(b"here"))})) as service:
        start = time.monotonic()
        assert asking(service).get(f"{service.url}/x", 100).data == b"here"
        assert 0.4 <= time.monotonic() - start < 3.0


def test_a_service_that_stays_busy_is_given_up_with_its_reason():
    with serving(
        Service({"GET /x": lambda _: as_json({"error": {"message": "come back later"}}, 429)})
    ) as service:
        with pytest.raises(MissingError, match=r"429.*come back later"):
            asking(service).get(f"{service.url}/x", 100)
        assert service.count("GET /x") == ATTEMPTS


@pytest.mark.parametrize(
    ("told", "count"), [(Told(status=500), 1), (Told(status=504), 1), (Told(status=503), ATTEMPTS)]
)
def test_what_may_have_begun_is_not_asked_for_twice(told, count):
    with serving(Service({"POST /x": lambda _: told})) as service:
        with pytest.raises(MissingError):
            asking(service).post_json(f"{service.url}/x", {})
        assert service.count("POST /x") == count


@pytest.mark.parametrize("status", [401, 403])
def test_a_refused_key_is_told_without_the_key(status):
    with serving(Service({"GET /x": lambda _: as_json({"message": f"bad key {KEY}"}, status)})) as service:
        with pytest.raises(MissingError, match="refused the key") as caught:
            asking(service, key=KEY).get(f"{service.url}/x", 100)
        assert service.count("GET /x") == 1
        assert service.asked[0].headers["authorization"] == f"Bearer {KEY}"
        assert KEY not in str(caught.value) and caught.value.next_step == "Get a key."


def test_the_key_goes_to_no_other_place():
    with serving(Service({"GET /mesh": lambda _: Told(b"mesh")})) as store:
        moved = Told(status=302, headers={"Location": f"{store.url}/mesh"})
        with serving(Service({"GET /x": lambda _: moved})) as service:
            assert asking(service, key=KEY).get(f"{service.url}/x", 100).data == b"mesh"
            assert "authorization" in service.asked[0].headers
            assert "authorization" not in store.asked[0].headers
    assert KEY not in repr(asking(service, key=KEY))


@pytest.mark.parametrize(
    "target", ["file:///etc/passwd", "ftp://127.0.0.1/x", "data:,x", "http://[", "javascript:x"]
)
def test_a_redirect_leads_to_the_web_or_nowhere(target):
    moved = Told(status=302, headers={"Location": target})
    with serving(Service({"GET /x": lambda _: moved})) as service:
        with pytest.raises(FabcraftError) as caught:
            asking(service).get(f"{service.url}/x", 100)
        assert "root:" not in str(caught.value)
        assert service.count("GET /x") <= ATTEMPTS


def test_redirects_come_to_an_end():
    with (
        serving(Service({"GET /x": lambda _: Told(status=302, headers={"Location": "/x"})})) as service,
        pytest.raises(InputError, match="redirects more than"),
    ):
        asking(service).get(f"{service.url}/x", 100)


def test_nothing_leads_from_https_to_http():
    web = Web.starting("the service", 1.0, "https://example.org")
    with pytest.raises(InputError, match="from https to http"):
        web.followed("http://example.org/mesh.glb", "https://example.org/task")


def test_a_post_is_not_redirected():
    with (
        serving(Service({"POST /x": lambda _: Told(status=307, headers={"Location": "/y"})})) as service,
        pytest.raises(InputError, match="has moved"),
    ):
        asking(service).post_json(f"{service.url}/x", {})


@pytest.mark.parametrize("told", [Told(b"x" * 200), Told(b"x", length=10**12)])
def test_an_answer_ends_at_its_limit(told):
    with serving(Service({"GET /x": lambda _: told})) as service, pytest.raises(InputError, match="bytes"):
        asking(service).get(f"{service.url}/x", 100)


def test_an_answer_without_an_end_is_left():
    with (
        serving(Service({"GET /x": lambda _: Told(pieces=endless())})) as service,
        pytest.raises(InputError, match="longer than 3,000,000 bytes"),
    ):
        asking(service).get(f"{service.url}/x", 3_000_000)


def test_a_cut_answer_is_asked_for_again_and_then_told():
    with serving(Service({"GET /x": turns(Told(b"he", length=4), Told(b"here"))})) as service:
        assert asking(service).get(f"{service.url}/x", 100).data == b"here"
    with (
        serving(Service({"GET /x": lambda _: Told(b"he", length=4)})) as service,
        pytest.raises(MissingError, match="cut short after 2 of 4"),
    ):
        asking(service).get(f"{service.url}/x", 100)


def test_a_service_that_dribbles_is_left_at_the_deadline():
    with serving(Service({"GET /x": lambda _: Told(pieces=dripping())})) as service:
        start = time.monotonic()
        with pytest.raises(MissingError, match=r"no answer within 0.5 s"):
            asking(service, 0.5).get(f"{service.url}/x", 10**6)
        assert time.monotonic() - start < 2.0


def test_a_service_that_dribbles_headers_is_left_at_the_deadline():
    import socket
    import threading

    with socket.create_server(("127.0.0.1", 0)) as server:

        def dribble() -> None:
            peer, _ = server.accept()
            with peer:
                try:
                    for _ in range(200):
                        peer.sendall(b"H")
                        time.sleep(0.05)
                except OSError:
                    return

        thread = threading.Thread(target=dribble, daemon=True)
        thread.start()
        url = f"http://127.0.0.1:{server.getsockname()[1]}"
        start = time.monotonic()
        with pytest.raises(MissingError, match=r"no answer within 0.5 s"):
            Web.starting("the service", 0.5, url).get(f"{url}/x", 100)
        assert time.monotonic() - start < 2.0


def test_nobody_there_is_told_at_once():
    import socket

    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(MissingError, match=r"cannot be reached.*refused"):
        Web.starting("the service", 5.0, url).get(url, 100)


@pytest.mark.parametrize("body", [b"<html>hello</html>", b"{", b"", b"[" * 100_000, b"\xff\xfe"])
def test_what_is_no_json_is_told(body):
    with (
        serving(Service({"GET /x": lambda _: Told(body)})) as service,
        pytest.raises(InputError, match="JSON was expected"),
    ):
        asking(service).get_json(f"{service.url}/x")


def test_events_come_one_by_one():
    text = b"event: generating\r\ndata: 1\r\n\r\n: a remark\n\ndata: a\ndata: b\n\nevent: complete\ndata: [2]\n\n"
    with serving(Service({"GET /x": lambda _: Told(text)})) as service:
        found = list(asking(service).events(f"{service.url}/x", 1000))
    assert found == [("generating", "1"), ("message", "a\nb"), ("complete", "[2]")]


@pytest.mark.parametrize(
    "url",
    [
        "",
        "127.0.0.1:7860",
        "file:///etc/passwd",
        "http://",
        "http://me:pw@host",
        "http://h?key=1",
        "http://h:x",
        "http://h /",
        "http://[::1",
    ],
)
def test_an_address_is_http_and_carries_no_secret(url):
    with pytest.raises(InputError) as caught:
        checked_url(url)
    assert "pw@" not in str(caught.value)


def test_this_machine_is_known():
    assert is_local("http://127.0.0.1:1") and is_local("http://localhost") and is_local("http://[::1]:8")
    assert not is_local("http://10.0.0.1") and not is_local("https://localhost.example.org")
