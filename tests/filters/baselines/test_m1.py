"""The GA-BP-UKF paper's outlier handling, as the named method."""

import numpy as np
import pytest

from filters.correction.correction import Correction, Network
from filters.methods import make
from filters.models.rows import AZIMUTH, DEWEIGHTED, ELEVATION, ISOLATED, PATCH, RANGE, USED
from filters.smoother import status
from tests.filters import scenes

pytestmark = pytest.mark.decision


def hit(rows, sensor, channel, first, count, size):
    """``count`` values of a channel from its ``first`` on, moved by ``size``; returns their ids."""
    where = np.flatnonzero((rows["sensor"] == sensor) & (rows["channel"] == channel))[first : first + count]
    rows["value"][where] += size
    return rows["id"][where]


def test_without_outliers_it_is_the_plain_filter():
    _, used, rows, _ = scenes.scene(3, seconds=4.0, level="gentle")
    plain = scenes.run(make("ukf", used), rows)[0]
    ours, _, verdicts = scenes.run(make("ga-bp-ukf", used), rows)
    assert (verdicts["verdict"] == USED).mean() > 0.999
    np.testing.assert_allclose(ours["x"][:, :3], plain["x"][:, :3], atol=0.05)


def test_an_isolated_outlier_loses_gain_with_its_size():
    _, used, rows, _ = scenes.scene(3, seconds=7.0, level="gentle", names=("ins", "theo-a"))
    weights = []
    for size in (5.0, 7.0, 60.0):
        case = rows.copy()
        (bad,) = hit(case, 1, RANGE, 120, 1, size)
        _, _, verdicts = scenes.run(make("ga-bp-ukf", used), case)
        found = verdicts[verdicts["id"] == bad][0]
        assert found["verdict"] == (ISOLATED if found["weight"] < status.DOUBT else DEWEIGHTED)
        weights.append(found["weight"])
    assert 1.0 > weights[0] > weights[1] > weights[2] == 0.0


def test_a_patch_is_counted_from_its_first_member_and_leaves_the_other_channels_alone():
    truth, used, rows, _ = scenes.scene(3, seconds=10.0, level="gentle", names=("ins", "theo-a"))
    bad = hit(rows, 1, RANGE, 120, 12, 40.0)
    track, _, verdicts = scenes.run(make("ga-bp-ukf", used), rows)
    assert (verdicts["verdict"][np.isin(verdicts["id"], bad)] == PATCH).all()
    angles = (rows["sensor"] == 1) & np.isin(rows["channel"], (AZIMUTH, ELEVATION))
    assert (verdicts["verdict"][np.isin(verdicts["id"], rows["id"][angles])] == USED).mean() > 0.99
    assert scenes.error_m(track, truth).max() < 1.0


@pytest.mark.slow
def test_the_correction_changes_the_track_and_nothing_else():
    """A network that always says 0.1 sigma more: the published state moves, the filter does not."""
    _, used, rows, _ = scenes.scene(3, seconds=10.0, level="gentle")
    net = Network(
        np.zeros((1, 9)), np.zeros(1), np.zeros((9, 1)), np.full(9, 0.1), np.full(9, 1e9), np.ones(9)
    )
    plain, plain_smoothed, plain_verdicts = scenes.run(make("default", used), rows)
    moved, smoothed, verdicts = scenes.run(make("default", used, correction=Correction(net)), rows)
    away = np.linalg.norm((moved["x"] - plain["x"])[:, :3], axis=1)
    sigma = np.sqrt(np.trace(plain["P"][:, :3, :3], axis1=1, axis2=2))
    np.testing.assert_allclose(away, 0.1 * sigma, rtol=1e-9)
    assert plain_smoothed.tobytes() == smoothed.tobytes()
    assert plain_verdicts.tobytes() == verdicts.tobytes()
