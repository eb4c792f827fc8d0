"""Which instrument lies now, since when, by how much."""

from tests.web.flight import SCENE
from tests.web.memory.made import verdict
from web.memory.flight import SeenFlight
from web.memory.lies import lies

S, STEP = 1_000_000_000, 100_000_000


def flight_of(words: list[str], channel: str = "azimuth", off: float = 0.5) -> SeenFlight:
    flight = SeenFlight(SCENE)
    for k, word in enumerate(words):
        value = 359.9 + off if word in ("patch", "isolated") else 359.9
        flight.take(
            verdict(10 * S + k * STEP, "theo", channel, word, value=value, predicted=359.9, sigma=0.05), ""
        )
        flight.settle()
    return flight


def now(words: list[str]) -> int:
    return 10 * S + (len(words) - 1) * STEP


def test_a_run_up_to_now_is_a_lie_since_its_first_by_its_median():
    words = ["used"] * 5 + ["patch"] * 8
    (lie,) = lies(flight_of(words), now(words))
    assert (lie.sensor, lie.channel, lie.since_ns) == ("theo", "azimuth", 10 * S + 5 * STEP)
    assert abs(lie.off - 0.5) < 1e-9
    assert abs(lie.sigmas - 10.0) < 1e-6
    assert lie.text == "theo azimuth off by +0.5 ° (10 σ)"


def test_a_long_lie_is_followed_back_beyond_what_may_be_revised():
    words = ["used"] * 5 + ["patch"] * 80
    assert lies(flight_of(words), now(words))[0].since_ns == 10 * S + 5 * STEP


def test_a_run_refused_before_any_prediction_is_off_by_nothing_that_is_known():
    flight = SeenFlight(SCENE)
    for k in range(5):
        refused = verdict(10 * S + k * STEP, "ins", "ae", "invalid", value=1.0, predicted=None, sigma=0.0)
        flight.take(refused, "")
        flight.settle()
    assert [lie.text for lie in lies(flight, 10 * S + 4 * STEP)] == ["ins ae refused"]


def test_a_single_outlier_and_a_run_that_has_ended_are_none():
    for words in (["used"] * 5 + ["isolated"], ["patch"] * 9 + ["used"]):
        assert lies(flight_of(words), now(words)) == []
    words = ["patch"] * 9
    assert lies(flight_of(words), now(words) + 3 * S) == []


def test_looked_back_upon_a_lie_is_told_as_it_was_then():
    words = ["used"] * 5 + ["patch"] * 20 + ["used"] * 80
    flight = flight_of(words)
    assert lies(flight, now(words)) == []
    (lie,) = lies(flight, 10 * S + 24 * STEP)
    assert (lie.since_ns, round(lie.off, 3)) == (10 * S + 5 * STEP, 0.5)
