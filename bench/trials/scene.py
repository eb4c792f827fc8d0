"""Who watches a flight, and what they say: instruments by name around its area, with all that goes wrong.

Every instrument has its own stream of chance, so that adding one changes no other.
"""

import zlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench.trials.flights import Flight
from bench.trials.world import AZIMUTH, ELEVATION, ROW, Sensor, Truth, simulate

NO = np.nan
THEO, ROUGH = np.radians(0.003), np.radians(0.05)


class Make(NamedTuple):
    """A make: kind, 1-sigma of range m, azimuth rad, elevation rad, range rate m/s, and pace."""

    kind: str
    sigma: tuple[float, float, float, float]
    rate_hz: float = 20.0


class Site(NamedTuple):
    """Where an instrument stands: seen from the centre of the flown area, and height above its ground."""

    make: str
    bearing_deg: float
    distance: float  # 1: REACH of the area's radius, within NEAREST and FARTHEST
    up_m: float


MAKES = {
    "theo": Make("theodolite", (1.0, THEO, THEO, NO)),
    "passive": Make("theodolite", (NO, THEO, THEO, NO)),
    "radar": Make("radar", (5.0, ROUGH, ROUGH, 0.5)),
    "radar2d": Make("radar", (5.0, ROUGH, NO, NO)),  # no elevation
    "slow": Make("radar", (10.0, np.radians(0.1), np.radians(0.2), NO), 0.75),  # turns once in 1.3 s
    "slow2d": Make("radar", (10.0, np.radians(0.1), NO, NO), 0.75),
    "rangeonly": Make("radar", (1.0, NO, NO, NO)),
}
SITES = {
    "theo-a": Site("theo", 75.0, 1.0, 3.0),
    "theo-b": Site("theo", 345.0, 1.1, 8.0),
    "theo-c": Site("theo", 215.0, 0.9, 5.0),
    "passive-a": Site("passive", 75.0, 1.0, 3.0),
    "passive-b": Site("passive", 345.0, 1.1, 8.0),
    "passive-c": Site("passive", 160.0, 0.9, 4.0),
    "radar-a": Site("radar", 230.0, 1.2, 0.0),
    "radar-b": Site("radar", 130.0, 1.3, 12.0),
    "radar-c": Site("radar", 290.0, 1.2, 5.0),
    "radar2d-a": Site("radar2d", 230.0, 1.2, 0.0),
    "slow-a": Site("slow", 230.0, 1.3, 0.0),
    "slow2d-a": Site("slow2d", 230.0, 1.3, 0.0),
    "range-a": Site("rangeonly", 20.0, 1.0, 0.0),
    "range-b": Site("rangeonly", 140.0, 1.0, 0.0),
    "range-c": Site("rangeonly", 260.0, 1.0, 0.0),
}
STANDARD = ("ins", "theo-a", "theo-b", "radar-a")
REACH, NEAREST_M, FARTHEST_M = 1.3, 600.0, 1500.0  # distance of the instruments from the centre
DELAY_S, DELAY_JITTER_S = 0.03, 0.005  # from an instrument's measurement to its receipt


class Wrong(NamedTuple):
    """What is wrong with the instruments beside their noise."""

    share: float = 0.0  # of the values, outliers
    zero: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # m, rad, rad, m/s
    clock_s: float = 0.0
    crooked: tuple[str, ...] = ()  # the instruments that have ``zero`` and ``clock_s``
    jitter_s: float = 0.0
    gap_share: float = 0.0


class Scene(NamedTuple):
    """A flight as seen."""

    flight: Flight
    sensors: list[Sensor]
    rows: np.ndarray  # (n,) ROW in order of valid time, ids count from 0
    labels: np.ndarray  # (n,) index into simulate.LABELS
    off_sigma: np.ndarray  # (n,) distance from the true value in 1-sigma of the noise
    arrival_ns: np.ndarray  # (n,)


def area(truth: Truth) -> tuple[np.ndarray, float, float]:
    """(centre (2,) east north m, radius m, ground m) of what is flown."""
    low, high = truth.p[:, :2].min(axis=0), truth.p[:, :2].max(axis=0)
    centre = (low + high) / 2
    return centre, float(np.hypot(*(truth.p[:, :2] - centre).T).max()), float(truth.p[:, 2].min())


def instrument(flight: Flight, name: str, estimate: tuple[str, ...] = ()) -> Sensor:
    """One of SITES about a flight's area, or its INS."""
    if name == "ins":
        return flight.ins
    if name not in SITES:
        raise ValueError(f"instrument {name!r}: choose among ins, {', '.join(SITES)}")
    site, (centre, radius_m, ground_m) = SITES[name], area(flight.truth)
    far_m = np.clip(REACH * radius_m, NEAREST_M, FARTHEST_M / 1.3) * site.distance
    bearing = np.radians(site.bearing_deg)
    where = [*(centre + far_m * np.array([np.sin(bearing), np.cos(bearing)])), min(ground_m, 0.0) + site.up_m]
    make, sigma = MAKES[site.make], np.full(13, np.nan)
    sigma[simulate.POLAR_CHANNELS] = make.sigma
    return Sensor(name, make.kind, sigma, np.array(where), estimate=estimate)


