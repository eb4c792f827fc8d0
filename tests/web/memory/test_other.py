"""The other course: its place at any time, and how far the state is from it, against closed forms."""

import msgspec
import numpy as np
import pytest

from gcs.contract.frames import Frame
from gcs.contract.messages import State
from tests.web.flight import SCENE, messages
from web.memory.other import Geodetic, OtherTrack

S = 1_000_000_000
STATE = next(m for m, source in messages(3.0) if isinstance(m, State) and source == "")
FRAME = Frame(SCENE.origin_lat_deg, SCENE.origin_lon_deg, SCENE.origin_alt_m)


def course(t_ns, places) -> OtherTrack:
    there = FRAME.to_geodetic(np.array(places, float))
    return OtherTrack(Geodetic("truth.csv", np.array(t_ns, np.int64), *there), SCENE)


def state(place, velocity, t_ns=S) -> State:
    return msgspec.structs.replace(STATE, t_ns=t_ns, position_enu_m=place, velocity_enu_mps=velocity)


def test_between_its_places_it_is_on_the_straight_line():
    other = course([S, 2 * S, 3 * S], [(0, 0, 0), (10, 20, 30), (10, 20, 30)])
    np.testing.assert_allclose(other.place_at(S + S // 4), [2.5, 5, 7.5], atol=1e-6)
    np.testing.assert_allclose(other.place_at(3 * S), [10, 20, 30], atol=1e-6)


def test_before_after_and_in_a_pause_it_says_nothing():
    other = course([S, 2 * S, 3 * S, 60 * S], [(0, 0, 0)] * 4)
    for t_ns in (0, 30 * S, 61 * S):
        assert other.place_at(t_ns) is None
        assert other.apart(state((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), t_ns)) is None


def test_a_time_that_comes_twice_counts_once():
    other = course([S, S, 2 * S], [(0, 0, 0), (500, 0, 0), (10, 0, 0)])
    np.testing.assert_allclose(other.place_at(S + S // 2), [5, 0, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("velocity", "along", "across"),
    [((0.0, 30.0, 5.0), 4.0, 3.0), ((30.0, 0.0, -5.0), 3.0, -4.0), ((0.0, -30.0, 0.0), -4.0, -3.0)],
)
def test_apart_is_along_the_course_to_its_right_and_up(velocity, along, across):
    other = course([S // 2, S, 2 * S], [(0, 0, 100)] * 3)
    found = other.apart(state((3.0, 4.0, 112.0), velocity))
    assert found == pytest.approx((along, across, 12.0, 13.0), abs=1e-6)


def test_what_stands_still_has_no_course():
    other = course([S // 2, S, 2 * S], [(0, 0, 100)] * 3)
    found = other.apart(state((3.0, 4.0, 112.0), (0.5, 0.5, 3.0)))
    assert (found.along, found.across) == (None, None)
    assert found.whole == pytest.approx(13.0)


def test_it_is_drawn_ten_times_a_second_and_broken_where_it_pauses():
    t_ns = np.concatenate([np.arange(0, 10 * S, S // 100), np.arange(20 * S, 22 * S, S // 100)])
    points = course(t_ns, np.zeros((len(t_ns), 3))).points()
    broken = np.flatnonzero(np.isnan(points[:, 0]))
    assert broken.tolist() == [100]
    assert len(points) == 121
