"""The two filters of the literature: each does what its paper says, and neither breaks on good data."""

import numpy as np
import pytest

from filters.baselines import baselines, interacting
from filters.models import state as models
from filters.models.rows import AZIMUTH, INVALID, LATE, RANGE, ROW
from filters.models.settings import Settings
from filters.smoother import passes
from filters.smoother.status import NO_STATE
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


@pytest.mark.parametrize("method", baselines.PSD_FACTORS)
def test_a_lost_filter_begins_anew_and_says_so(method):
    """From one moment on every value is nonsense: no position is believed any more."""
    _, used, rows, _ = scene(5, seconds=12, level="gentle", names=("theo-a", "theo-b"))
    nonsense = rows["t_ns"] > rows["t_ns"][0] + 5_000_000_000
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, nonsense.sum())
    rows["value"][nonsense] = np.where(rows["channel"][nonsense] == RANGE, 3e4 + 2e4 * drawn, 1.5 * drawn)
    estimator = baselines.make(method, used, Settings())
    track, _, verdicts = run(estimator, rows, batch=200)
    lost_ns = np.array([one["t_ns"] for one in estimator.report()["resets"]])
    assert track["reset_counter"][-1] == (lost_ns <= track["t_ns"][-1]).sum() >= 1  # one may wait for a start
    begun_s = (lost_ns - rows["t_ns"][0]) / 1e9
    assert 6.9 < begun_s[0] < {"wolf": 7.2, "imm": 11.5}[method]  # a soft gate is dragged along for a while
    assert len(verdicts) == len(rows)
    assert np.isfinite(track["x"]).all()
    assert np.isfinite(estimator.smooth()["x"]).all()


def test_a_gap_begins_anew_too():
    truth, used, rows, _ = scene(5, seconds=20, level="gentle")
    t_s = (rows["t_ns"] - rows["t_ns"][0]) / 1e9
    heard = rows[(t_s < 4.0) | (t_s > 15.0)]
    estimator = baselines.make("wolf", used, Settings())
    track, _, _ = run(estimator, heard, batch=100)
    assert [one["reason"] for one in estimator.report()["resets"]] == ["nothing heard of its place for 10 s"]
    assert error_m(track, truth, skip_s=16.0).max() < 3.0


def test_what_waits_for_a_start_in_vain_is_not_forgotten():
    _, used, rows, _ = scene(4, seconds=5, names=("theo-a",))
    angles = rows[rows["channel"] == AZIMUTH]
    track, _, verdicts = run(baselines.make("imm", used, Settings()), angles, batch=50)
    assert len(track) == 0
    assert sorted(verdicts["id"]) == sorted(angles["id"])
    assert set(verdicts["verdict"]) == {INVALID}
    assert set(verdicts["reason"]) == {NO_STATE}


@pytest.mark.parametrize("off_sigma", [0.5, 5.0, 100.0])
@pytest.mark.parametrize("channel", [RANGE, AZIMUTH])
def test_wolf_is_the_textbook_filter_with_more_noise(channel, off_sigma):
    """One value: the full filter's update with R/w, w by the formula of the paper."""
    used = sensors(["theo-a"], slow=0.0)
    x, P = np.array([100.0, 400.0, 200.0, 20.0, -5.0, 1.0, 0.5, 1.0, 0.0]), np.diag([4.0] * 3 + [1.0] * 6)
    sigma = used[0].sigma[channel]
    measured = full_ukf.update(x, P, used[0], channel, 0.0)[2] * -1 + off_sigma * sigma
    v = full_ukf.update(x, P, used[0], channel, measured)[2]
    weight = 1.0 / (1.0 + (v / (interacting.IMQ_SIGMAS * sigma)) ** 2)
    noisier = used[0]._replace(sigma=used[0].sigma / np.sqrt(weight))
    expected_x, expected_P, *_ = full_ukf.update(x, P, noisier, channel, measured)
    mixture = interacting.Mixture(x[None].copy(), P[None].copy(), np.ones(1), np.zeros(2, np.int64))
    found = update(baselines.make("wolf", used, Settings()).model, mixture, channel, measured)
    assert found == pytest.approx(weight)
    assert np.allclose(mixture.x[0], expected_x, rtol=0, atol=1e-9)
    assert np.allclose(mixture.P[0], expected_P, rtol=0, atol=1e-9)


def update(model, mixture, channel, measured):
    """Take in one value at the same instant, in place; returns its weight."""
    row = np.zeros(1, ROW)
    row["channel"], row["value"] = channel, measured
    judged = interacting.Followed(*np.zeros((4, 1)), np.zeros((1, 9)), np.zeros((1, 9, 9)))
    interacting.follow(
        model, baselines.columns(model, row), 0, np.array([[1.0, 1.0, 0.0, 0.0]]), True, mixture, judged,
        passes.trace(1, 9, 1), models.scratch(9),
    )  # fmt: skip
    return judged.weight[0]
