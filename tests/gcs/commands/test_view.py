"""``gcs view``: which vehicles and what beside them, and the page of a station on the bus."""

import signal
import subprocess
import sys
import time
import urllib.request
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from gcs.commands.cli import main
from gcs.commands.view import Finder
from gcs.contract import messages
from gcs.contract.wire.bus import Bus
from tests.ports import free_port
from tests.web import flight

SAMPLE = Path(__file__).parents[3] / "logs" / "sample"


@pytest.fixture
def view(monkeypatch, capsys):
    """Runs the command with no bus and no page; gives what the page would be opened with."""

    def view(*options, code: int = 0):
        told = {}

        def run(buses, port, _stop, _opened, *, origins, other, ground, more):
            told.update(vehicles=list(buses), port=port, origins=origins, other=other, ground=ground)

        bus = SimpleNamespace(vehicles=set)
        monkeypatch.setattr("gcs.commands.view.open_bus", lambda *_, **__: nullcontext(bus))
        monkeypatch.setattr("gcs.commands.view.stopped", lambda: None)
        monkeypatch.setattr("os.nice", lambda by: told.update(niced=by))
        monkeypatch.setattr("web.follow.run", run)
        arguments = ["gcs", "view", "--station", SAMPLE / "station.toml", *options]
        monkeypatch.setattr(sys, "argv", list(map(str, arguments)))
        with pytest.raises(SystemExit) as left:
            main()
        assert (left.value.code or 0) == code
        return told, capsys.readouterr().err

    return view


def test_all_of_the_range_by_default(view):
    told, said = view("--config", "view.port=18111")
    assert (told["vehicles"], told["port"], told["other"]) == ([], 18111, None)
    assert "/*" in said
    assert told["niced"] > 0  # it gives way to the station


def test_several_vehicles_in_the_order_they_are_named(view):
    told, said = view("--vehicle", "uav2", "uav1")
    assert told["vehicles"] == ["uav2", "uav1"]
    assert "/uav2, " in said


def test_one_named_twice_is_refused(view):
    _, said = view("--vehicle", "uav2", "uav2", code=2)
    assert "--vehicle uav2: named twice" in said


def test_another_course_is_read_before_anything_is_waited_for(view):
    told, _ = view("--overlay", SAMPLE / "truth.csv")
    assert told["other"].name == "truth.csv"
    told, said = view("--overlay", "nothing.csv", code=2)
    assert "vehicles" not in told
    assert "nothing.csv" in said


@pytest.mark.network
@pytest.mark.parametrize("named", [("--vehicle", "uav1", "uav2"), ()])
def test_two_stations_of_a_range_on_one_page(named):
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    options = [f"bus.endpoint={endpoint}", f"view.port={port}"]
    with (
        Bus.open("demo", "uav1", endpoint=endpoint) as first,
        Bus.open("demo", "uav2", mode="client", endpoint=endpoint) as second,
    ):
        for name, bus in (("uav1", first), ("uav2", second)):
            scene = msgspec.structs.replace(flight.SCENE, vehicle=name)
            bus.publish("scene", scene)
            bus.serve("scene", lambda scene=scene: messages.encode(scene))
        command = [sys.executable, "-m", "gcs", "view", "--station", SAMPLE / "station.toml"]
        command += [*named, *(word for one in options for word in ("--config", one))]
        process = subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True)
        try:
            assert process.stderr
            said = process.stderr.readline()
            while f"view: http://127.0.0.1:{port}" not in said:
                assert process.poll() is None, said
                said = process.stderr.readline()
            assert urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=20).status == 200
            with Bus.open("demo", "uav2", mode="client", endpoint=endpoint) as asking:
                assert asking.vehicles() == {"uav1", "uav2"}
            process.send_signal(signal.SIGINT)
            assert process.wait(30) == 0
        finally:
            process.kill()


def test_vehicles_that_nobody_named_are_found_each_once(monkeypatch):
    monkeypatch.setattr("gcs.commands.view.ASKED_S", 0.01)
    answers = [{"uav2"}, {"uav2", "uav1"}, {"uav1"}]
    finder = Finder(lambda: answers.pop(0) if answers else set(), lambda name: f"bus of {name}")
    found: list = []
    deadline_s = time.monotonic() + 20.0
    while len(found) < 2 and time.monotonic() < deadline_s:
        found += finder.new()
        time.sleep(0.01)
    finder.close()
    assert [name for name, _ in found] == ["uav2", "uav1"]
    assert found[1][1] == "bus of uav1"
