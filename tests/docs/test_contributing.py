"""The worked example of CONTRIBUTING.md does what it says."""

import re
import socket
import threading
import types
from pathlib import Path

import pytest

from gcs.contract.messages import Bad, PolarMeasurement
from tests.bridges.fake import FakeBus

TEXT = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def tracker() -> types.ModuleType:
    module = types.ModuleType("laser_tracker")
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    exec(code, module.__dict__)
    return module


def test_the_example_decodes_its_own_line(tracker):
    line = re.search("``(.*?)``", tracker.__doc__)[1].encode()
    seen = tracker.decode(line, 9, "track", "tcp")
    assert isinstance(seen, PolarMeasurement)
    assert (seen.t_ns, seen.range_m) == (1_767_225_600_125_000_000, 812.4031)
    assert (seen.azimuth_deg, seen.elevation_deg) == pytest.approx((12.25, 3.5), abs=1e-5)


@pytest.mark.parametrize("line", [b"", b"hello", b"1767225600 1 2", b"1767225600 1 2 x", b"-1 1 2 3"])
def test_what_is_no_measurement_says_so(tracker, line):
    assert isinstance(tracker.decode(line, 9, "track", "tcp"), Bad)


@pytest.mark.network
def test_a_line_that_does_not_end_is_no_measurement_and_fills_no_memory(tracker):
    bus = FakeBus()
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=_serve, args=(server,))
        thread.start()
        with pytest.raises(tracker.feed.FeedError, match="closed by the tracker"):
            tracker.run(bus, "track", server.getsockname(), threading.Event())
        thread.join()
    bads = [message for _, _, message in bus.sent]
    assert bads
    assert all(isinstance(bad, Bad) and len(bad.raw) <= tracker.feed.CLIP for bad in bads)


def _serve(server: socket.socket) -> None:
    with server.accept()[0] as link:
        for _ in range(1_000):
            link.sendall(b"x" * 5_000)
