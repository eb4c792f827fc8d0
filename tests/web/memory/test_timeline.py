"""Where the page stands in time: a live flight looked back upon, and a replay that is wound back."""

import math

import pytest

from tests.web.flight import SCENE, START_NS, messages
from tests.web.page import Tape
from web.memory import timeline
from web.memory.flight import SeenFlight
from web.memory.timeline import LookBack, Rewind

S = 1_000_000_000


def flown(seconds: float) -> SeenFlight:
    flight = SeenFlight(SCENE)
    for message, source in messages(seconds):
        flight.take(message, source)
    return flight


def test_back_stands_still_while_the_flight_goes_on_and_play_returns_to_now():
    flight = SeenFlight(SCENE)
    told = list(messages(20.0))
    for message, source in told[: len(told) // 2]:
        flight.take(message, source)
    back = LookBack(flight)
    assert back.playing
    back.seek(START_NS + 3 * S)
    for message, source in told[len(told) // 2 :]:
        flight.take(message, source)
    assert (back.playing, back.now_ns) == (False, START_NS + 3 * S)
    back.play()
    assert back.now_ns == back.end_ns == flight.span_ns[1]


def test_pause_stays_at_this_moment_and_before_the_start_there_is_nothing():
    back = LookBack(flight := flown(2.0))
    back.pause()
    assert (back.playing, back.now_ns) == (False, flight.span_ns[1])
    back.seek(0)
    assert back.now_ns == START_NS


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets."""
    now = [100.0]
    monkeypatch.setattr(timeline.time, "monotonic", lambda: now[0])
    return now


class FlyingTape(Tape):
    """Counts how often it was sought."""

    def __init__(self):
        super().__init__()
        self.sought: list[int] = []

    def seek(self, t_ns: int) -> None:
        self.sought.append(t_ns)
        super().seek(t_ns)


def test_a_replay_never_flies_again_what_the_page_has_seen(clock):
    time = Rewind(tape := FlyingTape(), flown(40.0))
    assert (time.now_ns, time.playing, time.back) == (START_NS + 40 * S, True, False)
    time.seek(START_NS + 10 * S)
    assert (time.now_ns, time.back, tape.sought, tape.playing) == (START_NS + 10 * S, True, [], False)
    time.seek(START_NS - S)
    assert time.now_ns == START_NS


def test_the_past_plays_at_its_speed_and_hands_over_at_the_front(clock):
    time = Rewind(tape := FlyingTape(), flown(40.0))
    time.seek(START_NS + 10 * S)
    clock[0] += 2.0
    assert time.now_ns == START_NS + 12 * S
    time.set_speed(5.0)
    clock[0] += 2.0
    time.step()
    assert (time.now_ns, time.back) == (START_NS + 22 * S, True)
    time.pause()
    clock[0] += 9.0
    time.step()
    assert (time.now_ns, time.playing, tape.playing) == (START_NS + 22 * S, False, False)
    time.play()
    clock[0] += 9.0
    time.step()
    assert (time.now_ns, time.playing, tape.playing, time.back) == (START_NS + 40 * S, True, True, False)


def test_at_full_speed_or_at_the_end_a_moment_that_was_sought_stays(clock):
    for speed, end_ns in ((math.inf, START_NS + 60 * S), (1.0, START_NS + 40 * S)):
        time = Rewind(tape := FlyingTape(), flown(40.0))
        tape.end_ns = end_ns
        time.set_speed(speed)
        time.seek(START_NS + 10 * S)
        clock[0] += 9.0
        time.step()
        assert (time.now_ns, time.playing) == (START_NS + 10 * S, False)


def test_at_full_speed_the_past_is_played_as_fast_as_it_can_be_seen(clock):
    time = Rewind(FlyingTape(), flown(40.0))
    time.set_speed(math.inf)
    time.seek(START_NS + 10 * S)
    time.play()
    clock[0] += 0.1
    assert time.now_ns == START_NS + 15 * S
    clock[0] += 0.6
    time.step()
    assert (time.now_ns, time.back) == (START_NS + 40 * S, False)


def test_what_was_not_flown_yet_is_flown(clock):
    time = Rewind(tape := FlyingTape(), flown(40.0))
    time.seek(START_NS + 10 * S)
    time.pause()
    time.seek(START_NS + 50 * S)
    assert (tape.sought, time.back, time.playing) == ([START_NS + 50 * S], False, False)
    time.seek(START_NS + 99 * S)
    assert tape.now_ns == tape.end_ns
