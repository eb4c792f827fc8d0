"""Telemetry logs: what a vehicle said about itself, on the flight's own clock, and what ails the file.

log = read("flight.tlog")                 every good frame, however damaged the file
log.messages("ATTITUDE")                  all fields of one message as columns
flight(log, system_id)                    INS rows of one vehicle, with a report for summary.json
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from bridges import autopilot, flightclock, frames
from bridges.flightclock import Boot
from gcs.messages import AIR, INS, InputError

COMMON = np.dtype(
    [
        ("frame_no", "<i8"),
        ("receipt_us", "<i8"),
        ("sysid", "u1"),
        ("compid", "u1"),
        ("frame_seq", "u1"),
        ("link", "u1"),
    ]
)
_GROUND_STATION = 6  # MAV_TYPE_GCS


class LogError(InputError):
    """A log that cannot be used. The message names the file and what to do."""


class Vehicle(NamedTuple):
    """One MAVLink system in the log."""

    system_id: int
    component_id: int  # of its autopilot; of whatever sends most where it has none
    kind: str  # autopilot | ground station | other
    frames: int


class Tlog(NamedTuple):
    """A log file and its frames, in file order."""

    path: Path
    data: np.ndarray  # (bytes,) uint8
    frames: np.ndarray  # (n,) frames.FRAME, with the raw stamps
    msgid: np.ndarray  # (n,) int32, -1 where the frame is of no use: unknown, damaged, a link's copy
    receipt_us: np.ndarray  # (n,) int64, repaired
    stamps_dropped: int

    def messages(self, name: str, vehicle: Vehicle | None = None) -> np.ndarray:
        """(k,) structured: every field of message ``name``, then COMMON; link copies left out.

        Field names and units as in MAVLink; text as bytes. ``link`` is the stamp's two lowest bits, a link
        number where the recorder writes one. Of one vehicle's autopilot if given. Raises KeyError for a name
        that is not in the dialect.
        """
        msgid = frames.dialect().ids[name]
        numbers = np.flatnonzero(self.msgid == msgid)
        if vehicle:
            numbers = numbers[self.frames["sysid"][numbers] == vehicle.system_id]
            numbers = numbers[self.frames["compid"][numbers] == vehicle.component_id]
        chosen = self.frames.take(numbers)  # of records, many times faster than an index
        out = frames.payloads(self.data, chosen, msgid, COMMON)
        out["frame_no"], out["receipt_us"] = numbers, self.receipt_us[numbers]
        out["sysid"], out["compid"], out["frame_seq"] = chosen["sysid"], chosen["compid"], chosen["seq"]
        out["link"] = chosen["receipt_us"] & 3
        return out


class Flight(NamedTuple):
    """One vehicle's INS measurements."""

    vehicle: Vehicle
    boots: list[Boot]
    rows: np.ndarray  # (n,) gcs.messages.INS by arrival
    air: np.ndarray  # (m,) gcs.messages.AIR in order of time
    report: dict  # for summary.json


class _Timeline(NamedTuple):
    """Valid time of every message of one vehicle that carries its boot time."""

    frame_no: np.ndarray  # (k,) int64
    t_ns: np.ndarray  # (k,) int64 UTC
    boots: list[Boot]
    late: list[tuple[int, float]]  # per boot: receiver's clock minus the flight's, offset ns and drift

    def at(self, messages: np.ndarray) -> np.ndarray:
        """(n,) UTC ns of messages with ``time_boot_ms`` or ``time_usec``."""
        if "time_usec" not in messages.dtype.names:
            return self.t_ns[np.searchsorted(self.frame_no, messages["frame_no"])]
        time_ns = messages["time_usec"].astype(np.int64) * flightclock.US
        out = time_ns.copy()
        for boot in self.boots:
            own = _within(boot, messages["frame_no"]) & (messages["time_usec"] < autopilot.UNIX_US)
            out[own] = flightclock.to_utc(boot, time_ns[own])
        return out


