"""Flights to try an estimator on: six recorded ones with their truth, and simulated ones of every level.

    recorded("plane_aero", folder)          the log's INS rows, the truth on the same clock
    simulated("normal", seed=100)           an INS simulated too
    cut(flight, begin_s, seconds)           a span of it

The truth's boot clock becomes UTC through the log's own SYSTEM_TIME. Nothing of the simulator's own messages
(SIM_STATE, SIMSTATE) is an input.
"""

import csv
import gzip
import itertools
import os
import pickle
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.trials import world
from bench.trials.world import Sensor, Truth, scenario, simulate

RECORDED = ("copter_calm", "copter_fast_wind8", "plane_aero", "plane_gpsloss", "plane_wind8", "plane_wind12")
LEVELS = ("hover", "gentle", "normal", "aggressive")
VERSION = 4  # of the cache
SPAN_S = 240.0
SIMULATED_RATE_HZ = 100.0
INS_DELAY_NS = 30_000_000  # from a simulated INS's stamp to its receipt
ALOFT_M, MOVING_MPS = 3.0, 2.0  # from where on it flies
SMOOTH_S = 0.1  # half of the window that takes the step noise out of the truth's acceleration


class Flight(NamedTuple):
    """A flight: ``truth`` counts its seconds from ``t0_ns``, station ENU."""

    name: str
    t0_ns: int  # UTC
    truth: Truth
    ins: Sensor
    ins_rows: np.ndarray  # (n,) ROW in order of valid time, sensor 0
    arrival_ns: np.ndarray  # (n,) when each was received, the flight's clock
    ins_clean: np.ndarray  # (n,) true value at the stamp, the latency not counted
    ins_labels: np.ndarray | None = None  # (n,) index into simulate.LABELS; None: not known


def names() -> tuple[str, ...]:
    """All flights by name."""
    return RECORDED + LEVELS


def folder(given: str | Path | None = None) -> Path | None:
    """Where the recorded flights lie: as given, else GCS_DATA."""
    where = given or os.environ.get("GCS_DATA")
    return Path(where) if where else None


def load(name: str, data: Path | None, seed: int = 0, seconds: float | None = SPAN_S) -> Flight:
    """A flight by name, ``seconds`` from where it flies (None: all of it). ``seed``: of a simulated one."""
    if name in LEVELS:
        return simulated(name, seed, seconds or SPAN_S)
    if name not in RECORDED:
        raise ValueError(f"flight {name!r}: choose one of {', '.join(names())}")
    if data is None:
        raise ValueError(f"flight {name!r} is a recorded one: name the folder with --data or GCS_DATA")
    whole = recorded(name, data)
    return cut(whole, aloft_s(whole.truth), seconds) if seconds else whole


