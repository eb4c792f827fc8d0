"""The recorder beside the fusion: a slow or full disk costs turns that are counted, and no fusion."""

import json
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil

from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from filters.models.rows import TRACK
from gcs.contract.messages import Event, InputError
from gcs.outputs import disk, recording
from gcs.outputs.recording import RunRecorder
from gcs.station.sources.recording import Recording, Turn
from tests.bridges import flights
from tests.gcs.contract.ends import until
from tests.gcs.station import made


@pytest.fixture
def told():
    return []


@pytest.fixture
def recorder(tmp_path, told):
    station, frame = made.station()
    return RunRecorder(tmp_path, station, frame, lambda level, text: told.append((level, text)), made.ABOUT)


@pytest.fixture
def turns():
    return made.turns(0.5)


def test_a_disk_that_hangs_is_told_counted_and_survived(recorder, told, turns, tmp_path, monkeypatch):
    """What fits waits, the rest is refused; when the disk is back, so is the recording."""
    monkeypatch.setattr(disk, "WAITING_WORK", 20)
    hangs, free = threading.Event(), threading.Event()

    def hang() -> None:
        hangs.set()
        free.wait(10)

    recorder._beside.put(hang)
    assert hangs.wait(10)
    for now_ns, arrived in turns:
        recorder.turn(now_ns, arrived)
    lost = recorder._refused["run.mcap"]
    assert 0 < lost < len(turns)
    assert told == [("error", f"{tmp_path}: the disk is too slow: the run folder is losing rows and turns")]
    free.set()
    done = threading.Event()
    recorder._beside.put(done.set, refuse=False)
    assert done.wait(10)
    recorder.turn(*turns[-1])
    recorder.close({}, np.empty(0, TRACK))
    recorder.end()
    assert told[1] == ("info", f"{tmp_path}: the disk keeps up again; missing: run.mcap {lost}")
    assert json.loads((tmp_path / "summary.json").read_text())["not_written"] == {"run.mcap": lost}
    kept = list(Recording(tmp_path / "run.mcap").turns())
    assert len(kept) == len(turns) + 1 - lost
    assert kept[-1].number == len(turns)


def test_a_disk_that_never_comes_back_does_not_hold_the_station(recorder, told, monkeypatch):
    monkeypatch.setattr(recording, "PATIENCE_S", 0.05)
    free = threading.Event()
    recorder._beside.put(free.wait)
    recorder.turn(10**18, [])
    recorder.end()
    assert "the disk hangs" in told[-1][1]
    free.set()


def test_without_a_link_there_is_no_tlog(recorder, tmp_path):
    recorder.end()
    assert (tmp_path / "run.mcap").exists()
    assert not (tmp_path / "link.tlog").exists()


def test_blocks_that_were_lost_leave_a_file_without_an_index(recorder, told, turns, tmp_path, monkeypatch):
    """Full for a while: later turns are there, the missing ones show by their numbers."""
    monkeypatch.setattr(disk, "RETRY_S", 0.0)
    monkeypatch.setattr(disk, "WAITING_BYTES", 3000)
    monkeypatch.setattr(recording, "FLUSH_S", 0.0)
    put, full = disk.RunFile._put, threading.Event()

    def put_or_refuse(file) -> None:
        if full.is_set():
            raise OSError(28, "No space left on device")
        put(file)

    monkeypatch.setattr(disk.RunFile, "_put", put_or_refuse)
    for number, (now_ns, arrived) in enumerate(turns):
        if number in (10, 40):
            recorder._beside.put(full.set if number == 10 else full.clear)
        recorder.turn(now_ns, arrived)
    recorder.end()
    numbers = [turn.number for turn in Recording(tmp_path / "run.mcap").turns()]
    missing = sorted(set(range(len(turns))) - set(numbers))
    assert missing
    assert missing[0] > 10
    assert missing[-1] < 40
    assert recorder._mcap.file.lost == len(missing)
    assert any(f"{len(missing)} blocks or rows are missing" in text for _, text in told)