def read(path: str | Path) -> Tlog:
    """The log at ``path``. Raises LogError where there is none in it."""
    path = Path(path)
    if not path.is_file():
        raise LogError(f"{path}: no such file; give the .tlog the ground station recorded")
    data = np.fromfile(path, np.uint8)
    if not data.size:
        raise LogError(f"{path}: the file is empty; copy it again from the ground station")
    found = frames.scan(data)
    useful = (found["kind"] == frames.GOOD) & ~found["duplicate"]
    if not useful.any():
        raise LogError(f"{path}: no MAVLink frame in {data.size} bytes; is this a .tlog?")
    receipt_us, dropped = flightclock.repair_stamps(found["receipt_us"])
    return Tlog(path, data, found, np.where(useful, found["msgid"], -1), receipt_us, dropped)


def vehicles(log: Tlog) -> list[Vehicle]:
    """Every system in the log, by system id."""
    beats = log.messages("HEARTBEAT")
    sender = log.frames["sysid"].astype(np.int64) << 8 | log.frames["compid"]
    count = np.bincount(sender[log.msgid >= 0], minlength=1 << 16).reshape(256, 256)
    out = []
    for system_id in np.flatnonzero(count.sum(axis=1)):
        beat = beats[beats["sysid"] == system_id]
        pilot = beat[(beat["autopilot"] != autopilot.NO_AUTOPILOT) & (beat["type"] != _GROUND_STATION)]
        kind = "autopilot" if pilot.size else "ground station" if _GROUND_STATION in beat["type"] else "other"
        component = pilot["compid"].min() if pilot.size else count[system_id].argmax()
        out.append(Vehicle(int(system_id), int(component), kind, int(count[system_id].sum())))
    return out


def choose(log: Tlog, there: list[Vehicle], system_id: int | None = None) -> Vehicle:
    """The vehicle with this system id; the only autopilot where none is given; else LogError names all."""
    wanted = [v for v in there if (v.kind == "autopilot" if system_id is None else v.system_id == system_id)]
    if len(wanted) == 1:
        return wanted[0]
    listed = ", ".join(f"{v.system_id} ({v.kind}, {v.frames} frames)" for v in there)
    what = f"no vehicle with system id {system_id}" if system_id is not None else f"{len(wanted)} autopilots"
    raise LogError(f"{log.path}: {what}; set [vehicle] system_id to one of {listed}")


def ins(log: Tlog, system_id: int | None = None) -> np.ndarray:
    """(n,) gcs.messages.INS of one vehicle, by arrival. Raises LogError as ``flight``."""
    return flight(log, system_id).rows


def flight(log: Tlog, system_id: int | None = None) -> Flight:
    """INS rows of one vehicle: GLOBAL_POSITION_INT has position and velocity, IMU and ATTITUDE acceleration.

    ``arrival_ns`` is the receipt stamp on the flight's clock: the delay beyond the smallest one of that boot.
    Raises LogError where the vehicle is not in the log or never has a position.
    """
    there = vehicles(log)
    vehicle = choose(log, there, system_id)
    timeline = _timeline(log, vehicle)
    positions, before_fix = _positions(log, vehicle, timeline)
    told = positions[0]
    upward = autopilot.vz_is_upward(told["t_ns"], told["alt_msl_m"], told["vu_mps"])
    if upward:
        told["vu_mps"] *= -1.0
    if not positions[0].size:
        raise LogError(_no_position(log, vehicle, before_fix))
    imu, accelerations = _accelerations(log, vehicle, timeline)
    rows, number = (np.concatenate(both) for both in zip(positions, accelerations, strict=True))
    rows["arrival_ns"], untrue = _arrivals(timeline, rows["t_ns"], number, log.receipt_us[number])
    rows = rows.take(np.lexsort((number, rows["arrival_ns"])))
    air = _air(log, vehicle, timeline)
    report = damage(log) | {
        "system_id": vehicle.system_id,
        "systems": {str(v.system_id): v.kind for v in there},
        "boots": [_describe(boot) for boot in timeline.boots],
        "positions": positions[0].size,
        "positions_before_fix": before_fix,
        "vz_turned_over": upward,
        "geoid_separation_known": bool(np.isfinite(rows["geoid_separation_m"]).any()),
        "accelerometer": imu,
        "accelerations": accelerations[0].size,
        "airspeeds": air.size,
        "receipts_not_believed": untrue,
    }
    return Flight(vehicle, timeline.boots, rows, air, report)


