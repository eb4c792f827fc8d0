"""The GA-BP-UKF paper's figure for real data, the mean gradient of a filtered channel, beside the true error.

The gradient alone says little: that of the truth is the figure a perfect filter would have, and a filter that
lags stays below it. The wavelet sees the whole record at once: what compares with it is the smoothed track.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bench.accuracy import FIRST_SEED
from bench.papers.m1 import baselines
from filters import methods
from filters.models.rows import CHANNELS, Sensor
from filters.simulation import scenario, simulate

THEODOLITE_HZ, THEODOLITE_SIGMA = 20.0, np.array([1.0, np.radians(0.003), np.radians(0.003)])
STEP_20_S = 1.0 / THEODOLITE_HZ
ACCEL_PSD = 25.0  # m²/s³: 5 m/s² held for a second, an ordinary turn
ALPHA = 0.3  # of the α-β filter
SETTLE_S = 2.0  # not scored
LOST_M = 10.0
DEG = 180.0 / np.pi


class Watched(NamedTuple):
    """A theodolite's minute; range m, azimuth, elevation rad."""

    t_s: np.ndarray  # (n,)
    clean: np.ndarray  # (n, 3) without noise and outliers
    values: dict[str, np.ndarray]  # (n, 3) by each method


def smoothness(level: str, seeds: int) -> dict:
    """Mean gradient of the filtered range, azimuth, elevation beside their true RMS error, medians.

    Returns {method: {median: (6,) as `_score`, lost: count of flights with LOST_M of range error or more}}.
    """
    found = {}
    for seed in range(seeds):
        watched = watch(level, FIRST_SEED + seed)
        settled = slice(round(SETTLE_S * THEODOLITE_HZ), -1)
        for name, channels in watched.values.items():
            found.setdefault(name, []).append(_score(channels[settled], watched.clean[settled]))
    return {
        name: {
            "median": np.median(scores, axis=0).tolist(),
            "lost": int((np.array(scores)[:, 3] >= LOST_M).sum()),
        }
        for name, scores in found.items()
    }


def watch(level: str, seed: int) -> Watched:
    """One theodolite and the INS see a minute of a flight of one of ``scenario.LEVELS``.

    Range 1 m, angles 0.003°, 20 Hz, 4.1 % outliers, isolated and in runs.
    """
    rng = np.random.default_rng(seed)
    truth = scenario.flight(60.0, 100.0, level, rng)
    noise = np.full(len(CHANNELS), np.nan)
    noise[:3] = THEODOLITE_SIGMA
    theodolite = Sensor("theodolite", "theodolite", noise, np.array([600.0, -400.0, 0.0]))
    inertial = Sensor("ins", "ins", np.r_[np.full(4, np.nan), np.repeat([0.3, 0.2, 1.5], 3)])
    seen = simulate.instrument(truth, theodolite, THEODOLITE_HZ, rng)
    seen = simulate.contaminate(seen, noise[seen.channels], rng, 0.041)
    rows, _ = simulate.rows([seen, simulate.ins(truth, rng, simulate.InsErrors(latency_s=0.0))])
    values = {"truth": seen.clean[:, :3], "raw": seen.values[:, :3]}
    values["adaptive kalman + wavelet"] = _by_channel(seen, _adaptive_wavelet)
    values["alpha-beta"] = _by_channel(seen, _alpha_beta)
    for method in ("ga-bp-ukf", "default"):
        runner = methods.make(method, [theodolite, inertial])
        values[method] = _polar(runner.step(rows).track, theodolite, seen)
        runner.finish()
        values[f"{method}, smoothed"] = _polar(runner.smooth(), theodolite, seen)
    return Watched((seen.t_ns - seen.t_ns[0]) * 1e-9, seen.clean[:, :3], values)


def _score(values: np.ndarray, clean: np.ndarray) -> list[float]:
    """Mean gradient of range m, azimuth, elevation deg, then their RMS errors."""
    step = baselines.difference(values[1:], values[:-1])
    error = baselines.difference(values, clean)
    both = np.concatenate([np.abs(step).mean(axis=0), np.sqrt((error**2).mean(axis=0))])
    return (both * np.array([1.0, DEG, DEG, 1.0, DEG, DEG])).tolist()


def _by_channel(seen: simulate.Observation, method: Callable) -> np.ndarray:
    """Each channel by itself, azimuth unwrapped; ``method`` takes z, sigma, acceleration PSD in its unit."""
    z = seen.values[:, :3].copy()
    z[:, 1] = np.unwrap(z[:, 1])
    away_m = np.median(z[:, 0])
    psd = ACCEL_PSD / np.array([1.0, away_m**2, away_m**2])
    return np.column_stack([method(z[:, k], THEODOLITE_SIGMA[k], psd[k]) for k in range(3)])


def _adaptive_wavelet(z, sigma, psd):
    return baselines.adaptive_wavelet(z, sigma, STEP_20_S, psd)


def _alpha_beta(z, sigma, psd):
    return baselines.alpha_beta(z, STEP_20_S, ALPHA)


def _polar(track: np.ndarray, sensor: Sensor, seen: simulate.Observation) -> np.ndarray:
    """(m, 3) range, azimuth, elevation of (k,) TRACK at the times of ``seen``."""
    at = np.searchsorted(track["t_ns"], seen.t_ns).clip(max=len(track) - 1)
    return baselines.observe((track["x"][at, :3] - sensor.offset_m) @ sensor.rotation.T)
