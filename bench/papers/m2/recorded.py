"""The wind of a recorded flight: a fixed wing in the simulator's 8 m/s from 310°."""

from pathlib import Path

import numpy as np

from bench.papers.m2 import wind
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog

LOG, TRUTH = "plane_wind8.tlog", "plane_wind8.truth.csv.gz"
SPEED_MPS, FROM_DEG = 8.0, 310.0  # what the simulator was told


def measure(folder: Path | None) -> dict | None:
    """Medians above `wind.FLYING_M` of ours and of the autopilot's own; dead reckoning over lost minutes.

    None without a ``folder``, or where it does not hold the recording. Errors are at the end of each lost
    minute.
    """
    if folder is None or not (folder / LOG).exists() or not (folder / TRUTH).exists():
        return None
    air = wind.flight(folder / LOG, folder / TRUTH)
    known = [
        (w.speed_mps, w.from_deg)
        for w, height_m in zip(wind.follow(air), air.height_m, strict=True)
        if w.observable and height_m > wind.FLYING_M
    ]
    lost = wind.losses(air)
    with_wind, without = (
        np.array([getattr(one, f"{how}_wind_m") for one in lost]) for how in ("with", "without")
    )
    return {
        "ours": np.median(known, axis=0).tolist(),
        "autopilot": _own(folder / LOG, air),
        "losses": len(lost),
        "with_wind_m": float(np.median(with_wind)),
        "without_wind_m": float(np.median(without)),
        "worst_ratio": float((with_wind / without).max()),
    }


def _own(log_path: Path, air: wind.AirSamples) -> list[float]:
    """Median (speed m/s, from deg) that the autopilot's WIND messages say in the same part of the flight.

    WIND has no time of its own: that of the ATTITUDE before it.
    """
    log = tlog.read(log_path)
    vehicle = tlog_flight.flight(log).vehicle
    said, attitude = log.messages("WIND", vehicle), log.messages("ATTITUDE", vehicle)
    before = np.maximum(np.searchsorted(attitude["frame_no"], said["frame_no"]) - 1, 0)
    t_ns = attitude["time_boot_ms"][before].astype(np.int64) * 1_000_000
    flying = np.interp(t_ns, air.t_ns, air.height_m) > wind.FLYING_M
    return [float(np.median(said["speed"][flying])), float(np.median(said["direction"][flying] % 360.0))]
