"""Looking back upon a live flight."""

from tests.web.flight import SCENE, START_NS, messages
from web.memory.flight import SeenFlight
from web.panel.player import LookBack

S = 1_000_000_000


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
    flight = SeenFlight(SCENE)
    for message, source in messages(2.0):
        flight.take(message, source)
    back = LookBack(flight)
    back.pause()
    assert (back.playing, back.now_ns) == (False, flight.span_ns[1])
    back.seek(0)
    assert back.now_ns == START_NS
