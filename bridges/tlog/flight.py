"""What one vehicle in a log measured, on the flight's own clock.

flight(read("flight.tlog"), system_id)    INS rows and air data, with a report for summary.json
"""

from typing import NamedTuple

import numpy as np

from bridges.mavlink import autopilot, flightclock
from bridges.mavlink.flightclock import Boot
from bridges.tlog import clock, scan
from bridges.tlog.clock import Timeline
from bridges.tlog.tlog import LogError, Tlog, Vehicle, choose, damage, vehicles
from gcs.contract.messages import AIR, INS


class Flight(NamedTuple):
    """One vehicle's INS measurements."""

    vehicle: Vehicle
    boots: list[Boot]
    rows: np.ndarray  # (n,) gcs.contract.messages.INS by arrival
    air: np.ndarray  # (m,) gcs.contract.messages.AIR in order of time
    report: dict  # for summary.json


def ins(log: Tlog, system_id: int | None = None) -> np.ndarray:
    """(n,) gcs.contract.messages.INS of one vehicle, by arrival. Raises LogError as ``flight``."""
    return flight(log, system_id).rows


def flight(log: Tlog, system_id: int | None = None) -> Flight:
    """INS rows of one vehicle: GLOBAL_POSITION_INT has position and velocity, IMU and ATTITUDE acceleration.

    ``arrival_ns`` is the receipt stamp on the flight's clock: the delay beyond the smallest one of that boot.
    Raises LogError where the vehicle is not in the log or never has a position.
    """
    there = vehicles(log)
    vehicle = choose(log, there, system_id)
    log, others = clock.one_vehicle(log, vehicle)
    timeline = clock.timeline(log, vehicle)
    positions, before_fix = _positions(log, vehicle, timeline)
    told = positions[0]
    upward = autopilot.vz_is_upward(told["t_ns"], told["alt_msl_m"], told["vu_mps"])
    if upward:
        told["vu_mps"] *= -1.0
    if not positions[0].size:
        raise LogError(_no_position(log, vehicle, before_fix))
    imu, accelerations = _accelerations(log, vehicle, timeline)
    rows, number = (np.concatenate(both) for both in zip(positions, accelerations, strict=True))
    rows["arrival_ns"], untrue = timeline.arrivals(rows["t_ns"], number, log.receipt_us[number])
    rows = rows.take(np.lexsort((number, rows["arrival_ns"])))
    air = _air(log, vehicle, timeline)
    report = damage(log) | {
        "system_id": vehicle.system_id,
        "messages_of_another_with_its_id": others,
        "systems": {str(v.system_id): v.kind for v in there},
        "boots": [clock.describe(boot) for boot in timeline.boots],
        "positions": positions[0].size,
        "positions_before_fix": before_fix,
        "positions_dead_reckoned": int(np.count_nonzero(told["dead_reckoned"])),
        "vz_turned_over": upward,
        "geoid_separation_known": bool(np.isfinite(rows["geoid_separation_m"]).any()),
        "accelerometer": imu,
        "accelerations": accelerations[0].size,
        "airspeeds": air.size,
        "receipts_not_believed": untrue,
    }
    return Flight(vehicle, timeline.boots, rows, air, report)


def _positions(log: Tlog, vehicle: Vehicle, timeline: Timeline) -> tuple[tuple[np.ndarray, np.ndarray], int]:
    """((INS rows, frame numbers), how many reports came before there was a position)."""
    report = log.messages("GLOBAL_POSITION_INT", vehicle)
    gps = log.messages("GPS_RAW_INT", vehicle)
    number = report["frame_no"]
    boot_first = np.array([boot.first for boot in timeline.boots], np.int64)
    since = boot_first[np.searchsorted(boot_first, number, "right") - 1]
    fix = gps[gps["fix_type"] >= autopilot.FIX_3D]
    silent = _newest(gps["frame_no"], number) < since
    fixed = silent | (_newest(fix["frame_no"], number) >= since)
    gps_alt = np.concatenate([[np.nan], fix["alt"]])[np.searchsorted(fix["frame_no"], number)]
    valid = fixed & autopilot.has_position(
        report["lat"], report["lon"], report["alt"], report["relative_alt"], gps_alt
    )
    separation = autopilot.geoid_separation_m(gps["fix_type"], gps["alt"], gps["alt_ellipsoid"])
    known = np.isfinite(separation)
    reckoned = _dead_reckoned(log, vehicle, report, since)[valid]
    report, number = report.compress(valid), number[valid]
    rows = _rows(timeline.at(report))
    values = autopilot.position_velocity(*(report[name] for name in ("lat", "lon", "alt", "vx", "vy", "vz")))
    for name, value in zip(
        ("lat_deg", "lon_deg", "alt_msl_m", "ve_mps", "vn_mps", "vu_mps"), values, strict=True
    ):
        rows[name] = value
    rows["dead_reckoned"] = reckoned
    newest = np.searchsorted(gps["frame_no"][known], number)
    rows["geoid_separation_m"] = np.concatenate([[np.nan], separation[known]])[newest]
    return (rows, number), int(np.count_nonzero(~valid))


def _dead_reckoned(log: Tlog, vehicle: Vehicle, report: np.ndarray, since: np.ndarray) -> np.ndarray:
    """(n,) bool: of all receivers heard since frame ``since`` (n,), none has a fix for this position."""
    boot_ms = report["time_boot_ms"].astype(np.int64)
    heard, fixed = np.zeros((2, report.size), bool)
    for name in autopilot.RECEIVERS:
        gps = log.messages(name, vehicle)
        count = np.searchsorted(gps["frame_no"], report["frame_no"])
        first = np.searchsorted(count, count)  # report after the receiver's newest word
        previous = np.maximum(np.arange(report.size) - 1, first)
        lost = autopilot.is_lost(np.append([0], gps["fix_type"])[count], boot_ms[previous] - boot_ms[first])
        spoken = _newest(gps["frame_no"], report["frame_no"]) >= since
        heard |= spoken
        fixed |= spoken & ~lost
    return heard & ~fixed