def damage(log: Tlog) -> dict:
    """What is wrong with the file, in numbers."""
    kind, size = log.frames["kind"], frames.sizes(log.data, log.frames)
    stamps = np.count_nonzero(log.frames["receipt_us"] >= 0) * frames.STAMP
    names = frames.dialect().names
    return {
        "bytes": log.data.size,
        "bytes_skipped": int(log.data.size - size.sum() - stamps),
        "bytes_after_last_frame": int(log.data.size - log.frames["offset"][-1] - size[-1]),
        "frames": int(np.count_nonzero(kind == frames.GOOD)),
        "frames_bad_crc": {names[i]: n for i, n in _counts(log, kind == frames.BAD_CRC)},
        "frames_unknown": {str(i): n for i, n in _counts(log, kind == frames.UNKNOWN)},
        "frames_duplicate": int(np.count_nonzero(log.frames["duplicate"])),
        "stamps_dropped": log.stamps_dropped,
    }


def _counts(log: Tlog, which: np.ndarray) -> list[tuple[int, int]]:
    """(message id, number) of the frames in the mask."""
    ids, numbers = np.unique(log.frames["msgid"][which], return_counts=True)
    return list(zip(ids.tolist(), numbers.tolist(), strict=True))


def _describe(boot: Boot) -> dict:
    first, last = flightclock.to_utc(boot, np.array([boot.start_ns, boot.end_ns]))
    return {
        "first_t_ns": int(first),
        "last_t_ns": int(last),
        "boot_s": [boot.start_ns / flightclock.S, boot.end_ns / flightclock.S],
        "clock": boot.source,
        "drift_ppm": boot.drift * 1e6,
    }


def _within(boot: Boot, frame_no: np.ndarray) -> np.ndarray:
    return (frame_no >= boot.first) & (frame_no < boot.stop)


def _timeline(log: Tlog, vehicle: Vehicle) -> _Timeline:
    """Boot by boot: tie boot time to UTC, then the receiver's clock to both."""
    boot_ms = frames.boot_times(
        log.data, log.frames, frames.dialect().boot_ms_at, vehicle.system_id, vehicle.component_id
    )
    number = np.flatnonzero(boot_ms >= 0)
    if not number.size:
        return _Timeline(number, number, [], [])
    starts, unwrapped_ms = flightclock.restarts(boot_ms[number], log.receipt_us[number])
    boot_ns = unwrapped_ms * flightclock.MS
    received_ns = log.receipt_us[number] * flightclock.US
    times = log.messages("SYSTEM_TIME", vehicle)
    times_ns = boot_ns[np.searchsorted(number, times["frame_no"])]
    boots, late, t_ns = [], [], np.empty_like(boot_ns)
    for i, (a, b) in enumerate(zip(starts, [*starts[1:], number.size], strict=True)):
        first, stop = (number[a] if i else 0), (number[b] if b < number.size else log.frames.size)
        within = (times["frame_no"] >= first) & (times["frame_no"] < stop)
        source, drift = "SYSTEM_TIME", 0.0
        offset_ns = flightclock.from_system_time(times["time_unix_usec"][within], times_ns[within])
        if offset_ns is None:
            source = "receipt"
            offset_ns, drift = flightclock.lower_envelope(boot_ns[a:b], received_ns[a:b])
        span = int(boot_ns[a:b].min()), int(boot_ns[a:b].max())
        boots.append(Boot(int(first), int(stop), *span, source, offset_ns, drift))
        t_ns[a:b] = flightclock.to_utc(boots[-1], boot_ns[a:b])
        late.append(flightclock.lower_envelope(t_ns[a:b], received_ns[a:b]))
    return _Timeline(number, t_ns, boots, late)


