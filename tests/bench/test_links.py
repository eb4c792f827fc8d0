"""A log read after the flight, and the same log as a link hands it on: the same verdicts and estimate."""

from pathlib import Path

import numpy as np
import pytest

from bench.speed import links

SAMPLE = Path(__file__).parents[2] / "logs/sample/flight.tlog"


@pytest.mark.slow
def test_a_link_and_the_log_of_it_end_in_the_same_estimate():
    got = links.both(SAMPLE, seconds=15.0)
    apart_m = got.apart_m()
    assert len(apart_m) > 0.95 * len(got.log.best)
    sigma_m = np.sqrt(np.trace(got.log.best["P"][:, :3, :3], axis1=1, axis2=2))
    assert apart_m.max() < 0.3 * np.median(sigma_m)  # an INS alone: its slow errors are metres
    ours, theirs = got.live.counts(), got.log.counts()
    assert 0 <= sum(theirs.values()) - sum(ours.values()) <= 3 * 20 + 20  # the first samples of its IMU
    assert ours.get("late", 0) == theirs.get("late", 0) == 0
