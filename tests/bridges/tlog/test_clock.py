"""The flight's own clock, out of logs whose clocks are known."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges.mavlink.flightclock import MS, S
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from tests.bridges.flights import START_US, flight, packed, positions, write


def test_clock_without_system_time_finds_the_least_delay(path):
    sent = flight(300, system_time=False, delay_s=0.020, jitter_s=0.060, drift=80e-6, seed=3)
    got = tlog_flight.flight(tlog.read(write(path, packed(sent))))
    rows = positions(got.rows)
    true_ns = START_US * 1000 + np.rint((5_000 + 100 * np.arange(10, 3000)) * MS * (1 + 80e-6)).astype(
        np.int64
    )
    error_s = (rows["t_ns"][np.argsort(rows["t_ns"])] - true_ns) / S
    assert got.boots[0].source == "receipt"
    assert np.abs(error_s - 0.020).max() < 0.003  # the mean delay would be 80 ms
    assert got.boots[0].drift == pytest.approx(80e-6, abs=20e-6)


def test_each_boot_has_its_own_clock_and_logs_may_be_joined_backwards(path):
    later = packed(flight(30, start_us=START_US + 3_600_000_000, boot_ms=200_000))
    earlier = packed(flight(30, boot_ms=9_000, system_time=False, fix_after_s=0))
    got = tlog_flight.flight(tlog.read(write(path, later, earlier)))
    assert [boot.source for boot in got.boots] == ["SYSTEM_TIME", "receipt"]
    assert (np.diff(got.rows["arrival_ns"]) >= 0).all()
    t_ns = positions(got.rows)["t_ns"]
    assert t_ns[0] == START_US * 1000 + 9_000 * MS
    assert t_ns[-1] == (START_US + 3_600_000_000) * 1000 + (200_000 + 29_900) * MS


def test_same_boot_time_in_a_later_log_is_another_boot(path):
    first = packed(flight(10, boot_ms=5_000))
    second = packed(flight(10, boot_ms=60_000, start_us=START_US + 86_400_000_000))
    assert len(tlog_flight.flight(tlog.read(write(path, first, second))).boots) == 2


def test_boot_time_wraps_after_49_days(path):
    sent = flight(20, boot_ms=(1 << 32) - 10_000)
    got = tlog_flight.flight(tlog.read(write(path, packed(sent))))
    assert len(got.boots) == 1
    assert np.unique(np.diff(positions(got.rows)["t_ns"])).tolist() == [100 * MS]


def test_system_time_from_before_the_receiver_set_it_does_not_count(path):
    sent = list(flight(40))
    for one in sent[:60]:
        if isinstance(one.message, dialect.MAVLink_system_time_message):
            one.message.time_unix_usec = 1_262_400_000_000_000
    got = tlog_flight.flight(tlog.read(write(path, packed(sent))))
    assert positions(got.rows)["t_ns"][0] == START_US * 1000 + 6_000 * MS


def test_stamps_that_do_not_run_with_the_flight_are_not_believed(path):
    sent = [one._replace(receipt_us=START_US + (one.receipt_us - START_US) // 5) for one in flight(300)]
    got = tlog_flight.flight(tlog.read(write(path, packed(sent))))
    rows = positions(got.rows)
    assert got.report["receipts_not_believed"] > 0.8 * got.rows.size
    assert rows["t_ns"][0] == START_US * 1000 + 6_000 * MS
    assert np.abs(rows["arrival_ns"] - rows["t_ns"]).max() <= 20 * S


def test_a_wrong_receiver_clock_shifts_no_arrival(path):
    hour_late = [one._replace(receipt_us=one.receipt_us + 3_600_000_000) for one in flight(30)]
    rows = tlog_flight.ins(tlog.read(write(path, packed(hour_late))))
    assert np.abs(rows["arrival_ns"] - rows["t_ns"]).max() < 0.01 * S
