"""How a track is judged against the truth."""

import numpy as np
import pytest

from bench.trials import score
from bench.trials.flights import Flight
from bench.trials.world import TRACK, Truth

T_S = np.arange(0.0, 2.0, 0.01)


def straight(velocity):
    """A flight with constant velocity from the origin."""
    v = np.tile(np.array(velocity, float), (len(T_S), 1))
    truth = Truth(T_S, T_S[:, None] * v, v, np.zeros_like(v))
    return Flight("straight", 0, truth, None, np.zeros(0), np.zeros(0), np.zeros(0))


def one_state(v, sigma_p, sigma_v):
    track = np.zeros(1, TRACK)
    track["x"][0, 3:6] = v
    track["P"][0, range(6), range(6)] = [sigma_p**2] * 3 + [sigma_v**2] * 3
    return track


def test_a_state_is_moved_on_and_its_covariance_with_it():
    """Of a velocity 2 m/s off nobody can tell after 0.1 s whether the place was 0.2 m off: sigma says so."""
    track = one_state((10.0, 0.0, 2.0), sigma_p=0.05, sigma_v=1.0)
    error_m, off, P, _ = score.errors(straight((10.0, 0.0, 0.0)), track, np.array([0, 100_000_000]), True)
    assert error_m == pytest.approx([0.0, 0.2])
    assert off[1] == pytest.approx([0.0, 0.0, 0.2])
    assert P[0] == pytest.approx(np.eye(3) * 0.05**2)
    assert P[1] == pytest.approx(np.eye(3) * (0.05**2 + 0.1**2))


def test_the_covariance_of_an_old_state_says_nothing_of_now():
    *_, P, _ = score.errors(
        straight((0, 0, 0)), one_state((0, 0, 0), 1.0, 1.0), np.array([500_000_000]), True
    )
    assert np.isnan(P).all()


def test_shares_beyond_three_and_five_sigma_are_of_any_axis():
    off = np.array([[0.0, 3.5, 0.0], [0.0, 0.0, 6.0], [1.0, 1.0, 1.0], [2.9, 0.0, 0.0]])
    judged = None, off, np.tile(np.eye(3), (4, 1, 1)), None
    said = score.honesty(judged, np.arange(4) * 1_000_000_000)
    assert (said["beyond3"], said["beyond5"]) == (0.5, 0.25)
    assert said["nees"] == pytest.approx((3.5**2 + 36.0 + 3.0 + 2.9**2) / 4)
