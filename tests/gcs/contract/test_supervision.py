"""Supervision: a part that fails starts again, one that hangs is noticed, and the rest goes on."""

import contextlib
import logging
import threading
import time

import pytest

from gcs.contract import supervision
from gcs.contract.messages import InputError, PartHealth
from gcs.contract.supervision import Backoff, Part, Supervisor, guarded
from tests.gcs.contract.ends import until


@pytest.fixture
def stop():
    return threading.Event()


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(supervision, "WAITS_S", (0.01, 0.02))
    monkeypatch.setattr(supervision, "CHECK_S", 0.01)
    monkeypatch.setattr(supervision, "HUNG_S", 0.2)


class Clumsy:
    """A part that fails the first so many times."""

    def __init__(self, failures: int, error: Exception):
        self.begun, self._failures, self._error = 0, failures, error

    def __call__(self, stop):
        self.begun += 1
        if self.begun <= self._failures:
            raise self._error
        while not stop.wait(0.01):
            pass


@pytest.mark.usefixtures("quick")
def test_a_part_that_fails_starts_again_and_is_told(stop, caplog):
    clumsy, steady = Clumsy(3, ZeroDivisionError("by nought")), Clumsy(0, ValueError())
    with caplog.at_level(logging.INFO, "gcs"), Supervisor(stop) as supervisor:
        supervisor.start("clumsy", clumsy)
        supervisor.start("steady", steady)
        assert until(lambda: clumsy.begun == 4)
        assert until(lambda: supervisor.health()["clumsy"] == PartHealth(running=True, failures=3))
        assert supervisor.health()["steady"] == PartHealth()
    assert steady.begun == 1
    failed = [r for r in caplog.records if r.levelname == "ERROR"]
    assert [r.getMessage().split(";")[0] for r in failed] == [
        "clumsy failed: ZeroDivisionError: by nought"
    ] * 3
    assert all(r.exc_info for r in failed)  # with its traceback


@pytest.mark.usefixtures("quick")
def test_input_that_cannot_be_used_ends_all_at_the_start_only(stop, monkeypatch):
    with contextlib.ExitStack() as stack:
        supervisor = stack.enter_context(Supervisor(stop))
        supervisor.start("link", Clumsy(1, InputError("no such port"))).join(5.0)
        assert stop.is_set()
        with pytest.raises(InputError, match="no such port"):
            stack.close()
    monkeypatch.setattr(supervision, "BEGIN_S", 0.0)  # as if it had worked for a while
    again = threading.Event()
    with Supervisor(again) as supervisor:
        link = Clumsy(1, InputError("closed by the tracker"))
        supervisor.start("link", link)
        assert until(lambda: link.begun == 2)
        assert not again.is_set()


def test_a_part_that_ends_by_itself_has_not_failed(stop):
    with Supervisor(stop) as supervisor:
        part = supervisor.start("file", lambda stop: None)
        part.join(5.0)
        assert supervisor.health()["file"] == PartHealth(running=False)
        assert not stop.is_set()


@pytest.mark.usefixtures("quick")
def test_the_watchdog_sees_who_hangs_where_and_who_goes_on(stop, caplog):
    go_on = threading.Event()

    def hang(stop):
        while not stop.is_set():
            go_on.wait(10.0)

    def pause(stop):
        stop.wait(10.0)  # longer than HUNG_S, but it has said so

    with caplog.at_level(logging.INFO, "gcs"), Supervisor(stop) as supervisor:
        supervisor.start("hanging", hang)
        supervisor.start("pausing", pause)
        assert until(lambda: supervisor.health()["hanging"].hung)
        assert not supervisor.health()["pausing"].hung
        go_on.set()
        assert until(lambda: not supervisor.health()["hanging"].hung)
    hung, back = caplog.records
    assert hung.getMessage().startswith("hanging has hung for 0.2 s")
    assert "go_on.wait(10.0)" in hung.stack
    assert back.getMessage() == "hanging goes on"


