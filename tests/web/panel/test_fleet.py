"""The table of vehicles: who comes first, and why."""

import time

import msgspec
import pytest

from gcs.contract.messages import State
from tests.web.flight import SCENE, messages
from web.memory.flight import SeenFlight
from web.panel.fleet import ALARMED, FAILED, FINE, WAITING, condition, ordered, rows, worst
from web.panel.limits import OperatorLimits

STATE = next(m for m, source in messages(3.0) if isinstance(m, State) and source == "")
LIMITS = OperatorLimits(silent_s=0.0)


def flown(age_s: float = 0.0, **changes) -> SeenFlight:
    flight = SeenFlight(SCENE)
    flight.take(msgspec.structs.replace(STATE, **changes), "")
    flight.arrived_s = time.monotonic() - age_s
    return flight


@pytest.mark.parametrize(
    ("changes", "age_s", "rank", "word"),
    [
        ({}, 0.0, FINE, "LIVE"),
        ({"ambiguous": True}, 0.0, ALARMED, "LIVE"),
        ({"quality": -1}, 0.0, FAILED, "STATE FAILED"),
        ({}, 7.0, FAILED, "DATA 7."),
    ],
)
def test_the_state_of_health_is_the_badge_s(changes, age_s, rank, word):
    found = condition("uav1", flown(age_s, **changes), LIMITS)
    assert found.rank == rank
    assert found.word.startswith(word)


def test_who_has_said_nothing_waits():
    for flight, word in ((SeenFlight(SCENE), "WAITING FOR DATA"), (None, "NO STATION")):
        found = condition("uav1", flight, LIMITS)
        assert (found.rank, found.word, found.quality) == (WAITING, word, None)


def test_the_worst_is_first_and_equals_keep_their_order():
    flights = {"d": flown(), "b": flown(), "c": flown(ambiguous=True), "a": None, "e": flown(quality=-1)}
    found = ordered([condition(*item, LIMITS) for item in flights.items()])
    assert [one.name for one in found] == ["e", "a", "c", "b", "d"]


def test_a_new_page_shows_the_worst_that_has_been_heard():
    flights = {"b": flown(), "c": flown(), "a": flown(ambiguous=True)}
    assert worst(flights, LIMITS) == "a"
    assert worst({"b": flown(), "a": flown()}, LIMITS) == "a"
    assert worst({"b": flown()}, LIMITS) == "b"


def test_a_row_tells_word_quality_and_the_first_alarm_and_marks_the_chosen():
    limits = OperatorLimits(protection_h_m=1.0, silent_s=0.0)
    said = rows([condition("<1>", flown(ambiguous=True), limits), condition("b", None, limits)], "b")
    for text in ("&lt;1&gt;", "LIVE", "96", "two positions fit", "and 1 more", "NO STATION", "▸ b"):
        assert text in said
    assert "<1>" not in said
