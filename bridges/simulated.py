"""Theodolite and radar feeds that never were, simulated from a flight's truth with all that goes wrong.

``run`` plays them onto the bus, ``write_all`` writes them: for each instrument of the station file two files,
the n-th line of one about the n-th line of the other:

``NAME.csv``         the feed, as ``bridges.feed`` reads it
``NAME.labels.csv``  per channel what was true at the instant of the measurement, without noise and error, and
                     the label none | isolated | patch

and in ``injected.json`` the zero errors (added to the true value) and clock offsets (``t_stamp = t_valid +
clock_offset``). The truth is a CSV, gzip or not, with ``lat_deg``, ``lon_deg``, ellipsoidal ``alt_m`` and
either ``t_ns`` or the boot time ``TimeUS``, which needs the flight's log to become UTC. Geometry goes through
the ellipsoid, so the Earth is as round as it is. The same seed gives the same bytes.
"""

import csv
import gzip
import json
import os
import threading
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from bridges import feed
from bridges.instruments import KINDS
from filters.simulation import scenario, simulate
from gcs.contract import config
from gcs.contract.frames import Frame, mount
from gcs.contract.messages import CHANNELS, POLAR, InputError

if TYPE_CHECKING:  # a bridge is given its bus; zenoh is loaded by whoever opens it
    from gcs.contract.wire.bus import Bus

TRUTH = np.dtype([("t_ns", "i8"), ("lat_deg", "f8"), ("lon_deg", "f8"), ("alt_m", "f8")])
COLUMNS = {"range_m": 3, "azimuth_deg": 6, "elevation_deg": 6, "range_rate_mps": 3}  # decimals in files
TO_FILE = np.array([1.0, np.degrees(1.0), np.degrees(1.0), 1.0])
OUTLIER_SHARE = 0.041  # of a phased-array radar record; see filters.simulation.simulate.contaminate


class SimulatedInstrument(NamedTuple):
    """Where it stands (WGS84, ellipsoidal height) and how well it measures."""

    name: str
    kind: str  # theodolite | radar
    lat_deg: float
    lon_deg: float
    alt_m: float
    sigma: dict[str, float]  # by names of COLUMNS; a channel left out is not measured
    refraction: str = "none"  # none | optical | radar
    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # leans east, north; azimuth of its zero
    errors: simulate.InstrumentErrors = simulate.NO_ERRORS


def read_truth(path: Path, boot_to_utc_ns: int | None = None) -> np.ndarray:
    """(n,) ``TRUTH``. Raises ``FeedError`` for a file that is none."""
    path = Path(path)
    if not os.path.isfile(path):  # also where no file can have such a name
        raise feed.FeedError(
            f"{path}: no such file; name a truth CSV with t_ns or TimeUS, lat_deg, lon_deg, alt_m"
        )
    opened = gzip.open if path.suffix == ".gz" else open
    with opened(path, "rt", encoding="utf-8", newline="") as file:
        lines = csv.DictReader(file)
        names = set(lines.fieldnames or ())
        if not {"lat_deg", "lon_deg", "alt_m"} <= names or not names & {"t_ns", "TimeUS"}:
            raise feed.FeedError(f"{path}:1: a truth file has t_ns or TimeUS, and lat_deg, lon_deg, alt_m")
        if "t_ns" not in names and boot_to_utc_ns is None:
            raise feed.FeedError(f"{path}:1: TimeUS is boot time; name the flight's log with --tlog")
        place = itemgetter("lat_deg", "lon_deg", "alt_m")
        boot_ns = boot_to_utc_ns or 0
        rows = [
            (int(x["t_ns"]) if "t_ns" in names else boot_ns + int(x["TimeUS"]) * 1000, *place(x))
            for x in lines
        ]
    return np.array(rows, TRUTH)


