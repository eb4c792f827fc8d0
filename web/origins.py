"""Which pages may talk to the view: a browser lets any page of any site open a websocket to this machine.

A browser says in ``Origin`` which page asks, and in ``Host`` which name it believes to have reached. A
foreign origin is another site in the operator's browser; a foreign host is one whose name was turned to this
machine (DNS rebinding). Both are refused, for pages and websockets alike. Programs that are no browser may
leave ``Origin`` out: they could claim any, and the port is on loopback.
"""

import http
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_opening = threading.Lock()  # one server is opened at a time: what is changed for it is the library's


def refusal(request: Request, port: int, origins: Collection[str]) -> Response | None:
    """403 for a request from, or for, somebody else; None for one that may go on.

    ``origins`` are allowed beside this machine's own names: of what a proxy serves, ``https://range.example``.
    """
    own = {f"{name}:{port}" for name in LOOPBACK}
    hosts = own | {urlsplit(origin).netloc for origin in origins}
    pages = {f"http://{host}" for host in own} | {origin.rstrip("/") for origin in origins}
    for name, allowed in (("Host", hosts), ("Origin", pages)):
        for value in request.headers.get_all(name):
            if value.lower() not in {one.lower() for one in allowed}:
                line = f"{name} {value[:100]!r} is not allowed here: see [view] origins\n".encode()
                headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(line))})
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, line)
    return None


@contextmanager
def only(port: int, origins: Collection[str]) -> Iterator[None]:
    """A viser server that is opened within asks ``refusal`` before it answers anything.

    viser passes no such question on to the library that serves for it, so it is asked there.
    """
    serve = websockets.asyncio.server.serve

    def asking(*args: Any, process_request: Callable, **options: Any) -> Any:
        def ask(connection: Any, request: Request) -> Response | None:
            return refusal(request, port, origins) or process_request(connection, request)

        return serve(*args, process_request=ask, **options)

    with _opening:
        websockets.asyncio.server.serve = asking  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]
