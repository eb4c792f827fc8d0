import gzip
import itertools

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges import autopilot, tlog
from bridges.flightclock import MS, S
from tests.bridges import flights, oracle
from tests.bridges.flights import START_US, flight, packed, write


@pytest.fixture
def path(tmp_path):
    return tmp_path / "flight.tlog"


def positions(rows):
    return rows[np.isfinite(rows["lat_deg"])]


def test_rows_say_what_was_sent(path):
    got = tlog.flight(tlog.read(write(path, packed(flight()))))
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


def test_coordinated_turn_accelerates_sideways_only():
    bank, g = np.radians(40.0), autopilot.GRAVITY
    force = np.array([0.0, 0.0, -g / np.cos(bank)])
    for heading in np.radians([0.0, 90.0, 200.0]):
        a = autopilot.acceleration_enu(force, np.array([bank, 0.0, heading]), np.zeros(3), 0.0)
        right = np.array([np.cos(heading), -np.sin(heading), 0.0])
        assert a == pytest.approx(g * np.tan(bank) * right, abs=1e-12)


def test_body_rates_carry_the_attitude_on():
    roll_rate, age = 1.2, 0.08
    force = np.array([0.3, -0.4, -9.7])
    late = autopilot.acceleration_enu(force, np.array([0.1, 0, 0]), np.array([roll_rate, 0, 0]), age)
    exact = autopilot.acceleration_enu(force, np.array([0.1 + roll_rate * age, 0, 0]), np.zeros(3), 0.0)
    assert late == pytest.approx(exact, abs=2e-3)


def test_climb_is_positive_up():
    force = np.array([0.0, 0.0, -autopilot.GRAVITY - 2.0])
    assert autopilot.acceleration_enu(force, np.zeros(3), np.zeros(3), 0.0) == pytest.approx([0, 0, 2.0])


def test_clock_without_system_time_finds_the_least_delay(path):
    sent = flight(300, system_time=False, delay_s=0.020, jitter_s=0.060, drift=80e-6, seed=3)
    got = tlog.flight(tlog.read(write(path, packed(sent))))
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
    got = tlog.flight(tlog.read(write(path, later, earlier)))
    assert [boot.source for boot in got.boots] == ["SYSTEM_TIME", "receipt"]
    assert (np.diff(got.rows["arrival_ns"]) >= 0).all()
    t_ns = positions(got.rows)["t_ns"]
    assert t_ns[0] == START_US * 1000 + 9_000 * MS
    assert t_ns[-1] == (START_US + 3_600_000_000) * 1000 + (200_000 + 29_900) * MS


def test_same_boot_time_in_a_later_log_is_another_boot(path):
    first = packed(flight(10, boot_ms=5_000))
    second = packed(flight(10, boot_ms=60_000, start_us=START_US + 86_400_000_000))
    assert len(tlog.flight(tlog.read(write(path, first, second))).boots) == 2


def test_boot_time_wraps_after_49_days(path):
    sent = flight(20, boot_ms=(1 << 32) - 10_000)
    got = tlog.flight(tlog.read(write(path, packed(sent))))
    assert len(got.boots) == 1
    assert np.unique(np.diff(positions(got.rows)["t_ns"])).tolist() == [100 * MS]


def test_system_time_from_before_the_receiver_set_it_does_not_count(path):
    sent = list(flight(40))
    for one in sent[:60]:
        if isinstance(one.message, dialect.MAVLink_system_time_message):
            one.message.time_unix_usec = 1_262_400_000_000_000
    got = tlog.flight(tlog.read(write(path, packed(sent))))
    assert positions(got.rows)["t_ns"][0] == START_US * 1000 + 6_000 * MS


def test_untrue_stamps_are_dropped_and_counted(path):
    records = packed(flight(60, system_time=False))
    whole = tlog.ins(tlog.read(write(path, records)))
    for i, bit in [(50, 7), (700, 30), (1100, 45), (1101, 51), (2000, 62), (2500, 63)]:
        stamp = int.from_bytes(records[i][:8], "big") ^ (1 << bit + 1 if bit == 7 else 1 << bit)
        records[i] = stamp.to_bytes(8, "big") + records[i][8:]
    log = tlog.read(write(path, records))
    assert log.stamps_dropped == 5  # a change of 256 µs is none
    rows = tlog.ins(log)
    assert rows["t_ns"].tolist() == whole["t_ns"].tolist()
    assert np.abs(rows["arrival_ns"] - whole["arrival_ns"]).max() < 0.2 * S


