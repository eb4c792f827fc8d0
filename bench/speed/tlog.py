"""The log reader against pymavlink: speed, and damaged logs by the thousand.

    python -m bench tlog [FLIGHT.tlog ...]
    python -m bench fuzz [--seeds N]

tlog runs, in turns, in one process, five times each, and takes medians:
    all     pymavlink ``recv_match()`` to the end, every message decoded; ours: ``read`` and every column of
            every message.
    rows    the same pymavlink run; ours: ``read`` and ``flight``: the INS rows with clock and damage report.
    typed   pymavlink ``recv_match(type=...)`` of the messages the INS rows need (it skips the others unread,
            their checksum too), fields read into lists; ours as in rows.
fuzz damages a piece of every log with every seed and wants each message pymavlink finds, equal in all fields.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from pymavlink import mavutil

from bridges.tlog import flight as tlog_flight
from bridges.tlog import scan, tlog
from tests.bridges import oracle

ROUNDS = 5
NEEDED = {
    "HEARTBEAT": ("type", "autopilot"),
    "SYSTEM_TIME": ("time_unix_usec", "time_boot_ms"),
    "GPS_RAW_INT": ("fix_type", "alt", "alt_ellipsoid"),
    "GLOBAL_POSITION_INT": ("time_boot_ms", "lat", "lon", "alt", "vx", "vy", "vz"),
    "ATTITUDE": ("time_boot_ms", "roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"),
    "RAW_IMU": ("time_usec", "xacc", "yacc", "zacc"),
}


def pymavlink_all(path: Path) -> int:
    log, count = mavutil.mavlink_connection(str(path)), 0
    while log.recv_match() is not None:
        count += 1
    return count


def pymavlink_typed(path: Path) -> int:
    log = mavutil.mavlink_connection(str(path))
    lists = {name: [] for name in NEEDED}
    while (message := log.recv_match(type=list(NEEDED))) is not None:
        name = message.get_type()
        lists[name].append((message._timestamp, *(getattr(message, field) for field in NEEDED[name])))
    return sum(map(len, lists.values()))


def our_all(path: Path) -> int:
    log = tlog.read(path)
    names = scan.dialect().names
    return sum(log.messages(names[i]).size for i in np.unique(log.msgid[log.msgid >= 0]))


def our_rows(path: Path) -> int:
    return tlog_flight.flight(tlog.read(path)).rows.size


def speed(paths: list[Path]) -> None:
    for path in paths:
        jobs = [pymavlink_all, pymavlink_typed, our_all, our_rows]
        times: dict[Callable, list[float]] = {job: [] for job in jobs}
        counts = {job: job(path) for job in jobs}  # once unmeasured: compiles, fills the file cache
        for _ in range(ROUNDS):
            for job in jobs:
                start = time.perf_counter()
                job(path)
                times[job].append(time.perf_counter() - start)
        seconds = {job: median(taken) for job, taken in times.items()}
        print(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
        for job in jobs:
            print(f"  {job.__name__:16s} {seconds[job] * 1e3:8.1f} ms   {counts[job]} messages or rows")
        pairs = {"all": (pymavlink_all, our_all), "rows": (pymavlink_all, our_rows)}
        for name, (theirs, ours) in (pairs | {"typed": (pymavlink_typed, our_rows)}).items():
            ratios = sorted(a / b for a, b in zip(times[theirs], times[ours], strict=True))
            print(f"  {name:6s} {median(ratios):6.1f} times   ({ratios[0]:.1f} … {ratios[-1]:.1f})")


def fuzz(seeds: int) -> int:
    totals = {"pieces": 0, "pymavlink": 0, "ours": 0, "missing": 0, "different": 0, "glued": 0}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.tlog"
        for log in oracle.LOGS:
            data = log.read_bytes()
            for seed in range(seeds):
                path.write_bytes(oracle.damaged(data, seed))
                seen, glued = oracle.pymavlink_messages(path)
                read = tlog.read(path)
                tlog.damage(read)
                lost = oracle.missing(seen, read.frames)
                different = oracle.differences(seen, read.data, read.frames)
                for problem in [*lost, *different]:
                    print(f"{log.name} seed {seed}: {problem}")
                totals["pieces"] += 1
                totals["pymavlink"] += len(seen)
                totals["ours"] += int((read.frames["kind"] == scan.GOOD).sum())
                totals["missing"] += len(lost)
                totals["different"] += len(different)
                totals["glued"] += glued
            print(log.name, totals, flush=True)
    return bool(totals["missing"] or totals["different"])
