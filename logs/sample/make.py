"""Cut the sample flight out of the recording it comes from: ``make.py FLIGHT.tlog TRUTH.csv.gz``.

Whole stamped frames are copied as they are, of the message types that a fusion reads; the simulator's own
truth (SIM_STATE, SIMSTATE) stays out. The feeds are then made from ``truth.csv`` and ``station.toml`` alone.
"""

import sys
from pathlib import Path

import numpy as np

from bridges import simulated
from bridges.tlog import scan, tlog

HERE = Path(__file__).parent
BOOT_S = (25.0, 173.0)  # take-off, climb, five turns of 50° to 65° bank
KEEP = [
    *("HEARTBEAT", "SYSTEM_TIME", "GLOBAL_POSITION_INT", "GPS_RAW_INT", "ATTITUDE", "RAW_IMU", "VFR_HUD"),
    *("WIND", "LOCAL_POSITION_NED", "AIRSPEED", "STATUSTEXT"),
]
SEED = 7


def main(flight: Path, truth: Path) -> None:
    log = tlog.read(flight)
    offset_ns = simulated.boot_to_utc_ns(flight)
    first_ns, last_ns = (offset_ns + round(s * 1e9) for s in BOOT_S)

    times = log.messages("SYSTEM_TIME")
    inside = np.flatnonzero(
        (times["time_boot_ms"] >= BOOT_S[0] * 1e3) & (times["time_boot_ms"] < BOOT_S[1] * 1e3)
    )
    cut = np.arange(times["frame_no"][inside[0]], times["frame_no"][inside[-1]] + 1)
    cut = cut[np.isin(log.msgid[cut], [scan.dialect().ids[name] for name in KEEP])]
    starts, data = log.frames["offset"] - scan.STAMP, log.data.tobytes()
    stamped = (data[starts[k] : starts[k + 1]] for k in cut.tolist())
    (HERE / "flight.tlog").write_bytes(b"".join(stamped))

    track = simulated.read_truth(truth, offset_ns)
    track = track[(track["t_ns"] >= first_ns) & (track["t_ns"] < last_ns)]
    lines = ["t_ns,lat_deg,lon_deg,alt_m"]
    lines += [f"{t},{lat:.7f},{lon:.7f},{alt:.3f}" for t, lat, lon, alt in track.tolist()]
    (HERE / "truth.csv").write_text("\n".join(lines) + "\n")

    instruments = simulated.crooked(simulated.instruments_of(HERE / "station.toml"), SEED)
    whole = simulated.read_truth(HERE / "truth.csv")
    simulated.write_all(HERE, whole, instruments, SEED, simulated.OUTLIER_SHARE)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
