"""Flights for the correction network to learn from: simulated ones, and run folders with truth.

Each becomes pairs of what the filter did at an epoch and what it should have done. One flight is never split.
"""

import csv
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import filters
from filters import methods
from filters.correction import correction
from filters.models.rows import ROW, Sensor
from filters.models.settings import Settings
from filters.simulation import scenario, simulate
from gcs.contract import config
from gcs.contract.frames import Frame, origin_frame
from gcs.contract.messages import CHANNELS, InputError
from gcs.station.intake import ins_sigma, sensors_of
from gcs.station.ledger import ANGLES

SETTLE_S = 5.0  # a filter that has just started is no example
SECONDS = 60.0  # of a simulated flight
RATE_HZ = 100.0  # of its truth
ESTIMATOR = "models", "smoother", "simulation"  # of filters: what a flight teaches follows from them
INS_SIGMA = ins_sigma(config.InsSection())  # the station file's defaults
AROUND_M = (150.0, 2500.0)  # horizontal distance of instruments from the origin


class Flown(NamedTuple):
    """What one flight teaches, k epochs."""

    name: str
    u: np.ndarray  # (k, 9) network input, as from `correction.samples`
    e: np.ndarray  # (k, 9) desired output, sigmas
    sigma: (
        np.ndarray
    )  # (k, 9) the filter's 1-sigma along-track, right, up: e · sigma is the error in m, m/s, m/s²


class Recorder:
    """A correction that changes nothing and keeps what it saw."""

    def __init__(self):
        self._seen = []

    def __call__(self, x0: np.ndarray, P0: np.ndarray, x1: np.ndarray, P1: np.ndarray) -> np.ndarray:
        n = correction.CORE
        self._seen.append((x0[:n].copy(), P0[:n, :n].copy(), x1[:n].copy(), P1[:n, :n].copy()))
        return x1

    def columns(self, track: np.ndarray) -> list[np.ndarray]:
        """x0 (k, 9), P0 (k, 9, 9), x1, P1 of the calls behind (k,) TRACK, in its order.

        Not every state is published; the acceleration goes out as it is and tells which one it was.
        """
        calls, found = iter(self._seen), []
        for x in track["x"]:
            found.append(next(call for call in calls if np.array_equal(call[2][6:], x[6:])))
        return [np.array(column) for column in zip(*found, strict=True)]


def fly(
    name: str,
    sensors: list[Sensor],
    rows: np.ndarray,
    truth: scenario.Truth,
    t0_ns: int,
    settings: Settings,
) -> Flown:
    """Filter (n,) ROW with the default method and hold it against ``truth``, timed from ``t0_ns``."""
    recorder = Recorder()
    track = methods.make("default", sensors, settings, recorder).step(rows).track
    t_s = (track["t_ns"] - t0_ns) * 1e-9
    fit = (t_s > max(t_s[0] + SETTLE_S, truth.t_s[0])) & (t_s < truth.t_s[-1])
    x0, P0, x1, P1 = (column[fit] for column in recorder.columns(track))
    u, e = correction.samples(x0, P0, x1, P1, np.hstack(scenario.at(truth, t_s[fit])))
    return Flown(name, u, e, correction.sigmas_of(x0, P1))


def simulated(number: int, settings: Settings) -> Flown:
    """Flight ``number`` on a range of its own: vehicle, instruments, rates, noise and outliers are drawn."""
    rng = np.random.default_rng(number)
    level = rng.choice(list(scenario.LEVELS))
    truth = scenario.flight(SECONDS, RATE_HZ, level, rng)
    sensors, seen = [Sensor("ins", "ins", np.r_[np.full(4, np.nan), INS_SIGMA])], [_ins(truth, rng)]
    share = rng.uniform(0.0, 0.08)
    for k in range(rng.integers(1, 4)):
        sensors.append(_instrument(k, rng))
        observed = simulate.instrument(truth, sensors[-1], rng.choice([5.0, 10.0, 20.0]), rng)
        seen.append(simulate.contaminate(observed, sensors[-1].sigma[observed.channels], rng, share))
    rows, _ = simulate.rows(seen)
    return fly(f"{level}-{number}", sensors, rows, truth, simulate.T0_NS, settings)


def _ins(truth, rng):
    errors = simulate.InsErrors(
        bias_m=rng.uniform(0.5, 3.0),
        velocity_mps=rng.uniform(0.05, 0.2),
        acceleration_mps2=rng.uniform(0.3, 1.5),
        latency_s=rng.uniform(0.0, 0.05),
        rate_hz=rng.choice([5.0, 10.0, 20.0]),
    )
    return simulate.ins(truth, rng, errors)