def test_stamps_that_do_not_run_with_the_flight_are_not_believed(path):
    sent = [one._replace(receipt_us=START_US + (one.receipt_us - START_US) // 5) for one in flight(300)]
    got = tlog.flight(tlog.read(write(path, packed(sent))))
    rows = positions(got.rows)
    assert got.report["receipts_not_believed"] > 0.8 * got.rows.size
    assert rows["t_ns"][0] == START_US * 1000 + 6_000 * MS
    assert np.abs(rows["arrival_ns"] - rows["t_ns"]).max() <= 20 * S


def test_a_wrong_receiver_clock_shifts_no_arrival(path):
    hour_late = [one._replace(receipt_us=one.receipt_us + 3_600_000_000) for one in flight(30)]
    rows = tlog.ins(tlog.read(write(path, packed(hour_late))))
    assert np.abs(rows["arrival_ns"] - rows["t_ns"]).max() < 0.01 * S


def test_second_link_adds_nothing(path):
    records = packed(flight(20))
    one = tlog.ins(tlog.read(write(path, records)))
    both = [x for pair in itertools.zip_longest(records, [b""] * 5 + records) for x in pair if x]
    got = tlog.flight(tlog.read(write(path, both)))
    assert got.report["frames_duplicate"] == len(records)
    assert got.rows.tobytes() == one.tobytes()


def test_picks_the_vehicle_and_its_autopilot(path):
    drone = packed(flight(20, boot_ms=5_000), system=3)
    other = packed(flight(20, boot_ms=90_000), system=4)
    camera = packed(
        (x for x in flight(20, boot_ms=77_000) if x.message.get_type() != "HEARTBEAT"),
        system=3,
        component=100,
    )
    station = packed(
        [flights.Received(START_US, dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))], system=255
    )
    mixed = [x for group in itertools.zip_longest(drone, camera, other) for x in group if x]
    log = tlog.read(write(path, station, mixed))
    assert [(v.system_id, v.component_id, v.kind) for v in tlog.vehicles(log)] == [
        (3, 1, "autopilot"),
        (4, 1, "autopilot"),
        (255, 1, "ground station"),
    ]
    assert positions(tlog.ins(log, 3))["t_ns"][0] == START_US * 1000 + 6_000 * MS
    with pytest.raises(tlog.LogError, match=r"2 autopilots.*3 \(autopilot.*4 \(autopilot.*255 \(ground"):
        tlog.ins(log)
    with pytest.raises(tlog.LogError, match=r"no vehicle with system id 9.*system_id"):
        tlog.ins(log, 9)


def test_raw_counts_are_no_acceleration(path):
    got = tlog.flight(tlog.read(write(path, packed(flight(unit=200.0)))))
    assert got.report["accelerometer"] is None
    assert np.isnan(got.rows["ae_mps2"]).all()


def test_height_without_datum_is_no_position(path):
    sent = list(flight(20))
    for one in sent[60:90]:
        if one.message.get_type() == "GLOBAL_POSITION_INT":
            one.message.alt = one.message.relative_alt = 60
    got = tlog.flight(tlog.read(write(path, packed(sent))))
    assert positions(got.rows)["alt_msl_m"].min() == 488.0
    assert got.report["positions_before_fix"] > 10


def test_geoid_separation_needs_a_fix_and_a_sender_that_knows():
    alt = np.full(4, 488_000)
    fix_type, ellipsoid = np.array([1, 3, 3, 3]), np.array([535_300, 0, 535_300, -9_000_000])
    separation = autopilot.geoid_separation_m(fix_type, alt, ellipsoid)
    assert separation == pytest.approx([np.nan, np.nan, 47.3, np.nan], nan_ok=True)


def test_columns_carry_stamp_sender_and_link(path):
    sent = [one._replace(receipt_us=one.receipt_us & ~3 | i % 3) for i, one in enumerate(flight(20))]
    columns = tlog.read(write(path, packed(sent, system=9, component=2))).messages("ATTITUDE")
    theirs = [(one.receipt_us, i % 256, i % 3) for i, one in enumerate(sent) if one.message.id == 30]
    assert columns[["receipt_us", "frame_seq", "link"]].tolist() == theirs
    assert {*columns["sysid"], *columns["compid"]} == {9, 2}
    assert columns["yaw"] == pytest.approx(1.57)


def test_damage_is_counted(path):
    records = packed(flight(20))
    records[100] = b"\0" * 1000 + records[100]
    flipped = bytearray(records[200])
    flipped[20] ^= 4
    records[200] = bytes(flipped)
    records[-1] = records[-1][:20]
    got = tlog.damage(tlog.read(write(path, records)))
    assert got["bytes"] == sum(map(len, records))
    assert (got["bytes_skipped"], got["bytes_after_last_frame"]) == (1020, 20)
    assert sum(got["frames_bad_crc"].values()) == 1
    assert got["frames"] == len(records) - 2


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no such file"),
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(256)) * 40, "no MAVLink frame"),
    ],
)
def test_files_that_are_no_log(path, content, says):
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(tlog.LogError, match=says) as error:
        tlog.read(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_no_position(path):
    grounded = packed(flight(20, fix_after_s=99))
    with pytest.raises(tlog.LogError, match=r"vehicle 1 never has a position \(all 200.*ATTITUDE"):
        tlog.ins(tlog.read(write(path, grounded)))
    blind = packed(x for x in flight(20) if x.message.get_type() != "GLOBAL_POSITION_INT")
    with pytest.raises(tlog.LogError, match="no GLOBAL_POSITION_INT"):
        tlog.ins(tlog.read(write(path, blind)))


@pytest.mark.parametrize(("name", "system_id"), [("plane_wind8", 2), ("copter_calm", 1)])
def test_simulated_flights_follow_their_truth(name, system_id):
    log, truth = oracle.DATA / f"{name}.tlog", oracle.DATA / f"{name}.truth.csv.gz"
    if not log.exists():
        pytest.skip(f"no {log}")
    with gzip.open(truth, "rt") as file:
        true = np.genfromtxt(file, delimiter=",", names=True)
    got = tlog.flight(tlog.read(log), system_id)
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
