"""The pace of a sensor against all its times at once, and in bounded memory."""

import numpy as np
import pytest

from gcs.station.pace import Pace

T0_NS = 1_767_225_600 * 10**9


def told(t_s: np.ndarray, pieces: int = 1) -> dict:
    pace = Pace()
    for part in np.array_split(T0_NS + np.round(t_s * 1e9).astype(np.int64), pieces):
        pace.take(part)
    return pace.report()


def test_rate_and_gaps_are_those_of_all_times_together():
    rng = np.random.default_rng(3)
    t_s = np.arange(0.0, 600.0, 0.05) + rng.uniform(-0.01, 0.01, 12_000)
    t_s = t_s[~((t_s > 100.0) & (t_s < 107.0)) & ~((t_s > 300.0) & (t_s < 300.8))]
    steps = np.diff(t_s)
    report = told(t_s, pieces=5_000)
    assert report["rate_hz"] == pytest.approx(1.0 / np.median(steps), rel=2e-3)
    assert report["gaps"] == 2
    assert report["longest_gap_s"] == pytest.approx(steps.max(), abs=1e-9)
    assert told(t_s) == report  # however it was cut


def test_channels_of_one_measurement_and_what_comes_late_count_once():
    assert told(np.array([1.0, 1.0, 1.0, 2.0, 2.0, 1.5, 3.0]), pieces=7)["rate_hz"] == 1.0


def test_one_measurement_has_no_rate():
    assert told(np.array([1.0])) == told(np.empty(0)) == {"rate_hz": 0.0, "gaps": 0, "longest_gap_s": 0.0}


def test_a_day_of_jitter_costs_no_memory():
    pace, rng = Pace(), np.random.default_rng(4)
    t_ns = T0_NS + np.cumsum(rng.normal(0.05, 0.01, 1_728_000).clip(0.001) * 1e9).astype(np.int64)
    pace.take(t_ns)
    assert len(pace._steps) < 1_500
