"""The station live, with parts that fail: they are told, start again, and the rest goes on."""

import json
import os
import signal
import socket
import sys
import threading
import time
from contextlib import ExitStack, suppress

import pytest

from bridges.mavlink import mavlink
from gcs.commands.serve import serve
from gcs.contract import config, supervision
from gcs.contract.messages import Event, Health, InputError, PolarMeasurement, State
from gcs.contract.wire.bus import Bus
from gcs.outputs.record import Record
from tests.gcs.contract.ends import process, until
from tests.ports import free_port

pytestmark = [pytest.mark.network, pytest.mark.slow]

STATION = """
[range]
name = "demo"
origin = { lat_deg = -35.36, lon_deg = 149.16, alt_m = 584.0 }
[[sensor]]
name = "theo"
kind = "theodolite"
position = { lat_deg = -35.36, lon_deg = 149.17, alt_m = 584.0 }
"""
SECONDS = 4.0


@pytest.fixture
def station(tmp_path):
    port = free_port()
    file = tmp_path / "station.toml"
    file.write_text(STATION)
    return config.load(file, [f"bus.endpoint=tcp/127.0.0.1:{port}", "mavlink.link=udpin:127.0.0.1:23999"])


class Watching:
    """One theodolite at 20 Hz beside the station, and all that the station says meanwhile."""

    def __init__(self, station, stop):
        self.heard, self._station, self._stop = [], station, stop

    def __call__(self, stack: ExitStack) -> threading.Event:
        endpoint = self._station.bus.endpoint
        bus = stack.enter_context(Bus.open("demo", "uav1", mode="client", endpoint=endpoint))
        self._told = bus.subscribe("state", "event", "health")
        thread = threading.Thread(target=self._run, args=(bus,))
        thread.start()
        stack.callback(thread.join)
        stack.callback(self._stop.set)
        return self._stop

    def _run(self, bus):
        bus.declare_alive("theo")
        began = time.monotonic()
        while not self._stop.wait(0.05):
            t_ns, gone = time.time_ns(), time.monotonic() - began
            bus.publish(
                "raw",
                PolarMeasurement(
                    t_ns=t_ns, arrival_ns=t_ns, range_m=900.0 + gone, azimuth_deg=30.0, elevation_deg=12.0
                ),
                "theo",
            )
            self.heard += [message for _, message in self._told.drain(0.0)]

    def all(self, kind) -> list:
        return [message for message in self.heard if isinstance(message, kind)]


def test_a_link_that_fails_starts_again_and_the_flight_goes_on(station, tmp_path, monkeypatch):
    monkeypatch.setattr(supervision, "WAITS_S", (0.2,))
    begun = []

    def link(address, system_id, bus, stop, keep):
        begun.append(address)
        if len(begun) < 3:
            raise AttributeError("alt_ellipsoid")
        bus.publish("event", Event(t_ns=0, level="info", text="listening again"))
        while not stop.wait(0.05):
            pass

    monkeypatch.setattr(mavlink, "run", link)
    stop = threading.Event()
    instrument = Watching(station, stop)
    serve(station, tmp_path / "run", stop, view=False, seconds=SECONDS, beside=instrument)
    texts = [event.text for event in instrument.all(Event)]
    assert any(text.startswith("mavlink failed: AttributeError: alt_ellipsoid") for text in texts)
    assert "listening again" in texts
    health = instrument.all(Health)[-1].parts
    assert (health["mavlink"].running, health["mavlink"].failures) == (True, 2)
    assert len(instrument.all(State)) > 20
    written = (tmp_path / "run" / "station.log").read_text()
    assert 'raise AttributeError("alt_ellipsoid")' in written
    assert "listening again" in written


