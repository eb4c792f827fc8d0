"""Screening of one channel against closed forms, textbook twins and known outliers."""

import numpy as np
import pytest
from filterpy.gh import GHFilter
from scipy import integrate, optimize, stats

from filters.screening import screening
from filters.screening.screening import GOOD, MISSING, OUTLIER, STARTING, Channel, Thresholds, screen

pytestmark = pytest.mark.decision

RATE_HZ = 20.0


def ramp(n: int, seed: int = 0, sigma: float = 1.0):
    """(n,) seconds and a noisy line of slope 200 a second."""
    t_s = np.arange(n) / RATE_HZ
    return t_s, 20_000.0 + 200.0 * t_s + np.random.default_rng(seed).normal(0.0, sigma, n)


def test_prediction_is_the_papers_weighted_sum():
    x = np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0])
    found = screen(np.arange(6.0), x, Thresholds(sigma=100.0))
    weights = [(3 * i - 7) / 10 for i in range(1, 6)]
    assert found.predicted[5] == pytest.approx(weights @ x[:5], abs=1e-12)


def test_long_line_is_the_one_through_all_that_is_held():
    t_s, x = ramp(41, seed=10)
    found = screen(t_s, x, Thresholds(sigma=1.0), "long-line-adaptive")
    fit = np.polyfit(t_s[10:40] - t_s[40], x[10:40], 1)
    assert found.predicted[40] == pytest.approx(fit[1], abs=1e-6)


def test_a_run_of_outliers_hardly_widens_the_long_line():
    t_s, x = ramp(300, seed=11)
    x[200:220] += np.random.default_rng(12).choice([-1.0, 1.0], 20) * 12.0
    paper, ours = (
        screen(t_s, x, Thresholds(sigma=1.0), m).sigma[[200, 220]]
        for m in ("linear-adaptive", "long-line-adaptive")
    )
    assert ours[1] < 1.15 * ours[0]
    assert paper[1] > 1.3 * paper[0]


def test_beta_is_the_expectation_of_the_clipped_square():
    clipped = integrate.quad(lambda u: min(u * u, screening.CLIP**2) * stats.norm.pdf(u), -12, 12)[0]
    assert pytest.approx(clipped, abs=1e-4) == screening.BETA


def test_noise_is_the_root_of_hubers_equation():
    t_s, x = ramp(200)
    x[150] += 100.0
    found = screen(t_s[:150], x[:150], Thresholds(sigma=1.3))
    residual = (x[120:150] - found.predicted[120:150]) / np.sqrt(2.1)  # growth of one step ahead

    def equation(sigma):
        inner = np.abs(residual) <= screening.CLIP * sigma
        d = 29 * screening.BETA - np.count_nonzero(~inner) * screening.CLIP**2
        return np.sum(residual[inner] ** 2) / d - sigma**2

    root = optimize.brentq(equation, 0.5, 2.0)
    channel = Channel(Thresholds(sigma=1.3))
    for t, value in zip(t_s[:150], x[:150], strict=True):
        channel.step(t, value)
    sigma = channel.step(t_s[150], x[150])[3]
    assert sigma == pytest.approx(root, rel=1e-3)


@pytest.mark.parametrize("method", screening.METHODS)
def test_streaming_and_batch_agree_to_the_bit(method):
    t_s, x = ramp(800, seed=1)
    rng = np.random.default_rng(2)
    x[rng.random(800) < 0.05] += 50.0
    x[300:320] += rng.normal(0.0, 60.0, 20)
    x[rng.random(800) < 0.02] = np.nan
    x[500:590] = np.nan
    settings = Thresholds(sigma=2.0, period=360.0)
    whole, channel = screen(t_s, x % 360.0, settings, method), Channel(settings, method)
    one_by_one = np.array([channel.step(t, value) for t, value in zip(t_s, x % 360.0, strict=True)])
    np.testing.assert_array_equal(np.column_stack(whole[:4]), one_by_one)
    assert channel.restarts == whole.restarts >= 1


