"""Wind and dead reckoning on simulated flights: the air is known, the ground follows from it."""

from typing import NamedTuple

import numpy as np
import pytest

from filters.simulation import scenario
from filters.wind.wind import WindEstimator, WindSettings, _right_wing, true_airspeed

WIND = np.array([6.1, -5.1])  # east, north
S_NS = 1_000_000_000


class FlownAir(NamedTuple):
    """n samples at 10 Hz."""

    t_ns: np.ndarray
    tas_mps: np.ndarray
    attitude: np.ndarray
    velocity: np.ndarray
    position: np.ndarray


def fly(
    seed=0, seconds=240.0, level="normal", gust=0.8, noise=1.0, scale=1.0, heading=0.0, front=None
) -> FlownAir:
    """A flight of the scenario generator through moving air; ``front`` is added to the wind at half time."""
    rng = np.random.default_rng(seed)
    air = scenario.flight(seconds, 20.0, level, rng)
    n = len(air.t_s)
    wind = np.append(WIND, 0.0) + scenario.gauss_markov(n, 0.05, 3.0, gust, rng)
    if front is not None:
        wind[air.t_s > seconds / 2, :2] += front
    speed, level_speed = np.linalg.norm(air.v, axis=1), np.hypot(air.v[:, 0], air.v[:, 1])
    yaw = np.unwrap(np.arctan2(air.v[:, 0], air.v[:, 1]))
    roll = np.arctan(np.gradient(yaw, air.t_s) * level_speed / 9.81)
    attitude = np.column_stack([roll, np.arctan2(air.v[:, 2], level_speed), yaw + heading])
    attitude[:, 2] += noise * scenario.gauss_markov(n, 0.05, 2.0, 0.02, rng)[:, 0]
    velocity = air.v + wind
    tas = speed * scale + noise * rng.normal(0.0, 0.3, n)
    position = np.cumsum(velocity[:, :2] * 0.05, axis=0)
    velocity = velocity + noise * rng.normal(0.0, 0.1, (n, 3))
    columns = np.round(air.t_s * 1e9).astype(np.int64) + S_NS, tas, attitude, velocity, position
    return FlownAir(*(column[::2] for column in columns))


def follow(air: FlownAir, coordinated=True, settings=None) -> tuple[WindEstimator, list]:
    estimator = WindEstimator(settings or WindSettings(), coordinated=coordinated)
    return estimator, [estimator.step(*sample) for sample in zip(*air[:4], strict=True)]


@pytest.mark.parametrize("coordinated", [True, False])
def test_without_noise_the_wind_is_exact(coordinated):
    air = fly(gust=0.0, noise=0.0, scale=1 / 1.03, heading=0.04 if coordinated else 0.0)
    _, found = follow(air, coordinated, WindSettings(wind_walk=0.0, gust_mps=1e-3))
    np.testing.assert_allclose(found[-1].en_mps, WIND, atol=0.1)
    assert found[-1].airspeed_scale == pytest.approx(1.03, abs=0.005)


@pytest.mark.parametrize("level", ["gentle", "normal", "aggressive"])
def test_wind_and_scale_in_gusts(level):
    errors = []
    for seed in range(4):
        _, found = follow(fly(seed, level=level, scale=1 / 1.04, heading=-0.04))
        known = [w for w in found if w.observable]
        assert len(known) > 0.8 * len(found)
        errors.append(np.median([w.en_mps for w in known], axis=0) - WIND)
    assert np.linalg.norm(np.mean(errors, axis=0)) < 0.3
    assert np.abs(errors).max() < 0.6


def test_covariance_is_honest():
    nees = []
    for seed in range(10):
        _, found = follow(fly(seed, seconds=120.0))
        error = found[-1].en_mps - WIND
        nees.append(error @ np.linalg.solve(found[-1].covariance, error))
    assert 0.3 < np.mean(nees) < 4.0  # χ² with 2 degrees of freedom; the wind does not walk here