def _instrument(number, rng) -> Sensor:
    """A theodolite, or a radar once in three, somewhere around the origin; noise within a factor of three."""
    kind = "radar" if rng.random() < 1 / 3 else "theodolite"
    usual = config.KIND_SIGMA[kind]
    sigma = np.full(len(CHANNELS), np.nan)
    said = [usual.range_m, np.radians(usual.azimuth_deg), np.radians(usual.elevation_deg)]  # type: ignore[arg-type]
    said += [usual.range_rate_mps] if kind == "radar" else []
    sigma[: len(said)] = np.array(said) * 3.0 ** rng.uniform(-1.0, 1.0)
    away_m, bearing = rng.uniform(*AROUND_M), rng.uniform(0.0, 2 * np.pi)
    place = np.array([away_m * np.sin(bearing), away_m * np.cos(bearing), rng.uniform(-20.0, 60.0)])
    return Sensor(f"{kind}-{number}", kind, sigma, place)


def from_run(folder: Path, settings: Settings) -> Flown:
    """A run folder with a ``truth.csv`` in it: t_ns,lat_deg,lon_deg,alt_m, such as an RTK track.

    Raises InputError with one line that says what is missing.
    """
    for name in ("station.toml", "verdicts.csv", "truth.csv"):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder / name}: missing; a flight to train on is a run folder with a truth.csv"
            )
    station = config.load(folder / "station.toml", ())
    if station.range.origin is None:
        raise InputError(f"{folder / 'station.toml'}: [range] origin is missing; replay with a station file")
    frame = origin_frame(station)
    t_ns, position = _read_truth(folder / "truth.csv", frame)
    truth = scenario.track((t_ns - t_ns[0]) * 1e-9, position)
    sensors = sensors_of(station, frame)
    latency_s = {"ins": dict.fromkeys(CHANNELS, station.ins.latency_s)}
    latency_s |= {s.name: s.latency_by_channel for s in station.sensor}
    rows = _read_rows(folder / "verdicts.csv", [(s.name, latency_s[s.name]) for s in sensors])
    return fly(folder.name, sensors, rows, truth, int(t_ns[0]), settings)


def _read_truth(path: Path, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = [
                (int(line["t_ns"]), float(line["lat_deg"]), float(line["lon_deg"]), float(line["alt_m"]))
                for line in csv.DictReader(file)
            ]
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: {error}; it needs t_ns,lat_deg,lon_deg,alt_m, all numbers") from None
    t_ns = np.array([line[0] for line in lines])
    if len(t_ns) < 2 or (np.diff(t_ns) <= 0).any():
        raise InputError(f"{path}: needs two or more lines in ascending order of time")
    return t_ns, frame.to_enu(*np.array([line[1:] for line in lines]).T)


def _read_rows(path: Path, sensors: list[tuple[str, dict[str, float]]]) -> np.ndarray:
    """Everything measured, (n,) ROW in order of time; ``sensors``: names, known latency in s by channel."""
    place = {name: (index, late_s) for index, (name, late_s) in enumerate(sensors)}
    with path.open(newline="", encoding="utf-8") as file:
        lines = [
            line
            for line in csv.DictReader(file)
            if line["value"] and line["verdict"] not in ("invalid", "duplicate")
        ]
    rows = np.zeros(len(lines), ROW)
    for row, line in zip(rows, lines, strict=True):
        sensor, late_s = place[line["sensor"]]
        channel = CHANNELS.index(line["channel"])
        value = np.radians(float(line["value"])) if ANGLES[channel] else float(line["value"])
        row["t_ns"], row["sensor"], row["channel"], row["value"] = (
            int(line["t_ns"]) - round(1e9 * late_s[line["channel"]]),
            sensor,
            channel,
            value,
        )
    rows = rows[np.argsort(rows["t_ns"], kind="stable")]
    rows["id"] = np.arange(len(rows))
    return rows


def _filter_key(settings: Settings) -> int:
    """Changes with the filter's settings and with its code: flights of another filter are no examples."""
    top = Path(filters.__file__).parent
    sources = [path for part in ESTIMATOR for path in sorted((top / part).rglob("*.py"))]
    return zlib.crc32(b"".join(path.read_bytes() for path in sources) + repr(settings).encode())


def gather(
    numbers: range, folders: list[Path], settings: Settings, out: Path, progress: Callable[[int, int], None]
) -> list[Flown]:
    """All flights, simulated ``numbers`` and run ``folders``; what lies in ``out`` is not flown again."""
    cache = out / f"flights-{_filter_key(settings):08x}"
    cache.mkdir(parents=True, exist_ok=True)
    wanted: list[tuple[str, Callable[[Any, Settings], Flown], Any]]
    wanted = [(f"simulated-{n}", simulated, n) for n in numbers]
    wanted += [(f"run-{folder.name}", from_run, folder) for folder in folders]
    flights = []
    for k, (key, make, what) in enumerate(wanted):
        path = cache / f"{key}.npz"
        if not path.exists():
            flown = make(what, settings)
            part = path.with_suffix(".part.npz")
            np.savez(part, name=flown.name, u=flown.u, e=flown.e, sigma=flown.sigma)
            part.rename(path)  # a run stopped in the middle leaves no half flight
        with np.load(path) as saved:
            flights.append(Flown(str(saved["name"]), saved["u"], saved["e"], saved["sigma"]))
        progress(k + 1, len(wanted))
    return flights