def test_a_record_that_fails_costs_the_bus_nothing_and_the_run_says_so(station, tmp_path, monkeypatch):
    def full(self, *_):
        raise OSError("no space left on device")

    monkeypatch.setattr(mavlink, "run", lambda link, system_id, bus, stop, keep: stop.wait())
    monkeypatch.setattr(Record, "take", full)
    monkeypatch.setattr(Record, "close", full)
    stop = threading.Event()
    instrument = Watching(station, stop)
    with pytest.raises(SystemExit, match=r"record failed and is not whole; see .*station\.log"):
        serve(station, tmp_path / "run", stop, view=False, seconds=SECONDS, beside=instrument)
    texts = [event.text for event in instrument.all(Event)]
    assert any(
        text.startswith("record failed: OSError: no space left on device; set aside") for text in texts
    )
    assert not instrument.all(Health)[-1].parts["record"].running
    assert len(instrument.all(State)) > 20


def test_a_terminal_that_takes_nothing_does_not_hold_the_flight(station, tmp_path, monkeypatch):
    """As after Ctrl-S: whoever writes waits, until it is read again after the flight."""
    monkeypatch.setattr(mavlink, "run", lambda link, system_id, bus, stop, keep: stop.wait())
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, b"." * 1000)
    os.set_blocking(writer, True)
    stop, shown = threading.Event(), []

    def read():
        stop.wait()
        with open(reader, "rb") as pipe:
            shown.append(pipe.read().decode())

    reading = threading.Thread(target=read)
    reading.start()
    instrument = Watching(station, stop)
    with open(writer, "w") as terminal:
        terminal.isatty = lambda: True
        monkeypatch.setattr(sys, "stderr", terminal)
        serve(station, tmp_path / "run", stop, view=False, seconds=SECONDS, beside=instrument)
        monkeypatch.undo()
    reading.join()
    assert len(instrument.all(State)) > 20
    assert "values final" in shown[0]
    assert "run folder: " in shown[0]


def test_a_link_that_cannot_be_used_is_one_line(station, tmp_path):
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 23999))
        with pytest.raises(InputError, match=r"^udpin:127\.0\.0\.1:23999: .* choose another port$"):
            serve(station, tmp_path / "run", threading.Event(), view=False, seconds=30.0)


def test_a_loop_that_fails_goes_on_with_the_next_messages(station, tmp_path, monkeypatch):
    from gcs.station.session import Session

    monkeypatch.setattr(mavlink, "run", lambda link, system_id, bus, stop, keep: stop.wait())
    advance, turns = Session.advance, []

    def failing(self, *arguments):
        turns.append(0)
        if len(turns) == 60:
            raise ValueError("cannot happen")
        advance(self, *arguments)

    monkeypatch.setattr(Session, "advance", failing)
    stop = threading.Event()
    instrument = Watching(station, stop)
    serve(station, tmp_path / "run", stop, view=False, seconds=SECONDS + 2.0, beside=instrument)
    [text] = [event.text for event in instrument.all(Event) if event.text.startswith("session failed")]
    assert text == "session failed: ValueError: cannot happen; goes on in 0.5 s, failure 1"
    failed_ns = next(e.t_ns for e in instrument.all(Event) if e.text == text)
    assert sum(state.t_ns > failed_ns for state in instrument.all(State)) > 20
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["complete"]


BRIDGE = """
with Bus.open("demo", "uav1", mode="client", endpoint=sys.argv[1]) as bus:
    bus.declare_alive("theo")
    while True:
        t_ns = time.time_ns()
        seen = {"range_m": 900.0, "azimuth_deg": 30.0, "elevation_deg": 12.0}
        shot = PolarMeasurement(t_ns=t_ns, arrival_ns=t_ns, **seen)
        bus.publish("raw", shot, "theo")
        time.sleep(0.05)
"""