def at(flight: Flight, t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True position, velocity, acceleration (m, 3) each, at ``t_ns`` (m,) UTC."""
    return state_at(flight.truth, (np.asarray(t_ns) - flight.t0_ns) * 1e-9)


def state_at(truth: Truth, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `scenario.at`, but the acceleration is the smoothed one of the truth, straight between samples.

    The second derivative of a recorded position's cubic is mostly the last digit of the record.
    """
    p, v, _ = scenario.at(truth, t_s)
    return p, v, np.column_stack([np.interp(t_s, truth.t_s, truth.a[:, k]) for k in range(3)])


def aloft_s(truth: Truth) -> float:
    """When it first is clear of the ground and moves."""
    clear = truth.p[:, 2] - truth.p[0, 2] > ALOFT_M
    return float(truth.t_s[np.argmax(clear & (np.linalg.norm(truth.v, axis=1) > MOVING_MPS))])


def cut(flight: Flight, begin_s: float, seconds: float) -> Flight:
    """The span [begin, begin + seconds) of a flight, counted from its own beginning."""
    truth = flight.truth
    inside = (truth.t_s >= begin_s) & (truth.t_s < begin_s + seconds)
    since_s = (flight.ins_rows["t_ns"] - flight.t0_ns) * 1e-9
    kept = (since_s >= begin_s) & (since_s < begin_s + seconds)
    return flight._replace(
        truth=Truth(*(column[inside] for column in truth)),
        ins_labels=None if flight.ins_labels is None else flight.ins_labels[kept],
        ins_rows=flight.ins_rows[kept], arrival_ns=flight.arrival_ns[kept], ins_clean=flight.ins_clean[kept],
    )  # fmt: skip


def recorded(name: str, data: Path) -> Flight:
    """A recorded flight, whole; from the cache where it has been decoded before."""
    log, truth = data / f"{name}.tlog", data / f"{name}.truth.csv.gz"
    for file in (log, truth):
        if not file.is_file():
            raise FileNotFoundError(f"{file}: no such file; is --data the folder with the flights?")
    cached = world.cache_file(f"{name}-{VERSION}-{world.fingerprint(log, truth)}.pickle")
    if cached.is_file():
        return Flight(*pickle.loads(cached.read_bytes()))
    flight = _decode(name, log, truth)
    fresh = cached.with_suffix(f".{os.getpid()}")
    fresh.write_bytes(pickle.dumps(tuple(flight)))
    fresh.replace(cached)
    return flight


def _decode(name: str, log: Path, truth_file: Path) -> Flight:
    rows, arrival_ns, sensor, boot_ns, frame = world.decode(log)
    t_ns, truth = read_truth(truth_file, boot_ns, frame)
    t0_ns = int(t_ns[0])
    clean = true_values(truth, (rows["t_ns"] - t0_ns) * 1e-9, rows["channel"])
    return Flight(name, t0_ns, truth, sensor, rows, arrival_ns, clean)


def true_values(truth: Truth, t_s: np.ndarray, channel: np.ndarray) -> np.ndarray:
    """(n,) true value of INS channels; NaN outside the truth."""
    state = np.hstack(state_at(truth, t_s))
    out = state[np.arange(len(t_s)), channel - world.E]
    out[(t_s < truth.t_s[0]) | (t_s > truth.t_s[-1])] = np.nan
    return out


def read_truth(path: Path, boot_ns: int, frame) -> tuple[np.ndarray, Truth]:
    """((n,) UTC ns, the truth in station ENU with seconds from its first sample)."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        header = next(csv.reader(itertools.islice(file, 1)))
        table = np.loadtxt(file, delimiter=",")
    column = {field: table[:, k] for k, field in enumerate(header)}
    fresh = np.concatenate([[True], np.diff(column["TimeUS"]) > 0])
    column = {field: values[fresh] for field, values in column.items()}
    t_ns = boot_ns + column["TimeUS"].astype(np.int64) * 1000
    coarse = frame.to_enu(column["lat_deg"], column["lon_deg"], column["alt_m"])
    fine = np.column_stack([column["pe_m"], column["pn_m"], -column["pd_m"]])
    p = refined(coarse, fine)
    t_s = (t_ns - t_ns[0]) * 1e-9
    # The velocity that the simulator logs is on its sphere (0.3 % longer to the north than WGS84) and an
    # instant's, gusts and all: the one that fits the positions is their own derivative.
    v = np.gradient(p, t_s, axis=0)
    return t_ns, Truth(t_s, p, v, slope(t_s, v))


def refined(coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """(n, 3) positions: the frame of ``coarse``, which is in steps of 1 cm, with the detail of ``fine``.

    The two frames differ by the Earth's curvature and the scales of latitude and longitude only: a polynomial
    of second order in position.
    """
    scaled = fine / 1000.0
    terms = [np.ones(len(fine)), *scaled.T]
    terms += [scaled[:, i] * scaled[:, j] for i in range(3) for j in range(i + 1)]
    basis = np.column_stack(terms)
    return fine + basis @ np.linalg.lstsq(basis, coarse - fine, rcond=None)[0]


def without_ins(name: str, t0_ns: int, truth: Truth) -> Flight:
    """A flight that nobody reports from on board."""
    none = np.zeros(0, world.ROW)
    return Flight(name, t0_ns, truth, None, none, none["t_ns"], none["value"])


def from_places(name: str, t_s: np.ndarray, p: np.ndarray, steady_s: float) -> Flight:
    """`without_ins`, of which only positions ``p`` (n, 3) at UTC ``t_s`` are known; see `slope`."""
    since_s = t_s - t_s[0]
    v = slope(since_s, p, steady_s)
    return without_ins(name, round(t_s[0] * 1e9), Truth(since_s, p, v, slope(since_s, v, steady_s)))


def slope(t_s: np.ndarray, v: np.ndarray, within_s: float = SMOOTH_S) -> np.ndarray:
    """(n, 3) derivative of ``v``: a line through the neighbours ``within_s``, at least one either side."""
    half = max(1, round(within_s / np.median(np.diff(t_s))))
    k = np.arange(len(t_s))
    at_row = np.clip(k[:, None] + np.arange(-half, half + 1), 0, len(t_s) - 1)
    off_s = t_s[at_row] - t_s[at_row].mean(axis=1, keepdims=True)
    return np.einsum("ij,ijk->ik", off_s, v[at_row]) / np.sum(off_s**2, axis=1, keepdims=True)


def simulated(level: str, seed: int, seconds: float = SPAN_S) -> Flight:
    """A flight of ``scenario.LEVELS``; its INS from ``simulate.ins``, with the station's sigmas."""
    rng = np.random.default_rng([seed, LEVELS.index(level)])
    truth = scenario.flight(seconds, SIMULATED_RATE_HZ, level, rng)
    return with_ins(level, truth, rng)


def with_ins(name: str, truth: Truth, rng: np.random.Generator) -> Flight:
    """A truth with a simulated INS."""
    return told_by(name, truth, simulate.ins(truth, rng))[0]


def told_by(name: str, truth: Truth, said: simulate.Observation) -> tuple[Flight, np.ndarray]:
    """A truth with what an INS says of it, and the labels (n,) of its rows."""
    rows, labels = simulate.rows([said])
    clean = true_values(truth, (rows["t_ns"] - simulate.T0_NS) * 1e-9, rows["channel"])
    arrival_ns = rows["t_ns"] + INS_DELAY_NS
    return Flight(name, simulate.T0_NS, truth, world.default_ins(), rows, arrival_ns, clean), labels
