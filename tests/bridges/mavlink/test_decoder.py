import numpy as np
import pytest
from pymavlink.dialects.v10 import ardupilotmega as mavlink_1
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges.mavlink.decoder import Decoder
from bridges.mavlink.flightclock import MS, S
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from gcs.contract.messages import AIR, INS, AirData, Bad, InsMeasurement, to_columns
from tests.bridges import oracle
from tests.bridges.flights import START_US, flight, packed, sent_by, write


def live(path, system_id=1):
    """What the live decoder makes of a log, message by message."""
    decoder = Decoder(system_id)
    for one in oracle.pymavlink_messages(path)[0]:
        yield from decoder.decode(one.message, one.receipt_us * 1000)
    yield from decoder.flush()


def compare(path, system_id=1):
    """(live, from the log): the same channel values, live without the first IMU samples it learns from."""
    said = (m for m in live(path, system_id) if isinstance(m, InsMeasurement))
    ours = to_columns(said, InsMeasurement)
    logged = tlog_flight.ins(tlog.read(path), system_id)
    for channel in ("lat_deg", "ae_mps2"):
        a, b = (rows[np.isfinite(rows[channel])] for rows in (ours, logged))
        a, b = (rows[np.argsort(rows["t_ns"])] for rows in (a, b))
        yield a, b[-a.size :]


@pytest.mark.slow
def test_live_and_log_give_the_same_measurements(tmp_path):
    path = write(tmp_path / "flight.tlog", packed(flight(30, delay_s=0.05)))
    for ours, logged in compare(path):
        assert ours.size > 250
        for name in INS.names:
            if name != "arrival_ns":
                assert ours[name] == pytest.approx(logged[name], abs=1e-9, nan_ok=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["codelever_16-58-51", "codelever_18-50-10"])
def test_live_and_log_agree_on_real_flights(name):
    log = oracle.DATA / f"{name}.tlog"
    if not log.exists():
        pytest.skip(f"no {log}")
    for ours, logged in compare(log):
        assert ours.size > 290
        for field in ("lat_deg", "lon_deg", "alt_msl_m", "ve_mps", "vn_mps"):
            assert np.array_equal(ours[field], logged[field], equal_nan=True)
        # These send their climb rate with the wrong sign: a live link has to find out first.
        assert np.array_equal(np.abs(ours["vu_mps"]), np.abs(logged["vu_mps"]), equal_nan=True)
        late = slice(len(ours) * 3 // 4, None)
        assert np.array_equal(ours["vu_mps"][late], logged["vu_mps"][late], equal_nan=True)
        assert np.nanmax(np.abs(ours["t_ns"] - logged["t_ns"])) < 0.5 * S  # no SYSTEM_TIME: learnt, not known


def climbing(sign):
    """A climb of 4 m/s after 10 s; ``sign(k)`` is that of its k-th climb rate, −1 where it is right."""
    climbed = 0
    for received in flight(30):
        if received.message.get_type() == "GLOBAL_POSITION_INT":
            aloft = (received.receipt_us - START_US) * 1e-6 > 15.0
            received.message.alt += 400 * climbed
            received.message.vz = 400 * sign(climbed) if aloft else 0
            climbed += aloft
        yield received


def climb_rates(received) -> np.ndarray:
    speaker, decoder = dialect.MAVLink(None, srcSystem=1, srcComponent=1), Decoder(1)
    told = [
        one
        for each in received
        for one in decoder.decode(sent_by(each.message, speaker), each.receipt_us * 1000)
    ]
    return np.array([m.vu_mps for m in told if isinstance(m, InsMeasurement) and m.vu_mps is not None])


def test_a_climb_rate_of_the_wrong_sign_is_turned_within_the_first_second_of_a_climb():
    """It was believed for two seconds, and for twenty at one position a second: 60 m of height."""
    vu = climb_rates(climbing(lambda _: 1))
    aloft = vu[np.abs(vu) > 1.0]
    assert (aloft > 0.0).tolist() == [False] * 5 + [True] * (len(aloft) - 5)


def test_a_sign_that_was_told_too_early_is_taken_back():
    vu = climb_rates(climbing(lambda k: 1 if k < 8 else -1))
    assert (vu[-50:] > 0.0).all()
    assert (vu[np.abs(vu) > 1.0] < 0.0).any()


WIND = dialect.MAVLink_wind_message(310.0, 8.0, 0.0)  # where it comes from: the north-west
WIND_COV = dialect.MAVLink_wind_cov_message(0, -5.142301, 6.128356, 0, 0, 0, 0, 0, 0)  # where it goes
NO_WIND = dialect.MAVLink_wind_cov_message(0, np.nan, np.nan, 0, 0, 0, 0, 0, 0)


def losing(how):
    """A flight that from 10 s to 20 s of 30 has no fix, no word of its receiver, or no link at all.

    ``second``: no fix of its first receiver only.
    """
    for received in flight(30):
        lost = 15 <= (received.receipt_us - START_US) * 1e-6 < 25  # boot began 5 s before
        gps = received.message.get_type() == "GPS_RAW_INT"
        if how in ("fix", "second") and lost and gps:
            received.message.fix_type = 1
        if how == "second" and gps:
            second = dialect.MAVLink_gps2_raw_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 12, 0, 0)
            yield received._replace(message=second)
        if not (lost and (how == "link" or (how == "silent" and gps))):
            yield received


