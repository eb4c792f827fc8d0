"""When the messages of a log were valid, and when they arrived: on the flight's own clock, boot by boot."""

from typing import NamedTuple

import numpy as np

from bridges.mavlink import autopilot, flightclock
from bridges.mavlink.flightclock import Boot
from bridges.tlog import scan
from bridges.tlog.tlog import Tlog, Vehicle


class Timeline(NamedTuple):
    """Valid time of every message of one vehicle that carries its boot time."""

    frame_no: np.ndarray  # (k,) int64
    t_ns: np.ndarray  # (k,) int64 UTC
    boots: list[Boot]
    late: list[tuple[int, float]]  # per boot: receiver's clock minus the flight's, offset ns and drift

    def at(self, messages: np.ndarray) -> np.ndarray:
        """(n,) UTC ns of messages with ``time_boot_ms`` or ``time_usec``."""
        if "time_usec" not in (messages.dtype.names or ()):
            return self.t_ns[np.searchsorted(self.frame_no, messages["frame_no"])]
        time_ns = messages["time_usec"].astype(np.int64) * flightclock.US
        out = time_ns.copy()
        for boot in self.boots:
            own = _within(boot, messages["frame_no"]) & (messages["time_usec"] < autopilot.UNIX_US)
            out[own] = flightclock.to_utc(boot, time_ns[own])
        return out

    def arrivals(
        self, t_ns: np.ndarray, number: np.ndarray, receipt_us: np.ndarray
    ) -> tuple[np.ndarray, int]:
        """((n,) arrival ns, receipts not believed): receipt on the flight's clock, else the valid time."""
        arrival = t_ns.copy()
        untrue = 0
        for boot, (offset, drift) in zip(self.boots, self.late, strict=True):
            own = np.flatnonzero(_within(boot, number))
            own = own[np.argsort(number[own], kind="stable")]
            delay = receipt_us[own] * flightclock.US - t_ns[own] - offset
            delay -= np.rint(drift * t_ns[own]).astype(np.int64)
            believed = (delay >= -flightclock.MAX_DELAY_NS) & (delay <= flightclock.MAX_DELAY_NS)
            untrue += int(np.count_nonzero(~believed))
            arrival[own] += np.where(believed, np.maximum(delay, 0), 0)
            arrival[own] = np.maximum.accumulate(arrival[own])
        return arrival, untrue


def _within(boot: Boot, frame_no: np.ndarray) -> np.ndarray:
    return (frame_no >= boot.first) & (frame_no < boot.stop)


def one_vehicle(log: Tlog, vehicle: Vehicle) -> tuple[Tlog, int]:
    """The log without the messages of a second vehicle with the same system id, and how many those are."""
    boot_ms = scan.boot_times(
        log.data, log.frames, scan.dialect().boot_ms_at, vehicle.system_id, vehicle.component_id
    )
    number = np.flatnonzero(boot_ms >= 0)
    if not number.size:
        return log, 0
    others = number[flightclock.interleaved(boot_ms[number], log.receipt_us[number])]
    frames, msgid = log.frames.copy(), log.msgid.copy()
    frames["sysid"][others], msgid[others] = 0, -1
    return log._replace(frames=frames, msgid=msgid), others.size


def timeline(log: Tlog, vehicle: Vehicle) -> Timeline:
    """Boot by boot: tie boot time to UTC, then the receiver's clock to both."""
    boot_ms = scan.boot_times(
        log.data, log.frames, scan.dialect().boot_ms_at, vehicle.system_id, vehicle.component_id
    )
    number = np.flatnonzero(boot_ms >= 0)
    if not number.size:
        return Timeline(number, number, [], [])
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
        told = times["time_unix_usec"], times_ns, times["receipt_us"] * flightclock.US
        offset_ns, jumps = flightclock.from_system_time(*(column[within] for column in told))
        if offset_ns is None:
            source = "receipt"
            offset_ns, drift = flightclock.lower_envelope(boot_ns[a:b], received_ns[a:b])
        span = int(boot_ns[a:b].min()), int(boot_ns[a:b].max())
        boots.append(Boot(int(first), int(stop), *span, source, offset_ns, drift, jumps))
        t_ns[a:b] = flightclock.to_utc(boots[-1], boot_ns[a:b])
        late.append(flightclock.lower_envelope(t_ns[a:b], received_ns[a:b]))
    return Timeline(number, t_ns, boots, late)


def describe(boot: Boot) -> dict:
    """A boot for the summary."""
    first, last = flightclock.to_utc(boot, np.array([boot.start_ns, boot.end_ns]))
    return {
        "first_t_ns": int(first),
        "last_t_ns": int(last),
        "boot_s": [boot.start_ns / flightclock.S, boot.end_ns / flightclock.S],
        "clock": boot.source,
        "drift_ppm": boot.drift * 1e6,
        "system_times_contradicting": boot.jumps,
    }
