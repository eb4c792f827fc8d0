"""The flight's own clock, out of logs whose clocks are known."""

import random

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges.mavlink.flightclock import MS, S
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from gcs.contract.limits import LAST_NS
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


@pytest.mark.parametrize("stamps", ["all", "some", "zero"])
@pytest.mark.parametrize("system_time", [True, False])
def test_stamps_that_are_noise_never_raise_and_no_time_leaves_this_century(path, stamps, system_time):
    rng = random.Random(stamps)

    def stamp(own: bytes) -> bytes:
        if stamps == "zero":
            return bytes(8)
        wild = rng.getrandbits(rng.choice([32, 52, 60, 63, 64])).to_bytes(8, "big")
        return wild if stamps == "all" or rng.random() < 0.4 else own

    records = packed(flight(20, system_time=system_time, fix_after_s=0))
    got = tlog_flight.flight(tlog.read(write(path, [stamp(r[:8]) + r[8:] for r in records])))
    rows = positions(got.rows)
    assert rows.size == 200
    assert (rows["t_ns"] < LAST_NS + 3600 * S).all()
    assert (np.diff(np.sort(rows["t_ns"])) >= 99 * MS).all()
    if system_time:
        assert rows["t_ns"].min() == START_US * 1000 + 5_000 * MS


@pytest.mark.parametrize("jump_s", [-10.0, 2.0, -3600.0])
@pytest.mark.parametrize("receiver_s", [0.0, 500.0])
def test_gps_time_that_jumps_in_flight_keeps_the_offset_of_most_and_counts_the_rest(path, jump_s, receiver_s):
    sent = []
    for k, one in enumerate(flight(20, fix_after_s=0)):
        jumped = k > 400 and one.message.get_type() == "SYSTEM_TIME"
        if jumped:
            one.message.time_unix_usec += round(jump_s * 1e6)
        sent.append(one._replace(receipt_us=one.receipt_us + round(receiver_s * 1e6)))
    got = tlog_flight.flight(tlog.read(write(path, packed(sent))))
    late_s = 0.0 if receiver_s == 0.0 else jump_s  # who is right, only the receiver's clock could say
    expected = START_US * 1000 + 5_000 * MS + round(late_s * S)
    assert positions(got.rows)["t_ns"].min() == expected
    assert got.report["boots"][0]["system_times_contradicting"] > 70


def test_two_vehicles_with_one_system_id_in_a_log_are_counted_and_not_mixed(path):
    flights = [list(flight(20, fix_after_s=0)), list(flight(20, fix_after_s=0, boot_ms=900_000))]
    for one in flights[1]:
        if one.message.get_type() == "GLOBAL_POSITION_INT":
            one.message.lat += 10_000_000  # another degree
    both = [one for pair in zip(*flights, strict=True) for one in pair]
    steady = [one._replace(receipt_us=START_US + k * 8_000) for k, one in enumerate(both)]
    got = tlog_flight.flight(tlog.read(write(path, packed(steady))))
    rows = positions(got.rows)
    assert rows.size == 200
    assert np.ptp(rows["lat_deg"]) < 0.1
    assert len(got.boots) == 1
    assert got.report["messages_of_another_with_its_id"] == 600
