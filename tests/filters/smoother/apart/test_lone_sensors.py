"""One radar at two seconds a scan, alone: what an outlier does, and when it is believed again."""

import numpy as np
import pytest

from filters import methods
from filters.smoother import tracks
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import SENSORS, run

pytestmark = pytest.mark.decision


def scanned(seconds, outlier_at=None):
    """One radar's rows, a scan every two seconds; those of one scan off by 40 sigmas."""
    radar = SENSORS[3]
    rows = small.fly([radar], seconds, hz=0.5)
    for row in rows[rows["t_ns"] == outlier_at] if outlier_at is not None else []:
        rows["value"][row["id"]] += 40.0 * radar.sigma[row["channel"]]
    return radar, rows


def test_of_few_rows_the_newest_state_is_the_one_decided_again():
    radar, rows = scanned(60.0)
    estimator = methods.make("default", [radar])
    for part in np.split(rows, np.flatnonzero(np.diff(rows["t_ns"])) + 1):
        track = estimator.step(part).track
        if len(track):
            assert np.array_equal(track["x"][-1], estimator._now.best.head.x[:9])


def test_an_outlier_of_a_lone_radar_does_not_take_the_state_along():
    """Its prediction is much less sure than its rows: an outlier of weight 0.01 must count for nothing."""
    _, rows = scanned(80.0)
    radar, wrong = scanned(80.0, outlier_at=rows["t_ns"][-1])
    good, _, _, _ = run(rows, sensors=[radar])
    bad, _, _, _ = run(wrong, sensors=[radar])
    sigma = np.sqrt(np.diag(bad["P"][-1])[:3])
    assert (np.abs(bad["x"][-1, :3] - small.truth(bad["t_ns"][-1:] * 1e-9)[0][0]) < 3.0 * sigma).all()
    assert sigma.max() > 1.5 * np.sqrt(np.diag(good["P"][-1])[:3]).max()


def test_a_lone_sensor_that_was_unknown_is_ambiguous_when_it_is_known_again_smoothed_too():
    radar, rows = scanned(200.0)
    lost = (rows["t_ns"] >= 100e9) & (rows["t_ns"] < 130e9)
    erratic = np.random.default_rng(0).uniform(-60.0, 60.0, lost.sum())  # on a run that is smooth it goes on
    rows["value"][lost] += erratic * np.array([radar.sigma[c] for c in rows["channel"][lost]])
    track, smoothed, _, _ = run(rows, sensors=[radar])
    t_s = track["t_ns"] * 1e-9
    assert not track["ambiguous"][(t_s > 60.0) & (t_s < 100.0)].any()
    back = t_s[(t_s > 100.0) & np.append(False, np.diff(t_s) > 2.5)]
    assert len(back)
    again = (t_s >= back[0]) & (t_s < back[0] + 20.0)
    assert track["ambiguous"][again].all()
    assert (track["quality"][again] <= tracks.DOUBTFUL).all()
    assert smoothed["ambiguous"][np.isin(smoothed["t_ns"], track["t_ns"][again])].all()
