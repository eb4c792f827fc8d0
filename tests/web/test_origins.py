"""Who may talk to the view: tried with real requests and real websockets, as a browser would send them."""

import socket
import urllib.error
import urllib.request
from collections.abc import Iterator

import pytest
import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request
from websockets.sync.client import connect

from tests.ports import free_port
from tests.web.flight import SCENE
from web.origins import only, refusal
from web.view import View

PROXY = "https://range.example"
SUBPROTOCOL = f"viser-v{viser.__version__}"


def asked(**headers: str):
    return refusal(Request("/", Headers(headers)), 8080, [PROXY])


@pytest.mark.parametrize(
    "host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "LOCALHOST:8080", "range.example"]
)
def test_own_names_are_let_in(host):
    assert asked(Host=host) is None
    scheme = "https" if host == "range.example" else "http"
    assert asked(Host=host, Origin=f"{scheme}://{host}") is None


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "127.0.0.1:8080", "Origin": "http://evil.example"},
        {"Host": "127.0.0.1:8080", "Origin": "http://127.0.0.1:9999"},
        {"Host": "127.0.0.1:8080", "Origin": "https://127.0.0.1:8080"},
        {"Host": "127.0.0.1:8080", "Origin": "null"},
        {"Host": "127.0.0.1:8080", "Origin": "http://range.example"},
        {"Host": "127.0.0.1:8080", "Origin": f"{PROXY}.evil.example"},
        {"Host": "evil.example:8080", "Origin": "http://evil.example:8080"},
        {"Host": "127.0.0.1.evil.example:8080"},
        {"Host": "127.0.0.1:9999"},
        {"Host": ""},
    ],
)
def test_others_are_not(headers):
    response = asked(**headers)
    assert response.status_code == 403
    assert b"[view] origins" in response.body


def test_each_of_several_headers_is_looked_at():
    several = Headers(
        [("Host", "127.0.0.1:8080"), ("Origin", "http://127.0.0.1:8080"), ("Origin", "http://evil")]
    )
    assert refusal(Request("/", several), 8080, ()) is not None


def test_the_library_is_left_as_it_was_even_after_a_failure():
    before, within = websockets.asyncio.server.serve, []

    def fail() -> None:
        with only(8080, ()):
            within.append(websockets.asyncio.server.serve)
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert within != [before]
    assert websockets.asyncio.server.serve is before


@pytest.fixture(scope="module")
def view() -> Iterator[View]:
    port = free_port()
    view = View(SCENE, port=port, origins=[PROXY])
    yield view
    view.close()


def socket_of(view: View, origin: str | None, host: str | None = None):
    """A websocket as a browser opens it, with the view's own subprotocol."""
    port = int(view.url.rsplit(":", 1)[1])
    link = socket.create_connection(("127.0.0.1", port))
    uri = f"ws://{host or f'127.0.0.1:{port}'}/"
    return connect(
        uri, sock=link, origin=origin, subprotocols=[SUBPROTOCOL], open_timeout=10, close_timeout=2
    )


@pytest.mark.network
def test_a_websocket_of_the_page_itself_is_served(view):
    for origin in (view.url, PROXY, None):
        with socket_of(view, origin) as opened:
            assert opened.recv(timeout=10)


@pytest.mark.network
@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "null", f"{PROXY}:444"])
def test_a_websocket_of_a_foreign_page_is_refused(view, origin):
    with pytest.raises(InvalidStatus) as refused:
        socket_of(view, origin)
    assert refused.value.response.status_code == 403


@pytest.mark.network
def test_a_name_that_was_turned_to_this_machine_is_refused(view):
    with pytest.raises(InvalidStatus) as refused:
        socket_of(view, None, "evil.example")
    assert refused.value.response.status_code == 403
    page = urllib.request.Request(view.url, headers={"Host": "evil.example"})
    with pytest.raises(urllib.error.HTTPError) as forbidden:
        urllib.request.urlopen(page, timeout=5)
    assert forbidden.value.code == 403


@pytest.mark.network
def test_the_page_is_served_to_this_machine(view):
    assert urllib.request.urlopen(view.url, timeout=5).status == 200