class Scenario:
    """What is done to a bridge in a process of its own, beside the station; ``heard`` are the events."""

    def __init__(self, station, stop, play):
        self.heard, self._station, self._stop, self._play = [], station, stop, play
        self.failed = None

    def __call__(self, stack: ExitStack) -> threading.Event:
        bus = Bus.open("demo", "uav1", mode="client", endpoint=self._station.bus.endpoint)
        self._told = stack.enter_context(bus).subscribe("event")
        threading.Thread(target=self._run).start()
        return self._stop

    def _run(self):
        try:
            self._play(self, self._station.bus.endpoint)
        except AssertionError as error:
            self.failed = error
        self._stop.set()

    def told(self, text: str, times: int = 1) -> None:
        """Wait for an event."""
        assert until(lambda: self._count(text) >= times, 20.0), f"never told: {text}, but {self.heard}"

    def _count(self, text: str) -> int:
        self.heard += [message.text for _, message in self._told.drain(0.05)]
        return self.heard.count(text)


def test_a_bridge_that_is_killed_or_stopped_is_told_and_so_is_its_return(station, tmp_path, monkeypatch):
    def play(scene, endpoint):
        with process(BRIDGE, endpoint) as bridge:
            scene.told("theo: its bridge is there")
            time.sleep(1.0)
            bridge.send_signal(signal.SIGSTOP)
            scene.told("theo is silent")
            bridge.send_signal(signal.SIGCONT)
            scene.told("theo is back")
            bridge.kill()
            scene.told("theo: its bridge is gone")
        with process(BRIDGE, endpoint):
            scene.told("theo: its bridge is there", 2)

    monkeypatch.setattr(mavlink, "run", lambda link, system_id, bus, stop, keep: stop.wait())
    stop = threading.Event()
    scene = Scenario(station, stop, play)
    serve(station, tmp_path / "run", stop, view=False, seconds=90.0, beside=scene)
    assert scene.failed is None


def test_every_message_of_a_flood_is_in_the_summary(station, tmp_path, monkeypatch):
    put = []

    def play(scene, endpoint):
        with Bus.open("demo", "uav1", mode="client", endpoint=endpoint) as bus:
            for number in range(3_000):
                t_ns = time.time_ns()
                far = 100.0 + (number * 7919) % 8000  # possible each, and somewhere else each time
                bus.publish("raw", PolarMeasurement(t_ns=t_ns, arrival_ns=t_ns, range_m=far), "theo")
                put.append(number)
            scene.told("theo: more than 200 a second; the rest is refused and counted")

    monkeypatch.setattr(mavlink, "run", lambda link, system_id, bus, stop, keep: stop.wait())
    stop = threading.Event()
    scene = Scenario(station, stop, play)
    serve(station, tmp_path / "run", stop, view=False, seconds=90.0, beside=scene)
    assert scene.failed is None
    counts = json.loads((tmp_path / "run" / "summary.json").read_text())["verdicts"]["theo"]
    values = sum(counts.get("range", {}).values())  # none where the station was stopped before it took one
    assert values + counts["line"]["invalid"] == len(put) == 3_000
    assert counts["line"]["invalid"] > 2_000


def test_the_last_words_of_a_station_reach_who_listens(station, tmp_path, monkeypatch):
    """The session ends after the stop, and what it says then still goes out."""
    monkeypatch.setattr(mavlink, "run", lambda link, system_id, bus, stop, keep: stop.wait())
    sent, publish = [], Bus.publish

    def watched(bus, subject, message, source=""):
        sent.append((subject, message))
        publish(bus, subject, message, source)

    monkeypatch.setattr(Bus, "publish", watched)
    stop = threading.Event()
    serve(station, tmp_path / "run", stop, view=False, seconds=SECONDS, beside=Watching(station, stop))
    assert [message.text for subject, message in sent if subject == "event"][-1] == "end of data"
    numbers = {subject: [m.seq for s, m in sent if s == subject] for subject in ("state", "smoothed")}
    assert numbers["state"] == list(range(len(numbers["state"])))
    last_ns = {subject: [m.t_ns for s, m in sent if s == subject][-1] for subject in ("state", "smoothed")}
    assert last_ns["smoothed"] == last_ns["state"]
