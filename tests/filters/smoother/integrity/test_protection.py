"""Protection levels: solution separation by hand."""

import numpy as np
import pytest

from filters.models.rows import TRACK
from filters.smoother.integrity import protection

pytestmark = pytest.mark.decision

K = protection.LEVEL_K


def track(position=(0.0, 0.0, 0.0), sigma=(1.0, 1.0, 1.0)):
    out = np.zeros(1, TRACK)
    out["x"][0, :3] = position
    out["P"][0, range(3), range(3)] = np.square(sigma)
    return out


def other(position, sigma):
    return np.array([position], float), np.diag(np.square(sigma).astype(float))[None]


def levels(*args):
    out = track()
    protection.enter(out, list(args))
    return out["protection_h_m"][0], out["protection_v_m"][0]


def test_level_is_the_worst_distance_plus_k_sigma():
    h, v = levels(other((3.0, 4.0, -2.0), (2.0, 1.0, 0.5)), other((0.0, 0.0, 7.0), (1.5, 1.0, 2.0)))
    assert h == pytest.approx(5.0 + K * 2.0)
    assert v == pytest.approx(7.0 + K * 2.0)


def test_level_is_never_below_that_of_the_state_itself():
    assert levels(other((0, 0, 0), (0.1, 0.1, 0.1))) == pytest.approx((K, K))


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, np.pi / 2])
def test_horizontal_sigma_is_that_of_the_worst_direction(angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    P = np.eye(3)
    P[:2, :2] = turn @ np.diag([25.0, 4.0]) @ turn.T
    assert levels((np.zeros((1, 3)), P[None]))[0] == pytest.approx(5.0 * K)


@pytest.mark.parametrize(("far", "elsewhere"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_state_without_a_sensor_is_elsewhere_beyond_k_of_its_own_sigmas(axis, far, elsewhere):
    sigma = np.array([3.0, 3.0, 0.5])
    gap = np.zeros(3)
    gap[axis] = far * K * sigma[axis]
    apart = [other((0, 0, 0), (9, 9, 9)), other(gap, sigma)]
    assert protection.enter(track(), apart).tolist() == [elsewhere]


def test_there_is_no_bound_where_a_sensor_is_alone():
    assert levels() == (np.inf, np.inf)
    assert levels(other((0, 0, 0), (1, 1, 1)), None) == (np.inf, np.inf)
    assert protection.enter(track(), [other((99, 0, 0), (1, 1, 1)), None]).tolist() == [False]


@pytest.mark.parametrize("spoilt", [-1e-9, np.nan])
def test_a_variance_that_rounding_has_spoilt_bounds_nothing(spoilt):
    position, covariance = other((1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    covariance[0, 2, 2] = spoilt
    h, v = levels((position, covariance))
    assert (h, v) == (pytest.approx(1.0 + K), np.inf)
    covariance[0, 0, 0] = np.nan
    assert levels((position, covariance)) == (np.inf, np.inf)


def test_k_is_that_of_the_risk_shared_by_five_sensors():
    from scipy.stats import norm

    assert pytest.approx(norm.isf(protection.RISK / 5 / 2), abs=0.02) == K


def test_separation_is_the_distance_to_the_state_without_a_sensor():
    state = track((1.0, 2.0, 3.0))
    state["t_ns"] = 7
    position, covariance = other((4.0, -2.0, 1.5), (0.5, 2.0, 0.3))
    [told] = protection.separation(state, 2, position, covariance).tolist()
    assert told == pytest.approx((7, 2, 5.0, 1.5, 2.0, 0.3))


def test_each_epoch_has_its_own():
    out = np.concatenate([track(), track((10.0, 0.0, 0.0))])
    position, covariance = np.zeros((2, 3)), np.stack([np.eye(3), 4 * np.eye(3)])
    protection.enter(out, [(position, covariance)])
    assert out["protection_h_m"].tolist() == pytest.approx([K, 10 + 2 * K])
