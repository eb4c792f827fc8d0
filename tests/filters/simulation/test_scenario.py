"""Flights: within their limits, exact between the samples, and the same for the same seed."""

import numpy as np
import pytest

from filters.simulation import scenario


def rng(seed=1):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def truth():
    return scenario.flight(120, 50, "aggressive", rng())


@pytest.mark.parametrize("manoeuvre", scenario.LEVELS)
def test_flight_is_plausible(manoeuvre):
    for seed in range(5):
        truth = scenario.flight(200, 50, manoeuvre, rng(seed))
        jerk = np.diff(truth.a, axis=0) * 50
        assert truth.p[:, 2].min() > 10
        assert np.abs(truth.p).max() < 2500
        assert np.linalg.norm(truth.v, axis=1).max() < 42
        assert np.linalg.norm(jerk, axis=1).max() < 30
        assert np.linalg.norm(truth.a, axis=1).max() < 2.2 * scenario.GRAVITY_MPS2


def test_aggressive_turns_reach_sixty_degrees(truth):
    (ve, vn, _), (ae, an, _) = truth.v.T, truth.a.T
    lateral = np.abs(ve * an - vn * ae) / np.maximum(np.hypot(ve, vn), 5)
    assert np.degrees(np.arctan(lateral.max() / scenario.GRAVITY_MPS2)) > 50


def test_velocity_and_acceleration_are_derivatives_of_position(truth):
    t_s, h = np.linspace(1, 119, 5000), 1e-3
    before, now, after = (scenario.at(truth, t_s + k * h) for k in (-1, 0, 1))
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), now[1], atol=1e-4)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), now[2], atol=2e-2)


def test_same_seed_same_flight():
    one, two = (scenario.flight(20, 50, "normal", rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one.p, two.p)
    assert not np.array_equal(one.p, scenario.flight(20, 50, "normal", rng(8)).p)


def test_unknown_manoeuvre_lists_the_known():
    with pytest.raises(ValueError, match="hover, gentle"):
        scenario.flight(10, 50, "loop", rng())


def test_between_the_samples_it_is_the_flight_of_more_samples(truth):
    """Jerk is constant between two: the next sample follows from the one before, exactly."""
    t_s = truth.t_s[1:]
    p, v, a = scenario.at(truth, t_s - 1e-9)
    np.testing.assert_allclose(p, truth.p[1:], atol=1e-6)
    np.testing.assert_allclose(v, truth.v[1:], atol=1e-6)
    np.testing.assert_allclose(a, truth.a[1:], atol=1e-5)


def test_a_measured_track_gets_its_derivatives():
    t_s = np.linspace(0.0, 10.0, 1001)
    circle = np.column_stack([50 * np.cos(t_s), 50 * np.sin(t_s), 3.0 * t_s])
    found = scenario.track(t_s, circle)
    np.testing.assert_allclose(np.linalg.norm(found.v[5:-5], axis=1), np.hypot(50, 3), rtol=1e-4)
    np.testing.assert_allclose(found.a[5:-5, :2], -circle[5:-5, :2], atol=0.02)


def test_far_out_every_leg_turns_home():
    """It begins 5 km away and comes back into the range, with all it may bank."""
    far = scenario.flight(400, 50, "normal", rng(2), start=(5000.0, 0.0, 120.0))
    assert np.hypot(*far.p[-1, :2]) < scenario.RADIUS_M + 500.0
    assert np.hypot(*far.p[:, :2].T).max() < 5000.0 + 1000.0


def test_gauss_markov_keeps_its_variance_and_forgets_after_tau():
    tau_s, dt_s = 3.0, 0.1
    found = scenario.gauss_markov(100_000, dt_s, tau_s, 2.0, rng(3))
    lag = round(tau_s / dt_s)
    assert found.std(axis=0) == pytest.approx([2.0] * 3, rel=0.1)
    assert np.corrcoef(found[lag:, 0], found[:-lag, 0])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.1)
