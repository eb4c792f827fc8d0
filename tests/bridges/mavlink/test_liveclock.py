"""A vehicle's clock live: waited for, kept, and not mixed with another's."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges.mavlink.decoder import PATIENCE_NS, Decoder
from bridges.mavlink.flightclock import S
from gcs.contract.messages import InsMeasurement
from tests.bridges.flights import START_US, flight, sent_by


def heard(received, station_s=0.0, system=1, decoder=None):
    """(measurements with the true instant of each, decoder) of messages at a station whose clock is off."""
    decoder, out = decoder or Decoder(1), []
    speaker = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    for one in received:
        arrival_ns = one.receipt_us * 1000 + round(station_s * S)
        out += decoder.decode(sent_by(one.message, speaker), arrival_ns)
    return out + decoder.flush(), decoder


def places(measurements):
    return [m for m in measurements if isinstance(m, InsMeasurement) and m.lat_deg is not None]


@pytest.mark.parametrize("station_s", [0.0, 3600.0, -3600.0, -1e8])
def test_whatever_the_stations_clock_says_the_first_row_is_right(station_s):
    """A recording that is cut just behind a SYSTEM_TIME, played to a station with a wrong clock."""
    cut = [one for one in flight(20, fix_after_s=0)][2:]
    sparse = [one for k, one in enumerate(cut) if one.message.get_type() != "SYSTEM_TIME" or k // 61 % 3 == 2]
    got, decoder = heard(sparse, station_s)
    all_of_them = [one for one in sparse if one.message.get_type() == "GLOBAL_POSITION_INT"]
    assert len(places(got)) == len(all_of_them)
    assert [m.t_ns for m in places(got)] == [one.receipt_us * 1000 for one in all_of_them]
    assert [m.arrival_ns for m in places(got)] == [m.t_ns + round(station_s * S) for m in places(got)]
    assert decoder.told == []


def test_without_a_system_time_it_waits_so_long_loses_nothing_and_says_so():
    got, decoder = heard(flight(30, system_time=False, fix_after_s=0))
    assert len(places(got)) == 300
    told = [text for _, text in decoder.told]
    assert len(told) == 1
    assert "no SYSTEM_TIME in 10 s" in told[0]
    early, _ = heard(flight(PATIENCE_NS / S - 1.0, system_time=False, fix_after_s=0))
    assert len(places(early)) == 90  # a link that ends before


@pytest.mark.parametrize("jump_s", [-10.0, 2.0, -3600.0, 3600.0, 18.0])
@pytest.mark.parametrize("station_s", [0.0, 500.0])
def test_gps_time_that_jumps_in_flight_is_told_and_boot_time_goes_on(jump_s, station_s):
    def jumping():
        for one in flight(30, fix_after_s=0):
            if one.message.get_type() == "SYSTEM_TIME" and 15 <= (one.receipt_us - START_US) * 1e-6 < 25:
                one.message.time_unix_usec += round(jump_s * 1e6)
            yield one

    got, decoder = heard(jumping(), station_s)
    t_s = np.array([m.t_ns - START_US * 1000 for m in places(got)]) / S
    assert t_s == pytest.approx(5.0 + 0.1 * np.arange(300))
    levels, told = zip(*decoder.told, strict=True)
    assert levels == ("warning", "info")
    assert f"jumps by {jump_s:+.1f} s" in told[0]
    assert "not followed" in told[0]


def test_gps_time_that_becomes_right_in_flight_is_followed_where_the_station_agrees():
    def wrong_first():
        for one in flight(30, fix_after_s=0):
            if one.message.get_type() == "SYSTEM_TIME" and (one.receipt_us - START_US) * 1e-6 < 15:
                one.message.time_unix_usec += 18_000_000
            yield one

    got, decoder = heard(wrong_first())
    t_s = np.array([m.t_ns - START_US * 1000 for m in places(got)]) / S
    off = t_s - (5.0 + 0.1 * np.arange(300))
    assert off[:99] == pytest.approx(18.0)
    assert off[101:] == pytest.approx(0.0)
    assert len(decoder.told) == 1
    assert "followed, the station's clock agrees" in decoder.told[0][1]


def test_two_vehicles_without_a_system_id_the_first_is_kept_and_both_are_named():
    one, two = dialect.MAVLink(None, 1, 1), dialect.MAVLink(None, 7, 1)
    decoder, got = Decoder(None, "udpin:127.0.0.1:1"), []
    for a, b in zip(flight(10), flight(10, boot_ms=900_000), strict=False):
        got += decoder.decode(sent_by(a.message, one), a.receipt_us * 1000)
        got += decoder.decode(sent_by(b.message, two), a.receipt_us * 1000)
    assert len(places(got)) == 90
    assert max(m.t_ns for m in places(got)) < START_US * 1000 + 20 * S
    assert len(decoder.told) == 1
    level, text = decoder.told[0]
    assert level == "error"
    assert "vehicles 1 and 7" in text
    assert "set [vehicle] system_id" in text


def test_with_a_system_id_other_vehicles_are_nobodys_business():
    _, decoder = heard(flight(3))
    assert heard(flight(3), system=7, decoder=decoder)[0] == []
    assert decoder.told == []


@pytest.mark.parametrize("other_ms", [20_000, 900_000], ids=["booted before", "long before"])
@pytest.mark.parametrize("first", [0, 1])
def test_two_vehicles_with_one_system_id_are_told_and_never_mixed(other_ms, first):
    flights = [list(flight(20, fix_after_s=0)), list(flight(20, fix_after_s=0, boot_ms=other_ms))]
    for one in flights[1]:
        if one.message.get_type() == "GLOBAL_POSITION_INT":
            one.message.lat += 10_000_000  # another degree
    both = [pair[k] for pair in zip(*flights, strict=True) for k in (first, 1 - first)]
    start_us = both[0].receipt_us
    steady = [one._replace(receipt_us=start_us + k // 2 * 16_000) for k, one in enumerate(both)]
    got, decoder = heard(steady)
    assert len(places(got)) == 200
    assert np.ptp([m.lat_deg for m in places(got)]) < 0.1
    assert "two vehicles with one system id" in decoder.told[0][1]
    assert len(decoder.told) == 1