@pytest.mark.parametrize(
    ("how", "reckoned_s"),
    [("fix", (15.0, 24.9)), ("silent", (18.1, 24.9)), ("link", ()), ("second", ())],
)
def test_positions_after_the_receiver_was_lost_are_marked(tmp_path, how, reckoned_s):
    path = write(tmp_path / "flight.tlog", packed(losing(how)))
    for ours, logged in compare(path):
        assert ours["dead_reckoned"].tolist() == logged["dead_reckoned"].tolist()
    got = tlog_flight.flight(tlog.read(path))
    marked = got.rows[got.rows["dead_reckoned"] > 0]
    assert np.isfinite(marked["lat_deg"]).all()
    t_s = np.sort(marked["t_ns"] - START_US * 1000) / S
    assert t_s[[0, -1]].tolist() == list(reckoned_s) if reckoned_s else not t_s.size
    assert (
        got.report["positions_dead_reckoned"] == t_s.size == (round(10 * np.ptp(t_s)) + 1 if t_s.size else 0)
    )


def test_without_a_word_of_the_receiver_nothing_is_marked(tmp_path):
    sent = (one for one in flight(30, fix_after_s=0) if one.message.get_type() != "GPS_RAW_INT")
    path = write(tmp_path / "flight.tlog", packed(sent))
    for ours, logged in compare(path):
        assert not ours["dead_reckoned"].any()
        assert not logged["dead_reckoned"].any()
        assert ours.size == logged.size > 250


def windy(*evidence, wind=WIND):
    """A flight that says how it moves through the air, later with ``evidence`` of a pitot tube."""
    for i, received in enumerate(flight(10)):
        yield received
        if received.message.get_type() == "ATTITUDE":
            yield received._replace(message=wind)
            yield received._replace(message=dialect.MAVLink_vfr_hud_message(21.5, 19.0, 90, 50, 480.0, 1.0))
            if i > 100:
                yield from (received._replace(message=message) for message in evidence)


