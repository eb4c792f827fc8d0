"""The two filters of the literature: each does what its paper says, and neither breaks on good data."""

import numpy as np
import pytest

from filters.baselines import baselines
from filters.models import model as models
from filters.models.rows import AZIMUTH, LATE, RANGE
from filters.smoother.estimator import Settings
from filters.window import passes as window
from tests.filters import full_ukf
from tests.filters.scenes import error_m, oracle, run, scene, sensors


@pytest.mark.parametrize("method", baselines.PSD_FACTORS)
def test_good_data_cost_little(method):
    truth, used, rows, labels = scene(1, seconds=15, level="normal")
    estimator = baselines.make(method, used, Settings())
    track = run(estimator, rows, batch=500)[0]
    error = np.sqrt(np.mean(error_m(track, truth) ** 2))
    assert error < 1.3 * np.sqrt(np.mean(error_m(oracle(used, rows, labels)[1], truth) ** 2))
    assert np.sqrt(np.mean(error_m(estimator.smooth(), truth) ** 2)) < error


@pytest.mark.parametrize("method", baselines.PSD_FACTORS)
def test_outliers_lose_weight_and_good_rows_keep_it(method):
    _, used, rows, labels = scene(2, share=0.04, seconds=15)
    *_, verdicts = run(baselines.make(method, used, Settings()), rows)
    assert np.median(verdicts["weight"][labels > 0]) < 0.1
    assert np.median(verdicts["weight"][labels == 0]) > 0.9


@pytest.mark.parametrize("method", baselines.PSD_FACTORS)
def test_batches_do_not_matter(method):
    _, used, rows, _ = scene(3, share=0.04, seconds=6)
    ends = np.flatnonzero(np.diff(rows["t_ns"]))[40::7] + 1
    whole = baselines.make(method, used, Settings()).step(rows).track
    stepwise = baselines.make(method, used, Settings())
    parts = [stepwise.step(part).track for part in np.split(rows, ends)]
    assert np.allclose(np.concatenate(parts)["x"], whole["x"], rtol=0, atol=1e-9)


def test_rows_out_of_order_are_late():
    _, used, rows, _ = scene(4, seconds=3)
    estimator = baselines.make("wolf", used, Settings())
    estimator.step(rows)
    step = estimator.step(rows[:5])
    assert (step.verdicts["verdict"] == LATE).all()
    assert len(step.track) == 0


@pytest.mark.parametrize("off_sigma", [0.5, 5.0, 100.0])
@pytest.mark.parametrize("channel", [RANGE, AZIMUTH])
def test_wolf_is_the_textbook_filter_with_more_noise(channel, off_sigma):
    """One value: the full filter's update with R/w, w by the formula of the paper."""
    used = sensors(["theo-a"])
    x, P = np.array([100.0, 400.0, 200.0, 20.0, -5.0, 1.0, 0.5, 1.0, 0.0]), np.diag([4.0] * 3 + [1.0] * 6)
    sigma = used[0].sigma[channel]
    measured = full_ukf.update(x, P, used[0], channel, 0.0)[2] * -1 + off_sigma * sigma
    v = full_ukf.update(x, P, used[0], channel, measured)[2]
    weight = 1.0 / (1.0 + (v / (baselines.IMQ_SIGMAS * sigma)) ** 2)
    noisier = used[0]._replace(sigma=used[0].sigma / np.sqrt(weight))
    expected_x, expected_P, *_ = full_ukf.update(x, P, noisier, channel, measured)
    mind = baselines.Mind(x[None].copy(), P[None].copy(), np.ones(1))
    found = update(baselines.make("wolf", used, Settings()).model, mind, channel, measured)
    assert found == pytest.approx(weight)
    assert np.allclose(mind.x[0], expected_x, rtol=0, atol=1e-9)
    assert np.allclose(mind.P[0], expected_P, rtol=0, atol=1e-9)


def update(model, mind, channel, measured):
    """Take in one value at the same instant, in place; returns its weight."""
    t, sensor = np.zeros(1, np.int64), np.zeros(1, np.int16)
    weight, predicted, sigma, nis = np.zeros((4, 1))
    baselines.follow(
        model, t, sensor, np.array([channel], np.int8), np.array([measured]), 0, np.ones(1), True, mind,
        weight, predicted, sigma, nis, np.zeros((1, 9)), np.zeros((1, 9, 9)),
        window.trace(1, 9, 1), models.scratch(9),
    )  # fmt: skip
    return weight[0]


def test_blend_keeps_mean_and_spread():
    """Against samples drawn from the mixture."""
    rng = np.random.default_rng(5)
    mind = baselines.Mind(
        np.array([[0.0, 1.0], [3.0, -1.0]]), np.array([np.eye(2), 4 * np.eye(2)]), np.ones(2)
    )
    share, x, P = np.array([0.3, 0.7]), np.zeros(2), np.zeros((2, 2))
    baselines.blend(mind, share, x, P)
    which = (rng.random(200_000) < share[1]).astype(int)
    drawn = mind.x[which] + rng.normal(size=(200_000, 2)) * np.array([1.0, 2.0])[which, None]
    assert np.allclose(x, drawn.mean(axis=0), atol=0.02)
    assert np.allclose(P, np.cov(drawn.T), atol=0.06)