def _newest(events: np.ndarray, frame_no: np.ndarray) -> np.ndarray:
    """(n,) frame number of the newest event before each frame, −1 where there is none."""
    return np.concatenate([[-1], events])[np.searchsorted(events, frame_no)]


def _accelerations(log: Tlog, vehicle: Vehicle, timeline: Timeline) -> tuple[str | None, tuple]:
    """(IMU message, (INS rows, frame numbers)): one row per IMU message with a fresh ATTITUDE before it."""
    attitude = log.messages("ATTITUDE", vehicle)
    attitude_ns = timeline.at(attitude)
    for name, unit in autopilot.IMUS.items():
        imu = log.messages(name, vehicle)
        force = _columns(imu, "xacc", "yacc", "zacc") * unit
        if autopilot.is_accelerometer(force) and attitude.size:
            break
    else:
        return None, (_rows(np.empty(0, np.int64)), np.empty(0, np.int64))
    t_ns = timeline.at(imu)
    before = np.searchsorted(attitude["frame_no"], imu["frame_no"]) - 1
    age_ns = t_ns - attitude_ns[before]
    fresh = (before >= 0) & (np.abs(age_ns) <= autopilot.ATTITUDE_AGE_NS)
    used = attitude.take(before[fresh])
    rows = _rows(t_ns[fresh])
    rows["ae_mps2"], rows["an_mps2"], rows["au_mps2"] = autopilot.acceleration_enu(
        force[fresh],
        _columns(used, "roll", "pitch", "yaw"),
        _columns(used, "rollspeed", "pitchspeed", "yawspeed"),
        age_ns[fresh] / flightclock.S,
    ).T
    return name, (rows, imu["frame_no"][fresh])


def _air(log: Tlog, vehicle: Vehicle, timeline: Timeline) -> np.ndarray:
    """(m,) AIR: a VFR_HUD at the time of the ATTITUDE before it, from where a pitot tube is known of."""
    hud, attitude = log.messages("VFR_HUD", vehicle), log.messages("ATTITUDE", vehicle)
    status = log.messages("SYS_STATUS", vehicle)
    fitted = status["onboard_control_sensors_present"] & autopilot.DIFFERENTIAL_PRESSURE > 0
    told = np.append(status["frame_no"][fitted], log.messages("AIRSPEED", vehicle)["frame_no"])
    since = max(told.min(initial=log.frames.size), attitude["frame_no"].min(initial=log.frames.size))
    hud = hud.compress(hud["frame_no"] > since)
    used = attitude.take(np.searchsorted(attitude["frame_no"], hud["frame_no"]) - 1)
    air = np.zeros(hud.size, AIR)
    air["t_ns"] = air["arrival_ns"] = timeline.at(used)
    air["airspeed_mps"], air["alt_msl_m"] = hud["airspeed"], hud["alt"]
    for name in ("roll", "pitch", "yaw"):
        air[f"{name}_deg"] = np.degrees(used[name].astype(float))
    beats = log.messages("HEARTBEAT", vehicle)
    newest = np.searchsorted(beats["frame_no"], hud["frame_no"])
    air["coordinated"] = np.append([0], beats["type"])[newest] == autopilot.FIXED_WING
    number, own = _own_wind(log, vehicle)
    newest = np.searchsorted(number, hud["frame_no"])
    for name, wind in zip(("own_wind_e_mps", "own_wind_n_mps"), own, strict=True):
        air[name] = np.append([np.nan], wind)[newest]
    return air.take(np.argsort(air["t_ns"], kind="stable"))


def _own_wind(log: Tlog, vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray]:
    """(frame numbers (k,), east and north m/s (2, k)) of the autopilot's own estimate."""
    wind, cov = log.messages("WIND", vehicle), log.messages("WIND_COV", vehicle)
    number = np.concatenate([wind["frame_no"], cov["frame_no"]])
    own = np.hstack(
        [
            autopilot.wind_en(wind["direction"].astype(float), wind["speed"].astype(float)),
            autopilot.wind_cov_en(cov["wind_x"].astype(float), cov["wind_y"].astype(float)),
        ]
    )
    order = np.argsort(number)
    return number[order], own[:, order]


def _columns(messages: np.ndarray, *names: str) -> np.ndarray:
    """(n, 3) float64 of three fields."""
    return np.stack([messages[name].astype(float) for name in names], axis=-1)


def _rows(t_ns: np.ndarray) -> np.ndarray:
    """(n,) INS with nothing known but the time."""
    rows = np.empty(t_ns.size, INS)
    for name in INS.fields or ():
        rows[name] = t_ns if INS[name] == np.int64 else np.nan
    rows["dead_reckoned"] = False
    return rows


def _no_position(log: Tlog, vehicle: Vehicle, before_fix: int) -> str:
    own = (log.frames["sysid"] == vehicle.system_id) & (log.frames["compid"] == vehicle.component_id)
    names = scan.dialect().names
    has = ", ".join(sorted(names[i] for i in np.unique(log.msgid[own & (log.msgid >= 0)])))
    why = f"all {before_fix} are from before a GPS fix" if before_fix else "no GLOBAL_POSITION_INT from it"
    others = ", ".join(f"{v.system_id} ({v.kind})" for v in vehicles(log) if v != vehicle)
    return (
        f"{log.path}: vehicle {vehicle.system_id} never has a position ({why}); it sends {has}; "
        f"other systems: {others or 'none'}; choose another log or set [vehicle] system_id"
    )
