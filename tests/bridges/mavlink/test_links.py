"""The live link: UDP and TCP, lost and found again, addresses that are none."""

import socket
import threading
import time

import pytest

from bridges.mavlink import mavlink
from bridges.mavlink.flightclock import S
from tests.bridges.fake import SortingBus
from tests.bridges.flights import START_US, flight, packed
from tests.ports import free_port

pytestmark = pytest.mark.network


def frames_of(seconds=12.0) -> list[bytes]:
    return [record[8:] for record in packed(flight(seconds))]


def until(condition, timeout_s=20.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


@pytest.fixture
def listen():
    """Start ``mavlink.run`` on a link; gives (bus, errors of the thread)."""
    stop, threads = threading.Event(), []

    def start(link):
        bus = SortingBus()
        threads.append(threading.Thread(target=mavlink.run, args=(link, 1, bus, stop)))
        threads[-1].start()
        return bus

    yield start
    stop.set()
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()


def count(bus) -> int:
    return sum(m.lat_deg is not None for m in bus.raw)


def test_udp_in_hears_everything_and_says_nothing(listen):
    port = free_port(socket.SOCK_DGRAM)
    bus = listen(f"udpin:127.0.0.1:{port}")
    assert until(lambda: bus.events)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.connect(("127.0.0.1", port))
        for frame in frames_of():
            vehicle.send(frame)
            time.sleep(0.0002)
        assert until(lambda: count(bus) == 110)
        vehicle.setblocking(False)
        with pytest.raises(BlockingIOError):
            vehicle.recv(1)
    assert bus.alive == {"ins"}
    assert abs(bus.raw[-1].arrival_ns - time.time_ns()) < 60 * S
    assert bus.raw[-1].t_ns < START_US * 1000 + 60 * S


def test_udp_out_knocks_with_nothing(listen):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(20)
        bus = listen(f"udpout:127.0.0.1:{vehicle.getsockname()[1]}")
        knock, station = vehicle.recvfrom(100)
        assert knock == b""
        for frame in frames_of():
            vehicle.sendto(frame, station)
            time.sleep(0.0002)
        assert until(lambda: count(bus) == 110)


def test_tcp_is_opened_again_after_a_loss(listen, monkeypatch):
    monkeypatch.setattr(mavlink, "RETRY_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as server:
        bus = listen(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        frames = frames_of()
        half = len(frames) // 2
        for part in (frames[:half], frames[half:]):
            vehicle, _ = server.accept()
            with vehicle:
                vehicle.sendall(b"".join(part))
                assert until(lambda: bus.raw and bus.raw[-1].t_ns >= 0)
        assert until(lambda: count(bus) == 110)
        assert until(lambda: len(bus.events) >= 3)
    assert "closed by the other end" in bus.events[1]


def test_link_that_is_not_there_yet_is_told_and_tried_again(listen, monkeypatch):
    monkeypatch.setattr(mavlink, "RETRY_S", 0.05)
    port = free_port()
    bus = listen(f"tcp:127.0.0.1:{port}")
    assert until(lambda: bus.events)
    assert "refused" in bus.events[0]
    with socket.create_server(("127.0.0.1", port)) as server:
        vehicle, _ = server.accept()
        with vehicle:
            vehicle.sendall(b"".join(frames_of()))
            assert until(lambda: count(bus) == 110)


@pytest.mark.parametrize(
    ("link", "says"),
    [
        ("udpin:127.0.0.1", "udpin:HOST:PORT"),
        ("udpin:127.0.0.1:99999", "udpin:HOST:PORT"),
        ("tcp:here", "tcp:HOST:PORT"),
    ],
)
def test_addresses_that_are_none(link, says):
    with pytest.raises(mavlink.LinkError, match=says):
        mavlink.run(link, 1, SortingBus(), threading.Event())


def test_port_in_use():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", 0))
        with pytest.raises(mavlink.LinkError, match="another ground station"):
            mavlink.run(f"udpin:127.0.0.1:{other.getsockname()[1]}", 1, SortingBus(), threading.Event())
