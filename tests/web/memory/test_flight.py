"""What the page keeps of a flight: where it was, what it knew then, what was marked."""

import msgspec
import numpy as np

from gcs.contract.messages import Event, Health, State, SystematicError
from tests.web.flight import SCENE, START_NS, messages, position
from tests.web.memory.made import verdict
from web.memory.flight import BREAK_NS, MOST_EVENTS, SeenFlight

S = 1_000_000_000


def flown(seconds: float = 40.0) -> SeenFlight:
    flight = SeenFlight(SCENE)
    for message, source in messages(seconds):
        flight.take(message, source)
    flight.settle()
    return flight


def test_the_place_at_an_instant_is_on_the_track():
    flight = flown()
    np.testing.assert_allclose(
        flight.place_at(START_NS + 12_345_000_000), position(np.array(12.345)), atol=2.0
    )
    assert flight.place_at(START_NS - 10 * S) is None


def test_patches_gaps_and_new_starts_are_marked_once():
    flight = SeenFlight(SCENE)
    for _ in range(2):  # a seek back brings the same again
        flight.clear()
        for message, source in messages(40.0):
            if isinstance(message, State):
                late_s = (message.t_ns - START_NS) / S
                message = msgspec.structs.replace(message, reset_counter=int(late_s >= 10.0))
                if 15.0 < late_s < 25.0:
                    continue
            flight.take(message, source)
        flight.settle()
    assert flight.marks == {START_NS + 10 * S: "reset", START_NS + 25 * S: "gap", START_NS + 30 * S: "patch"}


def test_what_was_known_then_comes_back_as_a_state():
    flight = flown()
    asked = [m for m, source in messages(40.0) if isinstance(m, State) and not source][123]
    found = flight.state_at(asked.t_ns + 50_000_000)
    for name in (
        "t_ns",
        "position_enu_m",
        "velocity_enu_mps",
        "lat_deg",
        "alt_m",
        "quality",
        "protection_h_m",
    ):
        assert getattr(found, name) == getattr(asked, name)
    assert found.covariance[:6] == asked.covariance[:6]
    assert flight.state_at(START_NS - 1) is None


def test_states_are_kept_ten_times_a_second_and_a_reset_cuts():
    flight = SeenFlight(SCENE)
    state = next(m for m, _ in messages(1.0) if isinstance(m, State))
    for ms, resets in ((0, 0), (20, 0), (100, 0), (110, 1), (300, 1), (8000, 1)):
        flight.take(msgspec.structs.replace(state, t_ns=START_NS + ms * 1_000_000, reset_counter=resets), "")
    times = (flight.newest.view["t_ns"] - START_NS) // 1_000_000
    assert times.tolist() == [0, 100, 110, 300, 8000]
    assert BREAK_NS < 7_700_000_000
    assert flight.newest.view["cut"].tolist() == [False, False, True, False, True]


def test_outliers_become_claims_and_a_patch_a_moment():
    flight = flown()
    kinds = {claim.kind for claim in flight.outliers}
    assert kinds == {"isolated", "patch"}
    patches = [text for (_, text) in flight.moments if "patch" in text]
    assert patches == ["theo-south: a patch of outliers begins"]


def test_a_seek_back_forgets_the_flight_but_not_its_moments():
    flight = flown()
    flight.clear()
    assert flight.state is None
    assert len(flight.newest.view) == len(flight.outliers) == 0
    assert any("azimuths in a row" in text for _, text in flight.moments)
    for i in range(2 * MOST_EVENTS):
        flight.take(Event(t_ns=i + 1, level="info", text="x"), "")
    assert len(flight.moments) == MOST_EVENTS


def test_nis_is_the_mean_square_of_what_was_accepted():
    flight = SeenFlight(SCENE)
    state = next(m for m, _ in messages(1.0) if isinstance(m, State))
    for off, word in ((2.0, "used"), (0.0, "deweighted"), (50.0, "isolated")):
        flight.take(verdict(state.t_ns, word=word, value=off, predicted=0.0), "")
    flight.take(state, "")
    assert flight.newest.view["nis"].tolist() == [2.0]


def test_systematic_errors_are_kept_over_time():
    flight = SeenFlight(SCENE)
    health = next(m for m, _ in messages(1.0) if isinstance(m, Health))
    for k in range(3):
        error = SystematicError(value=float(k), sigma=0.5, unit="m", known=True)
        radar = msgspec.structs.replace(health.sensors["radar-west"], errors={"range": error})
        flight.take(Health(t_ns=START_NS + k * S, sensors={"radar-west": radar}), "")
    assert flight.errors["radar-west", "range"].view["value"].tolist() == [0.0, 1.0, 2.0]


def test_fresh_things_are_handed_out_once():
    flight = flown(10.0)
    fresh = flight.take_fresh()
    assert len(fresh.newest) == len(flight.newest.view)
    assert fresh.settled
    assert flight.take_fresh() == ([], [], [])