@pytest.mark.usefixtures("quick")
def test_a_loop_of_the_callers_own_is_watched_until_it_is_over(stop):
    with Supervisor(stop) as supervisor:
        with supervisor.watched("session", threading.Event()) as pulse:
            assert not pulse.is_set()
            assert until(lambda: supervisor.health()["session"].hung)
            pulse.is_set()
            assert until(lambda: not supervisor.health()["session"].hung)
        assert "session" not in supervisor.health()


@pytest.mark.usefixtures("quick")
def test_what_does_not_end_is_left_behind(stop, caplog, monkeypatch):
    monkeypatch.setattr(supervision, "END_S", 0.1)
    free, began = threading.Event(), time.monotonic()
    with Supervisor(stop) as supervisor:
        supervisor.start("deaf", lambda stop: free.wait(10.0))
    assert time.monotonic() - began < 5.0
    assert "deaf does not end; left behind" in caplog.text
    free.set()


def test_waits_grow_to_a_bound_and_a_long_success_resets_them(monkeypatch):
    backoff = Backoff()
    waits = []
    for _ in range(8):
        backoff.begin()
        waits.append(backoff.fail())
    assert waits == [0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 30.0, 30.0]
    assert not backoff.due
    now = time.monotonic()
    backoff.begin()
    monkeypatch.setattr(supervision.time, "monotonic", lambda: now + supervision.STEADY_S + 1.0)
    assert backoff.fail() == 0.5
    assert backoff.failures == 9


def test_a_callback_that_raises_is_logged_and_not_raised(caplog):
    guarded("liveliness", lambda sample: sample.nothing)("text")
    assert "liveliness failed: AttributeError" in caplog.text
    assert caplog.records[0].exc_info


def test_a_part_alone_stops_with_its_event(stop):
    part = Part("view", lambda stop: stop.wait(10.0), stop)
    part.start()
    stop.set()
    part.join(5.0)
    assert not part.is_alive()


class MovedTime:
    """The time module with clocks that can be set."""

    CLOCK_BOOTTIME = 7

    def __init__(self):
        self.ran_s, self.asleep_s, self.wall_s = 100.0, 0.0, 1.7e9

    def monotonic(self):
        return self.ran_s

    def clock_gettime(self, _clock):
        return self.ran_s + self.asleep_s

    def time(self):
        return self.wall_s + self.ran_s + self.asleep_s

    def go(self, ran_s=supervision.CHECK_S, asleep_s=0.0, set_s=0.0):
        self.ran_s, self.asleep_s, self.wall_s = (
            self.ran_s + ran_s,
            self.asleep_s + asleep_s,
            self.wall_s + set_s,
        )


@pytest.mark.parametrize(
    ("moved", "told", "away_s"),
    [
        ({}, [], 0.0),
        (
            {"set_s": -3600.0},
            ["the wall clock was set by -3600.0 s; the flight's time goes on as before"],
            0.0,
        ),
        ({"set_s": 0.3}, [], 0.0),
        ({"asleep_s": 1800.0}, ["the machine slept for 1800.0 s"], 0.0),
        ({"ran_s": 30.5}, ["the station stood still for 30.0 s"], 30.0),
    ],
)
def test_a_clock_that_was_set_a_sleep_and_a_standstill_are_told(moved, told, away_s, monkeypatch, caplog):
    clock = MovedTime()
    monkeypatch.setattr(supervision, "time", clock)
    clocks = supervision.Clocks()
    clock.go()
    assert clocks.look() == 0.0
    clock.go(**moved)
    assert clocks.look() == away_s
    assert caplog.messages == told


def test_who_could_not_ask_is_excused():
    pulse = supervision.Pulse("session", threading.Event())
    pulse.is_set()
    pulse.excuse(30.0)
    assert -30.0 <= pulse.silent_s < -20.0
