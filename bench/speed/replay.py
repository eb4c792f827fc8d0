"""The main job measured on a whole recorded flight: speed, sameness, and accuracy beside filterpy.

    python -m bench replay FLIGHT.tlog TRUTH.csv.gz
    python -m bench replay FLIGHT.tlog TRUTH.csv.gz --against-filterpy

Feeds are simulated from the truth around the sample's station. By default the real command runs three times
after a warm-up and compares the files bit by bit. ``--against-filterpy`` replays clean feeds, and lets
``--method filterpy-ukf`` work on the same rows.
"""

import hashlib
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from bridges import simulated
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from filters import methods
from gcs.contract import config
from gcs.outputs.record import Record
from gcs.station.session import Session
from gcs.station.sources import replay

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample"
NAMES = ("theo-north", "theo-east", "radar-1")
FILES = ("track.csv", "smoothed.csv", "verdicts.csv", "separation.csv", "summary.json")
SEED = 11
RUNS = 3
SETTLED_S = 5.0  # errors are counted from here on: the start is a fix, not yet a filter


def make_feeds(log: Path, truth: Path, folder: Path, *, clean: bool) -> dict[str, Path]:
    """Three feeds for a whole flight."""
    instruments = simulated.instruments_of(SAMPLE / "station.toml")
    share = 0.0 if clean else simulated.OUTLIER_SHARE
    if not clean:
        instruments = simulated.crooked(instruments, SEED)
    track = simulated.read_truth(truth, simulated.boot_to_utc_ns(log))
    simulated.write_all(folder, track, instruments, SEED, share)
    return {name: folder / f"{name}.csv" for name in NAMES}


def vehicle_of(log: Path) -> str:
    """The setting for the one vehicle in the log."""
    return f"vehicle.system_id={tlog_flight.flight(tlog.read(log)).vehicle.system_id}"


def speed(log: Path, truth: Path) -> None:
    """Wall time of the command, and whether its files are the same every time."""
    with tempfile.TemporaryDirectory() as folder:
        feeds = make_feeds(log, truth, Path(folder), clean=False)
        out = Path(folder, "run")
        command = [sys.executable, "-m", "gcs", "replay", str(log), "--station", str(SAMPLE / "station.toml")]
        command += ["--speed", "max", "--out", str(out), "--config", vehicle_of(log)]
        command += [part for name, path in feeds.items() for part in ("--feed", f"{name}={path}")]
        walls, prints = [], set()
        for _ in range(RUNS + 1):
            began = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True)
            walls.append(time.perf_counter() - began)
            prints.add(tuple(hashlib.sha256((out / name).read_bytes()).hexdigest() for name in FILES))
        t_ns = np.loadtxt(out / "track.csv", delimiter=",", skiprows=1, usecols=0)
    flight_s = (t_ns[-1] - t_ns[0]) / 1e9
    wall_s = float(np.median(walls[1:]))
    print(
        f"{flight_s:.0f} s of flight in {wall_s:.2f} s, median of {RUNS}: {flight_s / wall_s:.0f} times real"
    )
    print(f"files of {RUNS + 1} runs: {'the same bit for bit' if len(prints) == 1 else 'DIFFER'}")


def accuracy(log: Path, truth: Path) -> None:
    """Position error of track.csv on clean feeds, and of filterpy on the same rows."""
    overrides = [vehicle_of(log), *(f"sensor.{name}.estimate=[]" for name in NAMES)]
    station = config.load(SAMPLE / "station.toml", overrides)
    with tempfile.TemporaryDirectory() as folder:
        flight = replay.load(log, station, make_feeds(log, truth, Path(folder), clean=True))
        session = Session(station, flight.frame, [Record(Path(folder, "run"), station, flight.frame)])
        rows, _ = session.intake.enter(replay.batch(flight, session.intake))
        session.align.add(rows)
        session.finish({})
        ours = np.genfromtxt(Path(folder, "run", "track.csv"), delimiter=",", names=True)
        ours_t = np.loadtxt(
            Path(folder, "run", "track.csv"), delimiter=",", skiprows=1, usecols=0, dtype=np.int64
        )
    theirs = methods.make("filterpy-ukf", session.sensors).step(rows).track
    offset_ns = simulated.boot_to_utc_ns(log)
    true = simulated.read_truth(truth, offset_ns)
    enu = flight.frame.to_enu(true["lat_deg"], true["lon_deg"], true["alt_m"])
    position = np.stack([ours[name] for name in ("e_m", "n_m", "u_m")], axis=1)
    for name, t_ns, seen in (
        ("gcs replay", ours_t, position),
        ("filterpy", theirs["t_ns"], theirs["x"][:, :3]),
    ):
        inside = (t_ns > ours_t[0] + SETTLED_S * 1e9) & (t_ns < true["t_ns"][-1])
        at = np.stack([np.interp(t_ns, true["t_ns"], enu[:, k]) for k in range(3)], axis=1)
        error = np.linalg.norm(seen - at, axis=1)[inside]
        print(
            f"{name:<12} RMSE {np.sqrt(np.mean(error**2)):.3f} m, worst {error.max():.2f} m, n {len(error)}"
        )