def watch(
    flight: Flight,
    names: Sequence[str],
    seed: int,
    wrong: Wrong = Wrong(),  # noqa: B008
    estimate: tuple[str, ...] = (),
) -> Scene:
    """The flight through the eyes of ``names``; the same whenever ``seed`` is the same."""
    sensors = [instrument(flight, name, estimate) for name in names]
    seen = {k: say(flight, s, seed, wrong) for k, s in enumerate(sensors) if s.kind != "ins"}
    return assemble(flight, sensors, seen, seed)


def say(flight: Flight, sensor: Sensor, seed: int, wrong: Wrong) -> simulate.Observation:
    """What one instrument says, outliers and all."""
    rng = stream(seed, sensor.name)
    errors = simulate.InstrumentErrors(jitter_s=wrong.jitter_s, gap_share=wrong.gap_share)
    if sensor.name in wrong.crooked:
        errors = errors._replace(zero=wrong.zero, clock_offset_s=wrong.clock_s)
    rate_hz = MAKES[SITES[sensor.name].make].rate_hz
    said = simulate.instrument(flight.truth, sensor, rate_hz, rng, errors, flight.t0_ns)
    return simulate.contaminate(said, sensor.sigma[said.channels], rng, wrong.share)


def stream(seed: int, name: str) -> np.random.Generator:
    """The chance of one instrument."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def recorded(flight: Flight, sensors: Sequence[Sensor], parts: Sequence[np.ndarray]) -> Scene:
    """What real instruments said, ``parts`` of ROW: nobody knows which of it is wrong, nor when it came."""
    rows = np.concatenate(parts)
    rows = rows[np.argsort(rows["t_ns"], kind="stable")]
    rows["id"], n = np.arange(len(rows)), len(rows)
    return Scene(flight, list(sensors), rows, np.zeros(n, np.int8), np.zeros(n), rows["t_ns"].copy())


def assemble(flight: Flight, sensors, seen: dict[int, simulate.Observation], seed: int) -> Scene:
    """All rows in order of time: ``seen`` by place in ``sensors``, and the flight's INS rows in its own."""
    rng, parts = np.random.default_rng([seed, 1]), []
    for k, sensor in enumerate(sensors):
        if sensor.kind == "ins":
            rows = flight.ins_rows.copy()
            labels, clean, arrival_ns = flight.ins_labels, flight.ins_clean, flight.arrival_ns
            labels = np.zeros(len(rows), np.int8) if labels is None else labels
        else:
            rows, labels, clean = spread(seen[k])
            late_s = DELAY_S + rng.exponential(DELAY_JITTER_S, len(rows))
            arrival_ns = rows["t_ns"] + np.round(late_s * 1e9).astype(np.int64)
        rows["sensor"] = k
        off = rows["value"] - clean
        angle = np.isin(rows["channel"], (AZIMUTH, ELEVATION))
        off[angle] = (off[angle] + np.pi) % (2 * np.pi) - np.pi
        parts.append((rows, labels, np.abs(off) / sensor.sigma[rows["channel"]], arrival_ns))
    rows, labels, off_sigma, arrival_ns = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(rows["t_ns"], kind="stable")
    rows = rows[order]
    rows["id"] = np.arange(len(rows))
    return Scene(flight, list(sensors), rows, labels[order], off_sigma[order], arrival_ns[order])


def spread(seen: simulate.Observation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """((k,) ROW, labels, true values) of one instrument, in its order."""
    at_row, at_column = np.nonzero(np.isfinite(seen.values))
    rows = np.zeros(len(at_row), ROW)
    rows["t_ns"], rows["channel"] = seen.t_ns[at_row], seen.channels[at_column]
    rows["value"] = seen.values[at_row, at_column]
    return rows, seen.labels[at_row, at_column], seen.clean[at_row, at_column]


def soiled(seen: Scene, share: float, rng: np.random.Generator) -> Scene:
    """``seen`` with ``share`` of the INS's values outliers too, single ones of 6 to 100 sigmas."""
    ours = np.array([s.kind == "ins" for s in seen.sensors])[seen.rows["sensor"]]
    hit = np.flatnonzero(ours & (rng.random(len(ours)) < share))
    sigma = np.array([s.sigma for s in seen.sensors])[seen.rows["sensor"][hit], seen.rows["channel"][hit]]
    rows, labels, off_sigma = seen.rows.copy(), seen.labels.copy(), seen.off_sigma.copy()
    size = np.exp(rng.uniform(*np.log([6.0, 100.0]), len(hit))) * rng.choice([-1.0, 1.0], len(hit))
    rows["value"][hit] += size * sigma
    labels[hit], off_sigma[hit] = simulate.ISOLATED, np.abs(size)
    return seen._replace(rows=rows, labels=labels, off_sigma=off_sigma)