def test_straight_flight_without_sideslip_rule_shows_no_wind():
    n = 600
    velocity = np.tile([20.0 + WIND[0], WIND[1], 0.0], (n, 1))
    estimator = WindEstimator(coordinated=False)
    for k in range(n):
        wind = estimator.step(S_NS + k * S_NS // 10, 20.0, np.array([0.0, 0.0, np.pi / 2]), velocity[k])
    assert not wind.observable
    for k in range(n):  # now a slow circle
        yaw = np.pi / 2 + 2 * np.pi * k / n
        ground = 20.0 * np.array([np.sin(yaw), np.cos(yaw), 0.0]) + [*WIND, 0.0]
        wind = estimator.step(S_NS + (n + k) * S_NS // 10, 20.0, np.array([0.0, 0.0, yaw]), ground)
    assert wind.observable
    np.testing.assert_allclose(wind.en_mps, WIND, atol=0.3)


def test_a_front_is_followed_within_half_a_minute():
    front = np.array([-6.0, 8.0])
    air = fly(3, seconds=400.0, front=front)
    _, found = follow(air)
    after = np.searchsorted(air.t_ns, S_NS + 235 * S_NS)
    error = np.array([w.en_mps for w in found[after:]]) - WIND - front
    assert np.abs(np.median(error, axis=0)).max() < 0.7


def test_wrong_airspeeds_now_and_then_do_no_harm():
    air = fly(4)
    tas = air.tas_mps.copy()
    hit = np.random.default_rng(0).random(len(tas)) < 0.05
    tas[hit] += 15.0
    tas[700:720] = np.nan
    tas[900:930] = 0.0
    velocity, attitude = air.velocity.copy(), air.attitude.copy()
    velocity[0], attitude[1:30] = np.nan, np.nan
    _, found = follow(air._replace(tas_mps=tas, velocity=velocity, attitude=attitude))
    _, clean = follow(air)
    assert np.linalg.norm(found[-1].en_mps - clean[-1].en_mps) < 0.5


def test_a_minute_by_air_data_and_wind():
    errors, still, nees = [], [], []
    for seed in range(8):
        air = fly(seed, seconds=200.0, scale=1 / 1.03)
        estimator, begin = WindEstimator(), 1390
        for sample in zip(*(column[: begin + 1] for column in air[:4]), strict=True):
            estimator.step(*sample)
        reckoning = estimator.carry(air.t_ns[begin], air.position[begin], np.eye(2))
        drift = np.zeros(2)
        for k in range(begin + 1, begin + 601):
            position, covariance = reckoning.step(air.t_ns[k], air.tas_mps[k], air.attitude[k])
            drift += air.velocity[k, :2] * 0.1 - air.tas_mps[k] * 0.1 * np.cos(air.attitude[k, 1]) * np.array(
                [np.sin(air.attitude[k, 2]), np.cos(air.attitude[k, 2])]
            )
        error = position - air.position[begin + 600]
        errors.append(error)
        still.append(drift)
        nees.append(error @ np.linalg.solve(covariance, error))
    with_wind, without = (np.sqrt(np.mean(np.square(e).sum(axis=1))) for e in (errors, still))
    assert with_wind < without / 5
    assert 0.2 < np.mean(nees) < 4.0


def test_right_wing_by_finite_differences():
    attitude, h = np.array([0.4, -0.2, 2.1]), 1e-6
    wing, by_yaw = _right_wing(attitude)
    ahead, behind = (_right_wing(attitude + np.array([0.0, 0.0, d]))[0] for d in (h, -h))
    np.testing.assert_allclose(by_yaw, (ahead - behind) / (2 * h), atol=1e-9)
    assert np.linalg.norm(wing) == pytest.approx(1.0)
    np.testing.assert_allclose(_right_wing(np.array([0.0, 0.0, np.pi / 2]))[0], [0.0, -1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("height_m", "density"), [(0.0, 1.2250), (1000.0, 1.1117), (5000.0, 0.7364)])
def test_true_airspeed_by_the_standard_atmospheres_table(height_m, density):
    assert true_airspeed(20.0, height_m) == pytest.approx(20.0 * np.sqrt(1.225 / density), rel=2e-4)


def test_warmer_air_is_thinner():
    assert true_airspeed(20.0, 0.0, 303.15) == pytest.approx(20.0 * np.sqrt(303.15 / 288.15))


def test_direction_is_where_it_comes_from():
    estimator = WindEstimator()
    estimator._x[2:4] = 5.0, 0.0  # the air goes east
    assert estimator.wind.from_deg == pytest.approx(270.0)
    assert estimator.wind.speed_mps == pytest.approx(5.0)
