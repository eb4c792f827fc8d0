"""The GA-BP-UKF paper's simulations, short, and the baselines against closed forms."""

import numpy as np
import pytest

from bench.papers.m1 import baselines, simulated_flight, smoothness


def test_jacobian_by_finite_differences():
    p, step = np.array([300.0, -346.0, 200.0]), 1e-4
    for axis in range(3):
        d = step * np.eye(3)[axis]
        slope = (baselines.observe(p + d) - baselines.observe(p - d)) / (2 * step)
        np.testing.assert_allclose(baselines.jacobian(p)[:, axis], slope, rtol=1e-6, atol=1e-10)


@pytest.mark.slow
def test_three_filters_agree_where_the_start_is_known():
    run = simulated_flight.fly(np.random.default_rng(1), start_m=3.0)
    args = (run.z, simulated_flight.SIGMA, run.x, run.P, simulated_flight.STEP_S, simulated_flight.JERK_PSD)
    ours, ekf, classic = (
        m(*args).x1 for m in (simulated_flight.m1_ukf, baselines.ekf, baselines.classic_ukf)
    )
    np.testing.assert_allclose(ours[5:, :3], ekf[5:, :3], atol=0.5)
    np.testing.assert_allclose(ours[5:, :3], classic[5:, :3], atol=0.5)


@pytest.fixture(scope="module")
def flown():
    clean = [simulated_flight.fly(np.random.default_rng(k)) for k in range(25)]
    dirty = [
        simulated_flight.fly(np.random.default_rng(k), first_outlier=simulated_flight.FIRST_OUTLIER)
        for k in range(25)
    ]
    return clean, dirty


def errors(track, runs) -> np.ndarray:
    return simulated_flight.errors(simulated_flight.Method(track, None, simulated_flight.JERK_PSD), runs)


@pytest.mark.slow
def test_simulation_1_half_the_error_of_the_ekf(flown):
    ours, ekf = (np.abs(errors(track, flown[0])).mean() for track in (simulated_flight.m1_ukf, baselines.ekf))
    assert ours < 0.5 * ekf


@pytest.mark.slow
def test_simulation_2_outliers_cost_ours_little_and_the_others_much(flown):
    def rise(track):
        clean, dirty = (errors(track, runs) for runs in flown)
        return np.sqrt((dirty**2).mean() / (clean**2).mean())

    assert rise(simulated_flight.m1_ukf) < 1.1
    assert rise(baselines.classic_ukf) > 1.5


def test_outliers_are_in_the_range_only_and_not_at_the_start(flown):
    clean, dirty = (np.array([run.z for run in runs]) for runs in flown)
    moved = dirty != clean
    assert not moved[:, :, 1:].any()
    assert not moved[:, : simulated_flight.FIRST_OUTLIER].any()
    assert 0.02 < moved[:, simulated_flight.FIRST_OUTLIER :, 0].mean() < 0.09


def test_channel_filters_follow_a_line_exactly():
    line = 100.0 + 3.0 * 0.05 * np.arange(400)
    np.testing.assert_allclose(baselines.sage_husa(line, 1.0, 0.05, 25.0)[200:], line[200:], atol=0.02)
    np.testing.assert_allclose(baselines.alpha_beta(line, 0.05, 0.3)[200:], line[200:], atol=1e-6)


def test_wavelet_takes_noise_off():
    pytest.importorskip("pywt")
    t = 0.05 * np.arange(600)
    true = 500.0 + 40.0 * np.sin(0.2 * t)
    z = true + np.random.default_rng(0).normal(size=600)
    left = baselines.adaptive_wavelet(z, 1.0, 0.05, 25.0) - true
    assert np.sqrt((left[40:-20] ** 2).mean()) < 0.6


@pytest.mark.slow
def test_smoothness_of_a_hovering_target():
    pytest.importorskip("pywt")
    found = smoothness.smoothness("hover", 2)
    ours, theirs, truth = (
        found[name]["median"] for name in ("ga-bp-ukf", "adaptive kalman + wavelet", "truth")
    )
    assert ours[0] < 0.5 * theirs[0]
    assert ours[3] < theirs[3]
    assert truth[3] == 0.0
