"""The classic filter: filterpy's is the textbook's, and behaves in the session as all others do."""

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from filters import methods
from filters.baselines import classic
from filters.correction.correction import off
from filters.models.rows import AZIMUTH, CHANNELS, LATE, RANGE, USED, E
from filters.models.settings import Settings
from tests.filters import full_ukf
from tests.filters.scenes import error_m, run, scene

CALM = Settings(gust_psd=0.0)  # the oracle knows white jerk alone


def make(used, settings=CALM):
    return methods.make("filterpy-ukf", used, settings)


def test_a_short_flight_equals_the_textbook():
    """Every state of 4 s of two theodolites and a radar, by another implementation."""
    _, used, rows, _ = scene(11, seconds=4.0, level="gentle", names=("theo-a", "theo-b", "radar"))
    one = make(used)
    track = run(one, rows, batch=300)[0]
    first = classic.ClassicUkf(used, CALM)
    first._waiting = rows
    first._begin()
    x, P, now = first._kf.x, first._kf.P, rows["t_ns"][0]
    states = []
    for t, epoch in itertools.groupby(rows, lambda row: row["t_ns"]):
        F, Q = full_ukf.transition((t - now) * 1e-9)
        x, P, now = F @ x, F @ P @ F.T + CALM.jerk_psd * Q, t
        for row in epoch:
            x, P, *_ = full_ukf.update(x, P, used[row["sensor"]], int(row["channel"]), row["value"])
        states.append((x, P))
    assert np.array_equal(track["t_ns"], np.unique(rows["t_ns"]))
    assert np.allclose(track["x"], [x for x, _ in states], rtol=1e-9, atol=2e-7)
    assert np.allclose(track["P"], [P for _, P in states], rtol=1e-7, atol=1e-6)


def test_an_ins_alone_is_a_linear_filter():
    """Position with its slow error, velocity, acceleration: the Kalman filter in plain matrices."""
    _, used, rows, _ = scene(3, seconds=3.0, level="gentle", names=("ins",))
    one = make(used)
    track = run(one, rows)[0]
    first = classic.ClassicUkf(used, CALM)
    first._waiting = rows
    first._begin()
    x, P, now, tau = first._kf.x, first._kf.P, rows["t_ns"][0], CALM.ins_bias_tau_s
    assert len(x) == 12
    for t, epoch in itertools.groupby(rows, lambda row: row["t_ns"]):
        dt = (t - now) * 1e-9
        F, Q, now = np.eye(12), np.zeros((12, 12)), t
        F[:9, :9], core = full_ukf.transition(dt)
        keep = np.exp(-dt / tau)
        F[9:, 9:] *= keep
        Q[:9, :9] = CALM.jerk_psd * core
        Q[9:, 9:] = np.eye(3) * CALM.ins_bias_sigma_m**2 * (1 - keep**2)
        x, P = F @ x, F @ P @ F.T + Q
        for row in epoch:
            c = int(row["channel"]) - E
            h = np.eye(12)[c] + (np.eye(12)[9 + c] if c < 3 else 0.0)
            S = h @ P @ h + used[0].sigma[row["channel"]] ** 2
            x, P = x + P @ h / S * (row["value"] - h @ x), P - np.outer(P @ h, P @ h) / S
    assert np.allclose(track["x"][-1], x[:9], rtol=1e-9, atol=1e-7)
    assert np.allclose(track["P"][-1], P[:9, :9], rtol=1e-7, atol=1e-7)


def test_every_row_is_used_an_outlier_too_and_late_ones_are_late():
    truth, used, rows, labels = scene(2, share=0.04, seconds=6.0, level="gentle")
    one = make(used)
    track, _, verdicts = run(one, rows, batch=400)
    assert np.array_equal(verdicts["id"], rows["id"])
    assert (verdicts["verdict"] == USED).all()
    again = one.step(rows[:5])
    assert (again.verdicts["verdict"] == LATE).all()
    clean = run(make(used), rows[labels == 0])[0]
    assert error_m(track, truth, 2.0).max() > 2.0 * error_m(clean, truth, 2.0).max()


def test_its_smoothed_track_is_better():
    truth, used, rows, _ = scene(1, seconds=8.0, level="gentle")
    one = make(used)
    track = run(one, rows)[0]
    rms = [np.sqrt(np.mean(error_m(t, truth, 2.0) ** 2)) for t in (track, one.smooth())]
    assert rms[1] < rms[0] < 1.0


def test_a_gap_begins_anew_and_is_counted():
    truth, used, rows, _ = scene(5, seconds=20.0, level="gentle", names=("ins", "radar"))
    t_s = (rows["t_ns"] - rows["t_ns"][0]) / 1e9
    one = make(used)
    track = run(one, rows[(t_s < 3.0) | (t_s > 15.0)], batch=300)[0]
    assert [reset["reason"] for reset in one.report()["resets"]] == ["nothing heard of its place for 10 s"]
    assert track["reset_counter"][-1] == 1
    assert error_m(track, truth, 16.0).max() < 5.0


def test_nonsense_loses_the_lock():
    _, used, rows, _ = scene(5, seconds=8.0, level="gentle", names=("theo-a", "theo-b"))
    nonsense = rows["t_ns"] > rows["t_ns"][0] + 3_000_000_000
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, nonsense.sum())
    rows["value"][nonsense] = np.where(rows["channel"][nonsense] == RANGE, 3e4 + 2e4 * drawn, 1.5 * drawn)
    one = make(used)
    track, _, verdicts = run(one, rows, batch=200)
    assert len(one.report()["resets"]) >= 1
    assert len(verdicts) == len(rows)
    assert np.isfinite(track["x"]).all()
    assert np.isfinite(one.smooth()["x"]).all()


def test_a_height_known_beforehand_is_kept():
    _, used, rows, _ = scene(4, seconds=3.0, level="gentle", names=("theo-a", "theo-b"))
    flat = rows[rows["channel"] <= AZIMUTH]
    track = run(make(used, CALM._replace(height_m=120.0, height_sigma_m=2.0)), flat)[0]
    assert np.abs(track["x"][:, 2] - 120.0).max() < 10.0
    assert np.abs(track["x"][:, 5]).max() < 0.1


def test_it_takes_no_correction():
    with pytest.raises(ValueError, match="no learned correction"):
        methods.make("filterpy-ukf", [], None, lambda *states: off(*states))


def test_filterpy_is_not_loaded_before_it_is_asked_for():
    code = "import sys, filters.methods; print('filterpy' in sys.modules)"
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout.strip() == "False"


def test_the_report_has_every_channel_and_the_errors_it_knows():
    _, used, rows, _ = scene(1, seconds=3.0, level="gentle")
    one = make(used)
    run(one, rows)
    told = one.report()["sensors"]
    assert set(told["ins"]["errors"]) == {"e", "n", "u"}
    assert told["theo-a"]["errors"] == {}
    assert told["radar"]["channels"]["range"]["used"] > 0
    assert set(told["radar"]["channels"]) == set(CHANNELS[:4])