def observe(
    truth: np.ndarray, instrument: SimulatedInstrument, rng: np.random.Generator, share: float
) -> simulate.Observation:
    """What one instrument sees of the flight, (n,) ``TRUTH``, ``share`` of its values outliers."""
    site = Frame(instrument.lat_deg, instrument.lon_deg, instrument.alt_m)
    t0_ns = int(truth["t_ns"][0])
    level = site.to_enu(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    seen_from = scenario.track((truth["t_ns"] - t0_ns) * 1e-9, level @ mount(*instrument.mount_deg).T)
    sigma = np.full(len(CHANNELS), np.nan)
    sigma[:4] = [instrument.sigma.get(name, np.nan) for name in COLUMNS] / TO_FILE
    sensor = simulate.Sensor(instrument.name, instrument.kind, sigma, refraction=instrument.refraction)
    rate_hz = KINDS[instrument.kind].RATE_HZ
    seen = simulate.instrument(seen_from, sensor, rate_hz, rng, instrument.errors, t0_ns)
    return simulate.contaminate(seen, sigma[:4], rng, share)


def observe_all(
    truth: np.ndarray, instruments: Sequence[SimulatedInstrument], seed: int, share: float = OUTLIER_SHARE
) -> dict[str, simulate.Observation]:
    """By name; each instrument has its own stream of chance, so adding one changes no other."""
    return {
        instrument.name: observe(truth, instrument, np.random.default_rng([seed, k]), share)
        for k, instrument in enumerate(instruments, 1)
    }


def crooked(instruments: Sequence[SimulatedInstrument], seed: int) -> list[SimulatedInstrument]:
    """The same instruments set up with ordinary care: small zero errors, clocks apart, a few dropouts."""
    rng = np.random.default_rng([seed, 0])
    out = []
    for instrument in instruments:
        zero = (rng.normal(0, 1.5), *np.radians(rng.normal(0, 0.01, 2)).tolist(), 0.0)
        clock_s = rng.uniform(-0.08, 0.08)
        errors = simulate.InstrumentErrors(zero, clock_s, jitter_s=0.001, gap_share=0.01)
        out.append(instrument._replace(errors=errors))
    return out


def to_polar(seen: simulate.Observation) -> np.ndarray:
    """(m,) ``POLAR`` of one instrument, rounded as in its file."""
    rows = np.zeros(len(seen.t_ns), POLAR)
    rows["t_ns"] = rows["arrival_ns"] = seen.t_ns
    for (name, decimals), column in zip(COLUMNS.items(), (seen.values * TO_FILE).T, strict=True):
        rows[name] = np.round(column, decimals)
        rows[f"sigma_{name}"] = np.nan
    return rows


def write(folder: Path, name: str, seen: simulate.Observation) -> None:
    """``NAME.csv`` and ``NAME.labels.csv``."""
    measured = np.flatnonzero(~np.isnan(seen.values).all(axis=0))
    names = [list(COLUMNS)[k] for k in measured]
    stamps = [f"{t // 10**9}.{t % 10**9:09d}" for t in seen.t_ns.tolist()]
    values, clean = (_text(of[:, measured] * TO_FILE[measured], names) for of in (seen.values, seen.clean))
    labels = np.array(simulate.LABELS)[seen.labels[:, measured]].tolist()
    labelled = [[x for pair in zip(*of, strict=True) for x in pair] for of in zip(clean, labels, strict=True)]
    headings = [heading for name in names for heading in (name, f"{name.rsplit('_', 1)[0]}_label")]
    for suffix, header, rows in (("", names, values), (".labels", headings, labelled)):
        lines = [",".join(["t", *header])]
        lines += [",".join([t, *row]) for t, row in zip(stamps, rows, strict=True)]
        (folder / f"{name}{suffix}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_all(
    folder: Path, truth: np.ndarray, instruments: Sequence[SimulatedInstrument], seed: int, share: float
) -> None:
    """Feed and labels of all instruments, ``share`` of the values outliers, and ``injected.json``.

    Raises InputError where nothing can be written.
    """
    injected: dict[str, Any] = {"seed": seed, "outlier_share": share}
    injected |= {instrument.name: _injected(instrument.errors) for instrument in instruments}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, seen in observe_all(truth, instruments, seed, share).items():
            write(folder, name, seen)
        (folder / "injected.json").write_text(json.dumps(injected, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror}; name a folder that can be written") from None


def run(
    bus: "Bus",
    truth: np.ndarray,
    instruments: Sequence[SimulatedInstrument],
    seed: int,
    stop: threading.Event,
    *,
    share: float = OUTLIER_SHARE,
    **pace: Any,
) -> None:
    """Stream all instruments live, ``share`` of the values outliers; ``pace`` as in ``feed.play``."""
    due = []
    for name, seen in observe_all(truth, instruments, seed, share).items():
        bus.declare_alive(name)
        due += feed.timeline(name, to_polar(seen), [])
    feed.play(bus, sorted(due, key=itemgetter(0)), stop, **pace)


def instruments_of(station: Path) -> list[SimulatedInstrument]:
    """The instruments of a station file. A channel without ``sigma`` is not measured; without any, all."""
    found = []
    for sensor in config.load(Path(station)).sensor:
        stated = msgspec.structs.asdict(sensor.sigma)
        sigma = stated if any(stated.values()) else msgspec.structs.asdict(config.KIND_SIGMA[sensor.kind])
        named = {name: value for name, value in sigma.items() if value is not None}
        at, lean = sensor.position, (sensor.tilt_deg.east, sensor.tilt_deg.north, sensor.orientation_deg)
        where = at.lat_deg, at.lon_deg, at.alt_m
        found.append(SimulatedInstrument(sensor.name, sensor.kind, *where, named, sensor.refraction, lean))
    return found


def boot_to_utc_ns(path: Path) -> int:
    """UTC minus boot time of the only vehicle in a log, at its start."""
    from bridges.tlog import flight as tlog_flight
    from bridges.tlog import tlog

    return tlog_flight.flight(tlog.read(path)).boots[0].offset_ns


def _injected(errors: simulate.InstrumentErrors) -> dict[str, float]:
    zero = (np.array(errors.zero) * TO_FILE).tolist()
    return dict(zip(COLUMNS, zero, strict=True)) | {"clock_offset_s": errors.clock_offset_s}


def _text(values: np.ndarray, names: list[str]) -> list[list[str]]:
    decimals = [COLUMNS[name] for name in names]
    return [[f"{x:.{d}f}" for x, d in zip(row, decimals, strict=True)] for row in values.tolist()]
