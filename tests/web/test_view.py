"""The view from outside the browser: its port, its queue, and life on the bus."""

import socket
import threading
import time
import urllib.request

import pytest

from tests.ports import free_port
from tests.web.flight import SCENE, messages
from web.follow import run
from web.view import View, ViewError

pytestmark = pytest.mark.network


@pytest.fixture
def port() -> int:
    return free_port()


def test_a_taken_port_is_refused_in_one_line(port):
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", port))
        holder.listen()
        with pytest.raises(ViewError, match=f"^port {port} is in use: [^\n]*$"):
            View(SCENE, port=port)


def test_the_port_is_free_again_after_close(port):
    for _ in range(2):
        view = View(SCENE, port=port)
        assert urllib.request.urlopen(view.url, timeout=5).status == 200
        view.close()


def test_nothing_is_printed(port, capfd):
    View(SCENE, port=port).close()
    assert capfd.readouterr().out == ""


def test_a_flight_that_comes_at_full_speed_does_not_pile_up_for_a_picture_nobody_looks_at(port, monkeypatch):
    monkeypatch.setattr("web.view.UNSEEN_TICKS", 10**9)
    monkeypatch.setattr("web.view.UNSEEN_MOST", 50)
    view = View(SCENE, port=port)
    for message, source in messages(60.0):
        view.put(message, source)
    until_s = time.monotonic() + 10.0
    while (view.seen[0].waiting or view.flight.piled > 50) and time.monotonic() < until_s:
        time.sleep(0.05)
    view.close()
    assert len(view.flight.newest.view) > 500
    assert view.flight.piled <= 50


def test_what_fails_to_draw_is_logged_once_and_said_on_the_page(port, caplog):
    view = View(SCENE, port=port)

    def broken(*_):
        raise ValueError("cannot happen")

    view.picture.update = broken
    line = "the page failed to draw something: ValueError: cannot happen"
    until_s = time.monotonic() + 10.0
    while line not in view.notes() and time.monotonic() < until_s:
        time.sleep(0.05)
    time.sleep(0.5)  # some more pictures
    view.close()
    assert view.notes() == [line]
    assert [record.getMessage() for record in caplog.records] == [f"view: {line}"]
    assert caplog.records[0].exc_info


class SourceBus:
    """Hands out what it was given, once per subject."""

    def __init__(self):
        self.waiting = {"scene": [("", SCENE)], "smoothed": [], "state": []}
        for message, source in messages(2.0):
            self.waiting["smoothed" if source else "state"].append(("", message))

    def subscribe(self, *subjects: str):
        return FakeSubscription(self.waiting[subjects[0]])


class FakeSubscription:
    def __init__(self, pairs: list):
        self._pairs = pairs

    def drain(self, timeout_s: float = 0.1) -> list:
        if not self._pairs:
            time.sleep(timeout_s)
        pairs, self._pairs[:] = self._pairs[:], []
        return pairs


def test_alone_on_the_bus_it_opens_for_the_scene_and_ends_when_told(port):
    bus, stop, told = SourceBus(), threading.Event(), []
    alone = threading.Thread(target=run, args=({"uav1": bus}, port, stop, told.append))
    alone.start()
    deadline_s = time.monotonic() + 20
    while any(bus.waiting.values()) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert not any(bus.waiting.values())
    assert urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=5).status == 200
    assert told == [f"http://127.0.0.1:{port}"]
    stop.set()
    alone.join(10)
    assert not alone.is_alive()