def _arrivals(timeline: _Timeline, t_ns: np.ndarray, number: np.ndarray, receipt_us: np.ndarray) -> tuple:
    """(arrival_ns (n,), receipts not believed): receipt on the flight's clock, else the valid time."""
    arrival = t_ns.copy()
    untrue = 0
    for boot, (offset, drift) in zip(timeline.boots, timeline.late, strict=True):
        own = np.flatnonzero(_within(boot, number))
        own = own[np.argsort(number[own], kind="stable")]
        delay = receipt_us[own] * flightclock.US - t_ns[own] - offset
        delay -= np.rint(drift * t_ns[own]).astype(np.int64)
        believed = (delay >= -flightclock.MAX_DELAY_NS) & (delay <= flightclock.MAX_DELAY_NS)
        untrue += int(np.count_nonzero(~believed))
        arrival[own] += np.where(believed, np.maximum(delay, 0), 0)
        arrival[own] = np.maximum.accumulate(arrival[own])
    return arrival, untrue


def _positions(log: Tlog, vehicle: Vehicle, timeline: _Timeline) -> tuple[tuple[np.ndarray, np.ndarray], int]:
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
    report, number = report.compress(valid), number[valid]
    rows = _rows(timeline.at(report))
    values = autopilot.position_velocity(*(report[name] for name in ("lat", "lon", "alt", "vx", "vy", "vz")))
    for name, value in zip(
        ("lat_deg", "lon_deg", "alt_msl_m", "ve_mps", "vn_mps", "vu_mps"), values, strict=True
    ):
        rows[name] = value
    newest = np.searchsorted(gps["frame_no"][known], number)
    rows["geoid_separation_m"] = np.concatenate([[np.nan], separation[known]])[newest]
    return (rows, number), int(np.count_nonzero(~valid))


def _newest(events: np.ndarray, frame_no: np.ndarray) -> np.ndarray:
    """(n,) frame number of the newest event before each frame, −1 where there is none."""
    return np.concatenate([[-1], events])[np.searchsorted(events, frame_no)]


def _accelerations(log: Tlog, vehicle: Vehicle, timeline: _Timeline) -> tuple[str | None, tuple]:
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


def _air(log: Tlog, vehicle: Vehicle, timeline: _Timeline) -> np.ndarray:
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
    beats, winds = log.messages("HEARTBEAT", vehicle), log.messages("WIND", vehicle)
    newest = np.searchsorted(beats["frame_no"], hud["frame_no"])
    air["coordinated"] = np.append([0], beats["type"])[newest] == autopilot.FIXED_WING
    own = autopilot.wind_en(*(winds[name].astype(float) for name in ("direction", "speed")))
    newest = np.searchsorted(winds["frame_no"], hud["frame_no"])
    for name, wind in zip(("own_wind_e_mps", "own_wind_n_mps"), own, strict=True):
        air[name] = np.append([np.nan], wind)[newest]
    return air.take(np.argsort(air["t_ns"], kind="stable"))


def _columns(messages: np.ndarray, *names: str) -> np.ndarray:
    """(n, 3) float64 of three fields."""
    return np.stack([messages[name].astype(float) for name in names], axis=-1)


def _rows(t_ns: np.ndarray) -> np.ndarray:
    """(n,) INS with nothing known but the time."""
    rows = np.empty(t_ns.size, INS)
    for name in INS.names:
        rows[name] = t_ns if INS[name] == np.int64 else np.nan
    return rows


def _no_position(log: Tlog, vehicle: Vehicle, before_fix: int) -> str:
    own = (log.frames["sysid"] == vehicle.system_id) & (log.frames["compid"] == vehicle.component_id)
    names = frames.dialect().names
    has = ", ".join(sorted(names[i] for i in np.unique(log.msgid[own & (log.msgid >= 0)])))
    why = f"all {before_fix} are from before a GPS fix" if before_fix else "no GLOBAL_POSITION_INT from it"
    others = ", ".join(f"{v.system_id} ({v.kind})" for v in vehicles(log) if v != vehicle)
    return (
        f"{log.path}: vehicle {vehicle.system_id} never has a position ({why}); it sends {has}; "
        f"other systems: {others or 'none'}; choose another log or set [vehicle] system_id"
    )
