"""Feeds on their way to the bus: lines over UDP, and files played at their own pace."""

import json
import math
import socket
import threading
import time

import pytest

from bridges import feed
from gcs.contract.messages import Bad, PolarMeasurement
from tests.bridges.fake import FakeBus
from tests.ports import free_port

HEADER = "t,range_m,azimuth_deg,elevation_deg\n"
T = 1_767_225_600_126_236_328


@pytest.mark.network
def test_udp_to_bus():
    bus, stop, port = FakeBus(), threading.Event(), free_port(socket.SOCK_DGRAM)
    bridge = threading.Thread(target=feed.run, args=(bus, "theo", ("127.0.0.1", port), stop))
    bridge.start()
    while not bus.alive:
        time.sleep(0.01)
    before_ns, patience_s = time.time_ns(), time.monotonic() + 10
    lines = [json.dumps({"t": 1_767_225_600 + i, "range_m": i}).encode() for i in range(500)] + [b"rubbish"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as instrument:
        for sent, line in enumerate(lines, 1):
            instrument.sendto(line, ("127.0.0.1", port))
            while (
                sent - len(bus.sent) > 50 and time.monotonic() < patience_s
            ):  # the socket's buffer is finite
                time.sleep(0.001)
        while len(bus.sent) < len(lines) and time.monotonic() < patience_s:
            time.sleep(0.001)
    stop.set()
    bridge.join()
    assert bus.alive == ["theo"]
    assert {(subject, source) for subject, source, _ in bus.sent} == {("raw", "theo")}
    *good, bad = [message for _, _, message in bus.sent]
    assert [m.range_m for m in good] == list(range(500))
    assert all(before_ns <= m.arrival_ns <= time.time_ns() for m in good)
    assert bad.where == f"udp 127.0.0.1:{port} #501"


@pytest.mark.network
def test_busy_port_is_refused_in_one_line():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        address = other.getsockname()
        with pytest.raises(feed.FeedError, match=f"udp 127.0.0.1:{address[1]}: .*choose another"):
            feed.run(FakeBus(), "theo", address, threading.Event())


@pytest.fixture
def late_file(tmp_path):
    path = tmp_path / "theo.csv"
    path.write_text(
        HEADER + "1767225600,1,1,1\n1767225602,2,2,2\n1767225601,3,3,3\n1767225603,x,4,4\nrubbish\n"
    )
    return path


def test_file_is_played_in_its_order_with_its_own_times(late_file):
    bus = FakeBus()
    feed.run(bus, "theo", late_file, threading.Event(), speed=math.inf)
    messages = [message for _, _, message in bus.sent]
    rows, bad = feed.read(late_file, "theo")
    assert [m for m in messages if isinstance(m, PolarMeasurement)] == list(feed.measurements(rows))
    assert [m for m in messages if isinstance(m, Bad)] == sorted(bad, key=lambda b: b.t_ns or 0)


def test_pace_follows_the_stamps(late_file):
    class Clock:
        """An event whose waits are noted, not waited."""

        waits: list = []  # noqa: RUF012

        def wait(self, seconds):
            self.waits.append(seconds)

        def is_set(self):
            return False

    feed.run(FakeBus(), "theo", late_file, Clock(), speed=2.0, begin_ns=1_767_225_590 * 10**9)
    assert Clock.waits == pytest.approx([5.0, 5.0, 6.0, 6.0, 6.5, 6.5], abs=0.1)


def test_played_as_if_now(late_file):
    bus, before_ns = FakeBus(), time.time_ns()
    feed.run(bus, "theo", late_file, threading.Event(), speed=math.inf, now=True)
    times = [m.t_ns for _, _, m in bus.sent if m.t_ns]
    assert before_ns <= times[0] <= time.time_ns()
    assert times[-1] - times[0] == 3 * 10**9


def test_stop_ends_play(late_file):
    bus, stop = FakeBus(), threading.Event()
    stop.set()
    feed.run(bus, "theo", late_file, stop)
    assert not bus.sent


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, 1e300])
def test_a_speed_that_cannot_be_is_refused(speed):
    with pytest.raises(feed.FeedError, match="--speed"):
        feed.play(FakeBus(), [], threading.Event(), speed=speed)


def test_a_port_that_cannot_be_is_refused():
    with pytest.raises(feed.FeedError, match=r"udp 127\.0\.0\.1:99999: give a host, and a port"):
        feed.run(FakeBus(), "theo", ("127.0.0.1", 99999), threading.Event())