def test_events_and_nothing_else_of_the_bus_are_kept(recorder, tmp_path):
    recorder.turn(10**18, [])
    recorder.target("event", Event(t_ns=1_500_000_000, level="warning", text="it is silent"), "")
    recorder.target("health", Event(t_ns=0, level="info", text="not this"), "")
    recorder.end()
    with (tmp_path / "run.mcap").open("rb") as file:
        found = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages("/events")]
    at = {"sec": 1, "nsec": 500_000_000}
    assert [(log["timestamp"], log["level"], log["message"]) for log in found] == [(at, 3, "it is silent")]


def test_the_links_tlog_is_one_that_others_read(recorder, tmp_path):
    """The frames of a flight, through the tap: pymavlink and our own reader find all of them."""
    source, records = tmp_path / "flown.tlog", flights.packed(flights.flight())
    flights.write(source, records)
    frames = [(int.from_bytes(record[:8], "big"), record[8:]) for record in records]
    for stamp_us, frame in frames:
        recorder.link(stamp_us * 1000 + 999, frame)
    recorder.end()
    link = Path(tmp_path / "link.tlog")
    again, at = mavutil.mavlink_connection(str(link)), 0
    while message := again.recv_msg():
        assert message.get_msgbuf() == frames[at][1]
        assert message._timestamp == pytest.approx((frames[at][0] & ~3) / 1e6)
        at += 1
    assert at == len(frames) > 50
    before, after = (tlog_flight.flight(tlog.read(path), None) for path in (source, link))
    for name in before.rows.dtype.names:
        if name != "arrival_ns":
            np.testing.assert_array_equal(before.rows[name], after.rows[name])


def test_a_kill_costs_less_than_a_second(recorder, turns, tmp_path, monkeypatch):
    """Whatever the instant, all turns but those of the last FLUSH_S are in whole chunks on the disk."""
    assert recording.FLUSH_S < 0.5
    begun, clock = time.monotonic() + 10.0, []
    monkeypatch.setattr(recording.time, "monotonic", lambda: begun + clock[-1])
    for now_ns, arrived in turns:
        clock.append((now_ns - turns[0][0]) / 1e9)
        recorder.turn(now_ns, arrived)
        written = threading.Event()
        recorder._beside.put(written.set)
        assert written.wait(10.0)
        kept = [turn.now_ns for turn in Recording(tmp_path / "run.mcap").turns()]
        assert now_ns - kept[-1] <= 1e9 * recording.FLUSH_S + made.TURN_NS
    recorder.end()


def test_what_comes_while_a_turn_takes_long_is_on_the_disk_too(tmp_path, turns):
    """The turn takes some of it and never ends: the rest is replayed as it came."""
    came = [(now_ns, source, message) for now_ns, arrived in turns for source, message in arrived]
    came = [(now_ns + number, *rest) for number, (now_ns, *rest) in enumerate(came)]

    def waiting(after_ns: int) -> list:
        return [one for one in came if one[0] > after_ns]

    station, frame = made.station()
    recorder = RunRecorder(tmp_path, station, frame, lambda *_: None, made.ABOUT, waiting)
    path, half = tmp_path / "run.mcap", len(came) // 2
    assert until(lambda: len(kept(path)) == len(came), 10.0)
    recorder.turn(came[half - 1][0], [(source, message) for _, source, message in came[:half]])
    assert until(lambda: len(kept(path)) == len(came) - half + 1, 10.0)
    first, *others = kept(path)
    assert len(first.arrived) == half
    assert [(turn.now_ns, *turn.arrived[0]) for turn in others] == came[half:]
    assert [turn.number for turn in others] == list(range(1, len(others) + 1))
    recorder.end()
    assert len(kept(path)) == len(others) + 1


def kept(path: Path) -> list[Turn]:
    with suppress(InputError):  # nothing is in it yet
        return list(Recording(path).turns())
    return []


def test_a_turn_that_takes_long_does_not_keep_the_ones_before_from_the_disk(recorder, tmp_path):
    """No turn comes after this one: it is on the disk all the same."""
    empty = (tmp_path / "run.mcap").stat().st_size
    recorder.turn(10**18, [])
    assert until(lambda: (tmp_path / "run.mcap").stat().st_size > empty, 10.0)
    assert [turn.now_ns for turn in Recording(tmp_path / "run.mcap").turns()] == [10**18]
    recorder.end()