AIRSPEED = dialect.MAVLink_airspeed_message(0, 21.5, 200, 250.0, 0)
SYS_STATUS = dialect.MAVLink_sys_status_message(0x10, 0x10, 0x10, 0, 12000, 0, 50, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize("evidence", [AIRSPEED, SYS_STATUS], ids=["AIRSPEED", "SYS_STATUS"])
def test_air_data_need_a_pitot_tube_and_are_the_same_live_and_from_a_log(tmp_path, evidence):
    path = write(tmp_path / "flight.tlog", packed(windy(evidence)))
    ours = to_columns((m for m in live(path) if isinstance(m, AirData)), AirData)
    logged = tlog_flight.flight(tlog.read(path)).air
    assert 60 < ours.size < 90
    assert ours.size == logged.size
    for name in AIR.names:
        if name != "arrival_ns":
            assert ours[name] == pytest.approx(logged[name], abs=1e-6), name
    last = logged[-1]
    assert (last["airspeed_mps"], last["alt_msl_m"], last["coordinated"]) == (21.5, 480.0, 1.0)
    assert last["yaw_deg"] == pytest.approx(np.degrees(1.57), abs=1e-4)
    assert last["own_wind_e_mps"] == pytest.approx(6.128, abs=1e-3)
    assert last["own_wind_n_mps"] == pytest.approx(-5.142, abs=1e-3)


def test_both_autopilots_tell_the_same_wind_in_their_own_way(tmp_path):
    told = []
    for wind in (WIND, WIND_COV):
        path = write(tmp_path / "flight.tlog", packed(windy(AIRSPEED, wind=wind)))
        ours = to_columns((m for m in live(path) if isinstance(m, AirData)), AirData)
        for air in (ours, tlog_flight.flight(tlog.read(path)).air):
            told += air[["own_wind_e_mps", "own_wind_n_mps"]].tolist()
    assert len(told) > 240
    assert np.array(told) == pytest.approx(np.tile(told[0], (len(told), 1)), abs=1e-5)


def test_a_wind_that_is_not_known_is_none(tmp_path):
    path = write(tmp_path / "flight.tlog", packed(windy(AIRSPEED, wind=NO_WIND)))
    said = [m for m in live(path) if isinstance(m, AirData)]
    assert {(m.own_wind_e_mps, m.own_wind_n_mps) for m in said} == {(None, None)}
    assert np.isnan(tlog_flight.flight(tlog.read(path)).air["own_wind_e_mps"]).all()


def test_without_a_pitot_tube_an_airspeed_is_a_guess(tmp_path):
    path = write(tmp_path / "flight.tlog", packed(windy()))
    assert not any(isinstance(m, AirData) for m in live(path))
    assert tlog_flight.flight(tlog.read(path)).air.size == 0


def test_clock_without_system_time_is_the_least_delay_so_far(tmp_path):
    path = tmp_path / "flight.tlog"
    write(path, packed(flight(120, system_time=False, delay_s=0.02, jitter_s=0.06, seed=1)))
    rows = to_columns(live(path), InsMeasurement)
    late = rows["t_ns"][-500:] % (100 * MS)
    assert np.abs(late - 20 * MS).max() < 5 * MS


def test_restart_starts_over(tmp_path):
    path = tmp_path / "flight.tlog"
    second = flight(10, boot_ms=4_000, start_us=START_US + 100_000_000, fix_after_s=0)
    write(path, packed(flight(60)), packed(second))
    rows = [m for m in live(path) if m.lat_deg is not None]
    assert rows[-1].t_ns == (START_US + 100_000_000) * 1000 + (4_000 + 9_900) * MS


def test_other_systems_and_damage(tmp_path):
    path = write(tmp_path / "flight.tlog", packed(flight(5), system=8))
    assert list(live(path, system_id=1)) == []
    decoder = Decoder(1, "udpin:127.0.0.1:14550")
    bad = decoder.decode(dialect.MAVLink_bad_data(b"\x01\x02", "Bad prefix"), 5)
    assert bad == [Bad(source="ins", where="udpin:127.0.0.1:14550 #1", reason="Bad prefix", raw="01 02")]


def test_one_heartbeat_of_another_component_takes_nothing_from_the_autopilot(tmp_path):
    """Damage makes a frame now and then whose checksum is right by chance; the lowest number was believed."""
    whole = packed(flight(10), component=5)
    chance = packed([x for x in flight(10) if x.message.get_type() == "HEARTBEAT"][:1], component=3)
    path = write(tmp_path / "flight.tlog", whole[:200], chance, whole[200:])
    log = tlog.read(path)
    assert [(v.system_id, v.component_id) for v in tlog.vehicles(log)] == [(1, 5)]
    said = sum(isinstance(m, InsMeasurement) for m in live(path))
    assert said == sum(isinstance(m, InsMeasurement) for m in live(write(tmp_path / "whole.tlog", whole)))


def test_a_system_time_that_no_clock_can_show_is_a_reason():
    speaker = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    decoder = Decoder(1)
    for unix_us in (2**64 - 1, 5_000_000_000_000_000):
        message = sent_by(dialect.MAVLink_system_time_message(unix_us, 1000), speaker)
        assert decoder.decode(message, START_US * 1000) == []
    bad = decoder.flush()
    assert len(bad) == 2
    assert all("after the year 2099" in one.reason for one in bad)
    assert decoder.clock.utc_ns(1000 * MS) == START_US * 1000


def test_a_mavlink_1_receiver_says_nothing_of_the_ellipsoid():
    speaker = mavlink_1.MAVLink(None, srcSystem=1, srcComponent=1)
    fix = mavlink_1.MAVLink_gps_raw_int_message(START_US, 3, 0, 0, 584_000, 100, 100, 0, 0, 12)
    assert not hasattr(fix, "alt_ellipsoid")
    decoder = Decoder(1)
    assert decoder.decode(sent_by(fix, speaker), START_US * 1000) == decoder.flush() == []
