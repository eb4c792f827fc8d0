"""Screening judges every channel of a mixed stream as `screening` would judge it alone."""

import numpy as np
import pytest

from bench import cases, scene
from filters.models.rows import AZIMUTH
from filters.screening import screening
from filters.screening.channels import ChannelScreening, NoScreening
from filters.simulation import simulate

pytestmark = pytest.mark.decision

CASE = next(case for case in cases.CASES if case.name == "4 %")


@pytest.fixture(scope="module")
def flight():
    return scene.fly(CASE, 1, 40.0)


def test_each_channel_is_judged_as_if_alone(flight):
    doubted = ChannelScreening(flight.sensors).doubts(flight.rows)
    t_s = (flight.rows["t_ns"] - flight.rows["t_ns"][0]) * 1e-9
    for s, sensor in enumerate(flight.sensors):
        for c in np.flatnonzero(sensor.sigma > 0):
            own = (flight.rows["sensor"] == s) & (flight.rows["channel"] == c)
            if sensor.kind == "ins":
                assert not doubted[own].any()
                continue
            period = 2 * np.pi if c == AZIMUTH else 0.0
            settings = screening.Thresholds(sensor.sigma[c], period=period)
            alone = screening.screen(t_s[own], flight.rows["value"][own], settings)
            assert np.array_equal(doubted[own], alone.flag == screening.OUTLIER)


def test_pieces_do_not_matter(flight):
    whole, parts = ChannelScreening(flight.sensors), ChannelScreening(flight.sensors)
    found = [parts.doubts(part) for part in np.array_split(flight.rows, 700)]
    assert np.array_equal(np.concatenate(found), whole.doubts(flight.rows))


def test_it_doubts_outliers_rather_than_good_values(flight):
    doubted = ChannelScreening(flight.sensors).doubts(flight.rows)
    watched = flight.rows["sensor"] > 0
    isolated = watched & (flight.labels == simulate.ISOLATED) & (flight.off_sigma > 12)
    assert doubted[isolated].mean() > 0.8
    assert doubted[watched & (flight.labels == simulate.NONE)].mean() < 0.02


def test_late_rows_are_not_judged(flight):
    channels = ChannelScreening(flight.sensors)
    channels.doubts(flight.rows)
    late = flight.rows[-500:-400].copy()
    late["value"] += 1e4
    assert not channels.doubts(late).any()


def test_no_screening_doubts_nothing(flight):
    assert not NoScreening().doubts(flight.rows).any()
