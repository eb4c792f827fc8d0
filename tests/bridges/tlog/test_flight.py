"""What a vehicle measured, out of logs whose content is known."""

import gzip
import itertools

import numpy as np
import pytest

from bridges.mavlink.flightclock import MS, S
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from tests.bridges import flights, oracle
from tests.bridges.flights import START_US, flight, packed, positions, write


def test_rows_say_what_was_sent(path):
    got = tlog_flight.flight(tlog.read(write(path, packed(flight()))))
    rows = positions(got.rows)
    assert rows.size == 190
    assert got.report["positions_before_fix"] == 10
    assert rows["t_ns"].tolist() == [START_US * 1000 + (5_000 + 100 * i) * MS for i in range(10, 200)]
    assert (rows["arrival_ns"] >= rows["t_ns"]).all()
    first = rows[0]
    assert first["lat_deg"] == pytest.approx(47.3977420, abs=1e-9)
    assert first["lon_deg"] == pytest.approx((flights.LON + 2650) * 1e-7, abs=1e-9)
    assert (first["alt_msl_m"], first["geoid_separation_m"]) == pytest.approx((488.0, 47.3))
    assert (first["ve_mps"], first["vn_mps"], first["vu_mps"]) == pytest.approx((20.0, 0.05, 1.5))
    moving = got.rows[np.isfinite(got.rows["ae_mps2"])]
    assert got.report["accelerometer"] == "RAW_IMU"
    assert moving.size == 200
    assert np.isnan(moving["lat_deg"]).all()


def test_second_link_adds_nothing(path):
    records = packed(flight(20))
    one = tlog_flight.ins(tlog.read(write(path, records)))
    both = [x for pair in itertools.zip_longest(records, [b""] * 5 + records) for x in pair if x]
    got = tlog_flight.flight(tlog.read(write(path, both)))
    assert got.report["frames_duplicate"] == len(records)
    assert got.rows.tobytes() == one.tobytes()


def test_raw_counts_are_no_acceleration(path):
    got = tlog_flight.flight(tlog.read(write(path, packed(flight(unit=200.0)))))
    assert got.report["accelerometer"] is None
    assert np.isnan(got.rows["ae_mps2"]).all()


def test_height_without_datum_is_no_position(path):
    sent = list(flight(20))
    for one in sent[60:90]:
        if one.message.get_type() == "GLOBAL_POSITION_INT":
            one.message.alt = one.message.relative_alt = 60
    got = tlog_flight.flight(tlog.read(write(path, packed(sent))))
    assert positions(got.rows)["alt_msl_m"].min() == 488.0
    assert got.report["positions_before_fix"] > 10


def test_no_position(path):
    grounded = packed(flight(20, fix_after_s=99))
    with pytest.raises(tlog.LogError, match=r"vehicle 1 never has a position \(all 200.*ATTITUDE"):
        tlog_flight.ins(tlog.read(write(path, grounded)))
    blind = packed(x for x in flight(20) if x.message.get_type() != "GLOBAL_POSITION_INT")
    with pytest.raises(tlog.LogError, match="no GLOBAL_POSITION_INT"):
        tlog_flight.ins(tlog.read(write(path, blind)))


@pytest.mark.parametrize(("name", "system_id"), [("plane_wind8", 2), ("copter_calm", 1)])
def test_simulated_flights_follow_their_truth(name, system_id):
    log, truth = oracle.DATA / f"{name}.tlog", oracle.DATA / f"{name}.truth.csv.gz"
    if not log.exists():
        pytest.skip(f"no {log}")
    with gzip.open(truth, "rt") as file:
        true = np.genfromtxt(file, delimiter=",", names=True)
    got = tlog_flight.flight(tlog.read(log), system_id)
    rows = positions(got.rows)
    boot_s = (rows["t_ns"] - got.boots[0].offset_ns) / S
    true_s = true["TimeUS"] * 1e-6
    rows, boot_s = rows[boot_s > true_s[0]], boot_s[boot_s > true_s[0]]
    for ours, theirs, tolerance in [
        (rows["lat_deg"] * 111_000, true["lat_deg"] * 111_000, 0.35),
        (rows["lon_deg"] * 90_500, true["lon_deg"] * 90_500, 0.35),
        (rows["alt_msl_m"], true["alt_m"], 0.35),
        (rows["ve_mps"], true["ve"], 0.2),
        (rows["vn_mps"], true["vn"], 0.2),
        (rows["vu_mps"], -true["vd"], 0.3),
    ]:
        assert np.sqrt(np.mean((ours - np.interp(boot_s, true_s, theirs)) ** 2)) < tolerance
    assert got.report["geoid_separation_known"]
    assert np.nanmax(np.abs(rows["geoid_separation_m"])) == 0.0
