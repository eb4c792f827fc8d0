"""Made-up flights, written with pymavlink's encoder: a known track, clock and link, into a log of bytes."""

import random
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from bridges.tlog import tlog

LAT, LON, ALT_MM, GEOID_MM = 473977420, 85455940, 488_000, 47_300
FIX_TYPE_AT = 28  # in the payload of GPS_RAW_INT
START_US = 1_700_000_000_000_000  # UTC of boot


class Received(NamedTuple):
    """One message as the ground station got it."""

    receipt_us: int
    message: object


def flight(
    seconds: float = 20.0,
    *,
    start_us: int = START_US,
    boot_ms: int = 5_000,
    system_time: bool = True,
    fix_after_s: float = 1.0,
    delay_s: float = 0.0,
    jitter_s: float = 0.0,
    drift: float = 0.0,
    unit: float = 1000 / 9.80665,
    seed: int = 0,
) -> Iterator[Received]:
    """Flying east at 20 m/s, ten reports a second. ``start_us``: UTC of boot; ``unit``: RAW_IMU per m/s²."""
    rng = random.Random(seed)
    for i in range(int(seconds * 10)):
        ms = (boot_ms + 100 * i) % (1 << 32)
        sent_us = start_us + round((boot_ms + 100 * i) * 1000 * (1 + drift))
        fixed = i >= fix_after_s * 10
        unix_us = sent_us if system_time and fixed else 0
        lat, lon, alt = (LAT, LON + 265 * i, ALT_MM) if fixed else (3, -2, 0)
        messages = [
            dialect.MAVLink_system_time_message(unix_us, ms),
            dialect.MAVLink_gps_raw_int_message(
                (boot_ms + 100 * i) * 1000, 3 if fixed else 1, lat, lon, alt, 90, 90, 2000, 9000, 12,
                alt_ellipsoid=alt + GEOID_MM if fixed else 0,
            ),
            dialect.MAVLink_global_position_int_message(ms, lat, lon, alt, 30_000, 5, 2000, -150, 9000),
            dialect.MAVLink_attitude_message(ms, 0.1, 0.02, 1.57, 0.0, 0.0, 0.05),
            dialect.MAVLink_raw_imu_message(
                (boot_ms + 100 * i) * 1000 + 7, 0, round(0.5 * unit), round(-9.8 * unit), 0, 0, 0, 0, 0, 0
            ),
        ]  # fmt: skip
        if i % 10 == 0:
            messages.append(dialect.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
        for message in messages:
            late_us = 1e6 * (delay_s + (rng.expovariate(1 / jitter_s) if jitter_s else 0.0))
            yield Received(sent_us + round(late_us), message)


def packed(received, system: int = 1, component: int = 1, version: int = 2) -> list[bytes]:
    """tlog records, one per message."""
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    records = []
    for receipt_us, message in received:
        records.append(receipt_us.to_bytes(8, "big") + message.pack(mav, force_mavlink1=version == 1))
        mav.seq = (mav.seq + 1) % 256
    return records


def sent_by(message, speaker):
    """A message as it comes out of a link: with the header of the vehicle that sent it."""
    message.pack(speaker)
    return message


def write(path, *records: list[bytes]):
    """A tlog of all records, one list behind the other."""
    path.write_bytes(b"".join(record for part in records for record in part))
    return path


def without_fix(log: tlog.Tlog, begin_s: float, end_s: float) -> bytes:
    """The file of ``log`` with GPS_RAW_INT saying between two receipt times since its start: no fix."""
    data, gps = bytearray(log.data.tobytes()), dialect.MAVLink_gps_raw_int_message
    since_s = (log.receipt_us - log.receipt_us[0]) * 1e-6
    for frame in log.frames[(log.msgid == gps.id) & (since_s >= begin_s) & (since_s < end_s)]:
        start, length = int(frame["offset"]), int(frame["length"])
        payload = start + (10 if frame["version"] == 2 else 6)
        data[payload + FIX_TYPE_AT] = dialect.GPS_FIX_TYPE_NO_FIX
        checked = x25crc(data[start + 1 : payload + length] + bytes([gps.crc_extra]))
        data[payload + length : payload + length + 2] = checked.crc.to_bytes(2, "little")
    return bytes(data)


def positions(rows: np.ndarray) -> np.ndarray:
    """Those of (n,) INS that have one."""
    return rows[np.isfinite(rows["lat_deg"])]
