"""The tables that everything else indexes into."""

import numpy as np
import pytest

from filters.models import rows
from filters.models.rows import CHANNELS, ROW, TRACK, VERDICT, VERDICTS, Sensor

pytestmark = pytest.mark.decision


@pytest.mark.parametrize("k", range(len(CHANNELS)))
def test_every_channel_has_its_constant(k):
    assert getattr(rows, CHANNELS[k].upper()) == k


@pytest.mark.parametrize("k", range(len(VERDICTS)))
def test_every_verdict_has_its_constant(k):
    assert getattr(rows, VERDICTS[k].upper()) == k


def test_axes_follow_one_another():
    assert (rows.E, rows.VE, rows.AE) == (4, 7, 10)
    assert len(CHANNELS) - 1 == rows.AU


def test_small_types_hold_all_that_they_index():
    assert len(CHANNELS) <= np.iinfo(ROW["channel"]).max
    assert len(VERDICTS) <= np.iinfo(VERDICT["verdict"]).max
    assert TRACK["x"].shape == (9,)
    assert TRACK["P"].shape == (9, 9)


def test_a_sensor_stands_level_at_the_station_unless_told_otherwise():
    sensor = Sensor("a", "theodolite", np.ones(13))
    assert np.array_equal(sensor.offset_m, np.zeros(3))
    assert np.array_equal(sensor.rotation, np.eye(3))
    assert sensor.estimate == ()


def test_a_rehearsal_has_every_channel_six_times_and_only_those_there_are():
    sigma = np.full(len(rows.CHANNELS), np.nan)
    sigma[[rows.RANGE, rows.AZIMUTH]] = 1.0, 0.01
    said = rows.rehearsal([rows.Sensor("theo", "theodolite", sigma, np.zeros(3))])
    assert sorted(said["channel"].tolist()) == [rows.RANGE] * 6 + [rows.AZIMUTH] * 6
    assert np.unique(said["t_ns"]).tolist() == [k * 300_000_000 for k in range(6)]


def test_records_of_several_parts_are_joined_and_one_alone_is_handed_on():
    some = np.arange(3).astype([("a", "i8")])
    none = some[:0]
    assert rows.joined([none, some, none], some.dtype) is some
    assert rows.joined([some, none, some], some.dtype)["a"].tolist() == [0, 1, 2, 0, 1, 2]
    empty = rows.joined([], some.dtype)
    assert (len(empty), empty.dtype) == (0, some.dtype)