def test_tracker_is_the_g_h_filter():
    t_s, x = ramp(300, seed=3, sigma=0.5)
    found = screen(t_s, x, Thresholds(sigma=1.0, threshold=1e9), "alpha-beta-fixed")
    slope = np.polyfit(t_s[:5], x[:5], 1)[0]
    alpha = Thresholds(sigma=1.0).alpha
    twin = GHFilter(x=x[4], dx=slope, dt=1 / RATE_HZ, g=alpha, h=alpha**2 / (2 - alpha))
    for k in range(5, 300):
        twin.update(x[k])
        assert found.predicted[k] == pytest.approx(twin.x_prediction, abs=1e-7)


@pytest.mark.parametrize("method", screening.METHODS)
def test_without_noise_every_outlier_is_replaced_by_the_truth(method):
    t_s, truth = ramp(400, sigma=0.0)
    x = truth.copy()
    hit = np.r_[50, 97, 150:170, 300]
    x[hit] += np.random.default_rng(4).choice([-1, 1], len(hit)) * 80.0
    found = screen(t_s, x, Thresholds(sigma=1.0), method)
    np.testing.assert_array_equal(np.flatnonzero(found.flag == OUTLIER), hit)
    np.testing.assert_allclose(found.cleaned[5:], truth[5:], atol=1e-6)


def test_azimuth_goes_through_north_without_an_outlier():
    t_s = np.arange(600) / RATE_HZ
    unwrapped = 300.0 + 10.0 * t_s + np.random.default_rng(5).normal(0.0, 0.01, 600)
    unwrapped[250] += 5.0
    wrapped = screen(t_s, unwrapped % 360.0, Thresholds(sigma=0.01, period=360.0))
    plain = screen(t_s, unwrapped, Thresholds(sigma=0.01))
    np.testing.assert_array_equal(wrapped.flag, plain.flag)
    np.testing.assert_allclose(wrapped.cleaned[4:], plain.cleaned[4:] % 360.0, atol=1e-9)
    assert wrapped.restarts == 0


def test_noise_that_grows_is_followed():
    t_s = np.arange(4000) / RATE_HZ
    sigma = np.geomspace(1.0, 10.0, 4000)
    x = 200.0 * t_s + sigma * np.random.default_rng(6).normal(size=4000)
    adaptive = screen(t_s, x, Thresholds(sigma=1.0))
    fixed = screen(t_s, x, Thresholds(sigma=1.0), "linear-fixed")
    assert np.count_nonzero(adaptive.flag == OUTLIER) <= 4
    assert np.count_nonzero(fixed.flag == OUTLIER) > 400
    ratio = adaptive.sigma[200:] / sigma[200:]
    assert 0.9 < np.median(ratio) < 1.1


def test_a_start_needs_five_values_that_fit():
    t_s, x = ramp(40, seed=7, sigma=0.5)
    x[2] += 200.0
    found = screen(t_s, x, Thresholds(sigma=1.0))
    assert (found.flag[:7] == STARTING).all()
    assert found.flag[7] == GOOD
    assert np.isnan(found.cleaned[:7]).all()


def test_a_target_that_is_elsewhere_for_good_is_found_again():
    t_s, x = ramp(400, seed=8, sigma=0.5)
    x[200:] += 500.0
    found = screen(t_s, x, Thresholds(sigma=1.0))
    assert found.restarts == 1
    assert (found.flag[200:239] == OUTLIER).all()
    assert (found.flag[250:] == GOOD).all()


def test_a_gap_and_its_end():
    t_s, x = ramp(400, seed=9, sigma=0.5)
    keep = np.r_[0:150, 155:300, 390:400]
    found = screen(t_s[keep], x[keep], Thresholds(sigma=1.0))
    assert found.restarts == 1
    assert (found.flag[4:295] == GOOD).all()
    assert (found.flag[295:299] == STARTING).all()
    x[300:390] = np.nan
    said = screen(t_s, x, Thresholds(sigma=1.0))
    assert (said.flag[300:390] == MISSING).all()


def test_unknown_method_is_refused_with_the_names():
    with pytest.raises(ValueError, match="choose one of linear-adaptive"):
        Channel(Thresholds(sigma=1.0), "median")
