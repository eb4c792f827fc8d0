"""Published states: moved to the common clock, with a quality, and only when known well enough."""

import numpy as np
import pytest

from filters.models import state
from filters.models.rows import TRACK
from filters.smoother import tracks
from tests.filters.smoother.kit import small

pytestmark = pytest.mark.decision


def track(position=(0.0, 1000.0, 0.0), sigma_m=1.0, sigma_mps=1.0, ambiguous=False):
    out = np.zeros(1, TRACK)
    out["x"][0] = [*position, 10.0, -5.0, 2.0, 1.0, 0.5, -0.5]
    out["P"][0, range(9), range(9)] = np.repeat([sigma_m, sigma_mps, 1.0], 3) ** 2
    out["ambiguous"] = ambiguous
    return out


FAR_M = tracks.KNOWN_M / tracks.KNOWN_SHARE


def known(model, one):
    return bool(tracks.known(model, one["x"], one["P"])[0])


def test_a_state_is_moved_back_along_its_own_motion():
    """What was called t happened at t − shift: with constant acceleration exactly."""
    p, v, a = np.split(track()["x"][0], 3)
    shift = 0.2
    x = tracks.polished(track(), np.array([shift]), 0.0)["x"][0]
    assert np.allclose(x[:3], p - shift * v + 0.5 * shift**2 * a)
    assert np.allclose(x[3:6], v - shift * a)
    assert np.allclose(x[6:], a)


def test_a_time_that_no_clock_shows_is_in_the_covariance():
    """Of a target at v the position is off by v · shift, together with the velocity's a · shift."""
    before, after = track(sigma_m=1.0), tracks.polished(track(sigma_m=1.0), np.zeros(1), 0.05**2)
    d = before["x"][0, 3:9]
    assert np.allclose(after["P"][0, :6, :6] - before["P"][0, :6, :6], 0.05**2 * np.outer(d, d))
    assert np.array_equal(after["P"][0, 6:], before["P"][0, 6:])


@pytest.mark.parametrize(("sigma_m", "quality"), [(0.0, 100), (tracks.HALF_QUALITY_M / np.sqrt(3), 50)])
def test_quality_is_half_at_the_named_sigma(sigma_m, quality):
    assert tracks.polished(track(sigma_m=sigma_m), np.zeros(1), 0.0)["quality"][0] == quality


def quality(**about):
    """That of one state."""
    return tracks.polished(track(**about), np.zeros(1), 0.0)["quality"][0]


def test_quality_falls_with_sigma_and_where_it_is_ambiguous():
    found = [quality(sigma_m=s) for s in (0.1, 1, 10, 100, 1e5)]
    assert (np.diff(found) < 0).all()
    assert quality(sigma_m=0.1, ambiguous=True) == tracks.DOUBTFUL


@pytest.mark.parametrize(
    ("sigma", "distance", "told"),
    [(0.9, 0.5, True), (1.1, 0.5, False), (1.1, 2.0, True), (1.9, 2.0, True), (2.1, 2.0, False)],
)
def test_a_state_is_published_when_known_to_metres_or_a_share_of_the_distance(sigma, distance, told):
    """``sigma`` in units of the limit near by, ``distance`` of that from which the share counts."""
    model = state.build([small.theodolite()])
    one = track((0.0, distance * FAR_M, 0.0), sigma * tracks.KNOWN_M)
    assert known(model, one) == told


def test_the_nearest_instrument_counts():
    model = state.build([small.theodolite(), small.theodolite("b", (0.0, 3.9 * FAR_M, 0.0))])
    assert not known(model, track((0.0, 4.0 * FAR_M, 0.0), 1.5 * tracks.KNOWN_M))


def test_what_rounding_has_made_negative_is_not_known():
    model, one = state.build([small.ins()]), track()
    assert known(model, one)
    one["P"][0, 3, 3] = -1.0
    assert not known(model, one)
    one["P"][0, 3, 3] = -1e-12
    assert known(model, one)


def test_without_a_speed_it_is_not_known():
    model = state.build([small.ins()])
    assert known(model, track(sigma_mps=0.9 * tracks.KNOWN_M))
    assert not known(model, track(sigma_mps=1.1 * tracks.KNOWN_M))
