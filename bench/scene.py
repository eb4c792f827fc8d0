"""One simulated flight of the bench: who watches it, what is wrong with what they say, and the truth."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from filters.models.rows import Sensor
from filters.simulation import scenario, simulate
from filters.simulation.simulate import LongPatch

RATE_HZ = 20.0
SITES_M = {
    "theo-a": (1200.0, 0.0, 0.0),
    "theo-b": (0.0, 1300.0, 10.0),
    "theo-c": (-900.0, 1100.0, 5.0),
    "passive-a": (1200.0, 0.0, 0.0),
    "passive-b": (0.0, 1300.0, 10.0),
    "radar-a": (-1000.0, -800.0, 0.0),
    "radar-b": (1400.0, -1200.0, 20.0),
    "radar-c": (-1500.0, 300.0, 5.0),
}  # station ENU; inside the flown area, so that they are overflown now and then
ANGLE_RAD, RADAR_ANGLE_RAD = np.radians(0.003), np.radians(0.05)
SIGMA = {
    "theo": (1.0, ANGLE_RAD, ANGLE_RAD, np.nan),
    "passive": (np.nan, ANGLE_RAD, ANGLE_RAD, np.nan),
    "radar": (5.0, RADAR_ANGLE_RAD, RADAR_ANGLE_RAD, 0.5),
}  # range m, azimuth rad, elevation rad, range rate m/s
STANDARD = ("ins", "theo-a", "theo-b", "radar-a")
INS = simulate.InsErrors(rate_hz=RATE_HZ)
FIRST_PATCH_S, PATCH_SLOT_S, PATCH_S = 12.0, 20.0, (2.0, 10.0)
START_WITHIN_S = 6.0  # of the slot


class Patch(NamedTuple):
    """Long patches, one in every slot of the flight; which instruments it hits is drawn."""

    kind: str  # one of simulate.PATCH_KINDS
    channels: str = "all"  # one | all, of an instrument
    instruments: int = 1  # hit at the same time
    in_turn: bool = False  # begins where the slot's acceleration is largest


class Case(NamedTuple):
    """What is flown. ``row`` is the requirement that it belongs to."""

    name: str
    row: int
    sensors: tuple[str, ...] = STANDARD  # names of SITES_M, and ins
    level: str = "aggressive"  # one of scenario.LEVELS
    share: float = 0.0  # of outliers in the instruments' values
    patch: Patch | None = None
    gap_share: float = 0.0  # of an instrument's measurements, lost in dropouts
    wrong: simulate.InstrumentErrors = simulate.NO_ERRORS  # systematic errors of the first instrument
    ins_rate_hz: float = RATE_HZ
    estimate: tuple[str, ...] = ()  # systematic errors to estimate
    doubt: str = "first"  # first | all: of which instruments
    late_share: float = 0.0  # of the rows
    limits: Mapping[str, float] = MappingProxyType({})  # figure → what is asked for, see table.missed


class SimulatedFlight(NamedTuple):
    """A flight as flown and as seen."""

    truth: scenario.Truth
    sensors: list[Sensor]
    rows: np.ndarray  # (n,) ROW in order of time
    labels: np.ndarray  # (n,) index into simulate.LABELS
    off_sigma: np.ndarray  # (n,) distance from the true value, in 1-sigma of the noise
    spans_s: list[tuple[float, float]]  # begin and end of every patch


def fly(case: Case, seed: int, seconds: float) -> SimulatedFlight:
    """The same flight and the same noise whenever ``seed`` is the same."""
    rng = np.random.default_rng(seed)
    truth = scenario.flight(seconds, 100.0, case.level, rng)
    crooked = first_instrument(case)
    sensors = [
        sensor(name, case.estimate if case.doubt == "all" or name == crooked else ()) for name in case.sensors
    ]
    seen = [
        simulate.ins(truth, rng, INS._replace(rate_hz=case.ins_rate_hz))
        if s.kind == "ins"
        else _watch(case, truth, s, case.wrong if s.name == crooked else simulate.NO_ERRORS, rng)
        for s in sensors
    ]
    spans_s = _add_patches(case.patch, truth, sensors, seen, rng) if case.patch else []
    rows, labels = simulate.rows(seen)
    clean, _ = simulate.rows([said._replace(values=said.clean) for said in seen])
    sigma = np.array([s.sigma for s in sensors])[rows["sensor"], rows["channel"]]
    off = rows["value"] - clean["value"]
    angle = np.isin(rows["channel"], (1, 2))
    off[angle] = (off[angle] + np.pi) % (2 * np.pi) - np.pi
    return SimulatedFlight(truth, sensors, rows, labels, np.abs(off) / sigma, spans_s)


def first_instrument(case: Case) -> str:
    """The one that has the systematic errors."""
    return next(name for name in case.sensors if name != "ins")


def sensor(name: str, estimate: tuple[str, ...] = ()) -> Sensor:
    """The INS, with its latency estimated, or one of ``SITES_M``."""
    sigma = np.full(13, np.nan)
    if name == "ins":
        sigma[simulate.INS_CHANNELS] = np.repeat([INS.position_m, INS.velocity_mps, INS.acceleration_mps2], 3)
        return Sensor(name, "ins", sigma, estimate=("clock",))
    make = name.split("-")[0]
    sigma[simulate.POLAR_CHANNELS] = SIGMA[make]
    kind = "radar" if make == "radar" else "theodolite"
    return Sensor(name, kind, sigma, np.array(SITES_M[name]), estimate=estimate)


def _watch(
    case: Case, truth, instrument: Sensor, errors: simulate.InstrumentErrors, rng
) -> simulate.Observation:
    """What one instrument says, outliers and all."""
    errors = errors._replace(gap_share=case.gap_share)
    said = simulate.instrument(truth, instrument, RATE_HZ, rng, errors)
    return simulate.contaminate(said, instrument.sigma[said.channels], rng, case.share)


def _add_patches(patch: Patch, truth, sensors, seen, rng) -> list[tuple[float, float]]:
    """Put one patch into every slot, in place; their times."""
    instruments = [k for k, s in enumerate(sensors) if s.kind != "ins"]
    spans_s = []
    for slot_s in np.arange(FIRST_PATCH_S, truth.t_s[-1] - PATCH_SLOT_S + 2.0, PATCH_SLOT_S):
        start_s, length_s = slot_s + rng.uniform(0.0, START_WITHIN_S), rng.uniform(*PATCH_S)
        if patch.in_turn:
            there = (truth.t_s >= slot_s) & (truth.t_s < slot_s + START_WITHIN_S)
            start_s = truth.t_s[there][np.argmax(np.linalg.norm(truth.a[there], axis=1))]
        for k in rng.permutation(instruments)[: patch.instruments]:
            sigma = sensors[k].sigma[seen[k].channels]
            columns = np.flatnonzero(np.isfinite(sigma))
            if patch.channels == "one":
                columns = rng.choice(columns, 1)
            seen[k] = simulate.patch(
                seen[k], sigma, LongPatch(patch.kind, start_s, length_s, tuple(columns)), rng
            )
        spans_s.append((start_s, start_s + length_s))
    return spans_s
