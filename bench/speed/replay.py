"""The main job measured on a whole recorded flight: speed, sameness, and accuracy beside filterpy.

    python -m bench replay FLIGHT.tlog TRUTH.csv.gz
    python -m bench replay FLIGHT.tlog TRUTH.csv.gz --against-filterpy

Feeds are simulated from the truth around the sample's station. By default the real command runs three times
after a warm-up and compares the files bit by bit. ``--against-filterpy`` replays clean feeds, and lets
filterpy's unscented filter (textbook sigma points, redrawn before each update) work on the same rows, the
same model.
"""

import hashlib
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from bridges import simulated
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from filters.models.rows import AZIMUTH, ELEVATION, TRACK, Sensor
from filters.models.settings import Settings
from gcs.contract import config
from gcs.outputs.record import Record
from gcs.station import replay
from gcs.station.session import Session
from tests.filters import full_ukf

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample"
NAMES = ("theo-north", "theo-east", "radar-1")
FILES = ("track.csv", "smoothed.csv", "verdicts.csv", "summary.json")
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
    theirs = filterpy_track(session.sensors, rows)
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


def filterpy_track(sensors: list[Sensor], rows: np.ndarray) -> np.ndarray:
    """(k,) TRACK of filterpy's filter: p, v, a and the INS position bias; every row used."""
    settings = Settings()
    n, bias = 12, slice(9, 12)
    sigma2, tau = settings.ins_bias_sigma_m**2, settings.ins_bias_tau_s

    class TextbookUkf(UnscentedKalmanFilter):
        """filterpy keeps sigma points between sequential updates; the textbook draws them again."""

        def update(self, *args, **kwargs):
            self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)
            super().update(*args, **kwargs)

    def observe(x, sensor, channel):
        own = x[bias][channel - full_ukf.E] if sensor.kind == "ins" and channel < full_ukf.E + 3 else 0.0
        return full_ukf.value(sensor, channel, x) + own

    def step(x, dt):
        return np.concatenate([full_ukf.transition(dt)[0] @ x[:9], np.exp(-dt / tau) * x[bias]])

    first = rows[rows["t_ns"] <= rows["t_ns"][rows["channel"] == full_ukf.E][0]]
    fix = {int(row["channel"]): row["value"] for row in first if row["sensor"] == 0}
    points = MerweScaledSigmaPoints(n, 1.0, 0.0, 3.0 - n)
    kf = TextbookUkf(n, 1, 1.0, hx=None, fx=step, points=points)
    kf.x = np.array([*(fix[full_ukf.E + k] for k in range(3)), *np.zeros(9)])
    kf.P = np.diag(np.repeat([25.0**2, 30.0**2, 10.0**2, sigma2], 3))
    track, now = [], int(first["t_ns"][-1])
    for row in rows[rows["t_ns"] >= now]:
        if row["t_ns"] > now:
            track.append((now, kf.x[:9].copy(), kf.P[:9, :9].copy(), 0, 0, now, np.nan, np.nan, False))
            dt = (row["t_ns"] - now) * 1e-9
            kf.Q = np.zeros((n, n))
            kf.Q[:9, :9] = settings.jerk_psd * full_ukf.transition(dt)[1]
            kf.Q[bias, bias] = np.eye(3) * sigma2 * (1 - np.exp(-2 * dt / tau))
            kf.predict(dt=dt)
            now = int(row["t_ns"])
        sensor, channel = sensors[row["sensor"]], int(row["channel"])
        centre = observe(kf.x, sensor, channel)
        angle = channel in (AZIMUTH, ELEVATION)

        def near(a, centre=centre, angle=angle):
            return np.array([(a - centre + np.pi) % (2 * np.pi) - np.pi if angle else a])

        kf.update(
            near(row["value"]),
            R=np.array([[sensor.sigma[channel] ** 2]]),
            hx=lambda x, s=sensor, c=channel, near=near: near(observe(x, s, c)),
        )
    return np.array(track, dtype=TRACK)
