"""The screening table in short, and the record it is made on."""

import numpy as np
import pytest

from bench.papers.m3 import screening
from bench.papers.m3.joined import joined
from filters.simulation import simulate


def test_record_has_the_papers_statistics():
    made = screening.record(0)
    _, range_m = screening.flight_ranges()
    assert len(made.values) == 33_058
    assert np.isnan(made.values).mean() == pytest.approx(0.0173, abs=0.001)
    assert (made.label > 0).mean() == pytest.approx(0.0412, abs=0.0005)
    isolated = (made.label == simulate.ISOLATED).sum() / (made.label > 0).sum()
    assert isolated == pytest.approx(0.632, abs=0.01)
    assert range_m.min() == pytest.approx(17_830.0, abs=100.0)
    assert range_m.max() == pytest.approx(123_650.0, rel=0.01)
    assert np.abs(np.diff(range_m)).max() * screening.RATE_HZ <= 200.0


@pytest.mark.parametrize("regular", [False, True])
def test_five_point_adaptive_does_what_the_paper_reports(regular):
    for seed in range(2):
        found = screening.score(screening.record(seed, regular=regular), "linear-adaptive")
        assert found.false_alarms <= 5
        assert found.isolated == 1.0
        assert found.in_runs >= 0.856
        assert found.restarts <= 2


@pytest.mark.parametrize("regular", [False, True])
def test_the_long_line_finds_small_outliers(regular):
    made = screening.record(0, screening.SMALLER, regular=regular)
    ours, paper = (screening.score(made, method) for method in (screening.OURS, screening.OURS_OF))
    assert ours.false_alarms <= 5
    assert ours.isolated > 0.98 > 0.95 > paper.isolated
    assert ours.in_runs > 0.9 > paper.in_runs


def test_the_adaptive_threshold_has_fewer_false_alarms():
    made = screening.record(3)
    fixed, adaptive = (
        screening.score(made, f"linear-{kind}", threshold=4.0) for kind in ("fixed", "adaptive")
    )
    assert adaptive.false_alarms < fixed.false_alarms / 2


def test_joined_with_the_trajectory_filter_no_run_goes_through():
    found = joined(0, points=2500)
    assert found.either[1] >= 0.99
    assert found.either[2] >= 0.99
    assert found.trajectory[2] >= 0.99
