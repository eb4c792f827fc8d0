"""Telemetry logs: every good frame of a file, however damaged it is, and what ails it.

log = read("flight.tlog")
log.messages("ATTITUDE")                  all fields of one message as columns
vehicles(log)                             who speaks in it
"""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bridges.mavlink import autopilot, flightclock
from bridges.tlog import scan
from gcs.contract.messages import InputError

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
    frames: np.ndarray  # (n,) scan.FRAME, with the raw stamps
    msgid: np.ndarray  # (n,) int32, -1 where the frame is of no use: unknown, damaged, a link's copy
    receipt_us: np.ndarray  # (n,) int64, repaired
    stamps_dropped: int

    def messages(self, name: str, vehicle: Vehicle | None = None) -> np.ndarray:
        """(k,) structured: every field of message ``name``, then COMMON; link copies left out.

        Field names and units as in MAVLink; text as bytes. ``link`` is the stamp's two lowest bits, a link
        number where the recorder writes one. Of one vehicle's autopilot if given. Raises KeyError for a name
        that is not in the dialect.
        """
        msgid = scan.dialect().ids[name]
        numbers = np.flatnonzero(self.msgid == msgid)
        if vehicle:
            numbers = numbers[self.frames["sysid"][numbers] == vehicle.system_id]
            numbers = numbers[self.frames["compid"][numbers] == vehicle.component_id]
        chosen = self.frames.take(numbers)  # of records, many times faster than an index
        out = scan.payloads(self.data, chosen, msgid, COMMON)
        out["frame_no"], out["receipt_us"] = numbers, self.receipt_us[numbers]
        out["sysid"], out["compid"], out["frame_seq"] = chosen["sysid"], chosen["compid"], chosen["seq"]
        out["link"] = chosen["receipt_us"] & 3
        return out


def read(path: str | Path) -> Tlog:
    """The log at ``path``. Raises LogError where there is none in it."""
    path = Path(path)
    if not os.path.isfile(path):  # also where no file can have such a name
        raise LogError(f"{path}: no such file; give the .tlog the ground station recorded")
    data = np.fromfile(path, np.uint8)
    if not data.size:
        raise LogError(f"{path}: the file is empty; copy it again from the ground station")
    found = scan.scan(data)
    useful = (found["kind"] == scan.GOOD) & ~found["duplicate"]
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
        # By number: damage makes a frame now and then whose checksum is right by chance.
        component = np.bincount(pilot["compid"]).argmax() if pilot.size else count[system_id].argmax()
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


def damage(log: Tlog) -> dict:
    """What is wrong with the file, in numbers."""
    kind, size = log.frames["kind"], scan.sizes(log.data, log.frames)
    stamps = np.count_nonzero(log.frames["receipt_us"] >= 0) * scan.STAMP
    names = scan.dialect().names
    return {
        "bytes": log.data.size,
        "bytes_skipped": int(log.data.size - size.sum() - stamps),
        "bytes_after_last_frame": int(log.data.size - log.frames["offset"][-1] - size[-1]),
        "frames": int(np.count_nonzero(kind == scan.GOOD)),
        "frames_bad_crc": {names[i]: n for i, n in _counts(log, kind == scan.BAD_CRC)},
        "frames_unknown": {str(i): n for i, n in _counts(log, kind == scan.UNKNOWN)},
        "frames_duplicate": int(np.count_nonzero(log.frames["duplicate"])),
        "stamps_dropped": log.stamps_dropped,
    }


def _counts(log: Tlog, which: np.ndarray) -> list[tuple[int, int]]:
    """(message id, number) of the frames in the mask."""
    ids, numbers = np.unique(log.frames["msgid"][which], return_counts=True)
    return list(zip(ids.tolist(), numbers.tolist(), strict=True))
