"""Turbulence after Dryden, and an aircraft that gives way to it.

Source: MIL-HDBK-1797, *Flying Qualities of Piloted Aircraft* (1997), low-altitude model: scale lengths and
intensities by height, spectra as filters of white noise. Its formulas are in feet.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from filters.simulation.scenario import Truth

FOOT_M = 0.3048
LOWEST_M, HIGHEST_M = 3.0, 300.0  # of the low-altitude model; beyond, its values there are kept
SLOWEST_MPS = 3.0  # air speed below which the frozen field would hardly pass by


class Airframe(NamedTuple):
    """How an aircraft gives way to a gust: x″ = (gust − x′)/give − hold² x − 2 · 0.7 hold x′, per axis."""

    give_s: tuple[float, float, float]  # along, across, up: time in which it takes on the gust's speed
    hold_radps: tuple[float, float, float]  # stiffness with which its autopilot holds the path; 0: it drifts


AIRFRAMES = {
    "plane": Airframe((4.0, 1.2, 0.4), (0.4, 0.5, 0.7)),
    "copter": Airframe((1.5, 1.5, 0.8), (0.8, 0.8, 1.0)),
}


def dryden(
    airspeed_mps: np.ndarray, height_m: np.ndarray, wind_mps: float, dt_s: float, rng: np.random.Generator
) -> np.ndarray:
    """(n, 3) gusts along, across and up, m/s; ``airspeed_mps`` and ``height_m`` of the aircraft (n,).

    ``wind_mps`` is the mean wind at 6 m (20 ft): 7.5 light, 15 moderate, 23 severe turbulence.
    """
    sigma, scale_m = intensities(height_m, wind_mps)
    passing_s = scale_m / np.maximum(airspeed_mps, SLOWEST_MPS)[:, None]
    return _filtered(sigma, passing_s, dt_s, rng.normal(size=(len(sigma), 3, 2)))


def intensities(height_m: np.ndarray, wind_mps: float) -> tuple[np.ndarray, np.ndarray]:
    """1-sigma, m/s, and scale length, m, along, across and up, (n, 3) each."""
    height_ft = np.clip(height_m, LOWEST_M, HIGHEST_M) / FOOT_M
    shape = 0.177 + 0.000823 * height_ft
    up = np.full(len(height_ft), 0.1 * wind_mps)
    flat = up / shape**0.4
    long_m = height_ft / shape**1.2 * FOOT_M
    return np.column_stack([flat, flat, up]), np.column_stack([long_m, long_m, height_ft * FOOT_M])


def buffeted(
    truth: Truth,
    wind_mps: float,
    airframe: Airframe,
    rng: np.random.Generator,
    wind_enu: Sequence[float] = (0.0, 0.0, 0.0),
) -> Truth:
    """``truth``, evenly sampled, as flown through turbulence; the mean wind sets the air speed."""
    dt_s = float(truth.t_s[1] - truth.t_s[0])
    through = truth.v - np.array(wind_enu)
    height_m = truth.p[:, 2] - truth.p[:, 2].min() + LOWEST_M
    gust = dryden(np.linalg.norm(through, axis=1), height_m, wind_mps, dt_s, rng)
    way = _give(gust, np.array(airframe.give_s), np.array(airframe.hold_radps), dt_s)
    off = np.einsum("kij,ki->kj", _axes(through), way)
    v = np.gradient(off, dt_s, axis=0)
    return Truth(truth.t_s, truth.p + off, truth.v + v, truth.a + np.gradient(v, dt_s, axis=0))


def _axes(through: np.ndarray) -> np.ndarray:
    """(n, 3, 3) unit vectors along the level course, across it to the right, and up; smoothed at rest."""
    flat = through[:, :2] + 1e-3
    weight = np.hypot(*flat.T)
    course = np.unwrap(np.arctan2(flat[:, 0], flat[:, 1]))
    for k in range(1, len(course)):  # at walking speed the nose stays where it is
        share = min(1.0, weight[k] / SLOWEST_MPS) * 0.05
        course[k] = course[k - 1] + share * (course[k] - course[k - 1])
    sine, cosine, zero, one = np.sin(course), np.cos(course), np.zeros(len(course)), np.ones(len(course))
    return np.stack(
        [
            np.column_stack([sine, cosine, zero]),
            np.column_stack([cosine, -sine, zero]),
            np.column_stack([zero, zero, one]),
        ],
        axis=1,
    )


@njit(cache=True)
def _filtered(sigma, passing_s, dt, noise):
    """White ``noise`` (n, 3, 2) through Dryden's filters, discretised exactly; starts in balance.

    Along: σ √(2T) / (1 + Ts). Across and up: σ √T (1 + √3 Ts) / (1 + Ts)² = σ √T (√3 y₁ + (1 − √3) y₂) with
    y₁ = w / (1 + Ts), y₂ = y₁ / (1 + Ts).
    """
    n = len(sigma)
    out = np.zeros((n, 3))
    y1, y2 = np.zeros(3), np.zeros(3)
    for k in range(n):
        for i in range(3):
            T = passing_s[k, i]
            h = dt / T if k else 50.0
            keep, gone = np.exp(-h), np.exp(-2.0 * h)
            q11 = (1.0 - gone) / (2.0 * T)
            q12 = (1.0 - gone * (2.0 * h + 1.0)) / (4.0 * T)
            q22 = (1.0 - gone * (2.0 * h * h + 2.0 * h + 1.0)) / (4.0 * T)
            a = np.sqrt(q11)
            b = q12 / a
            c = np.sqrt(max(q22 - b * b, 0.0))
            y2[i] = keep * (y2[i] + h * y1[i]) + b * noise[k, i, 0] + c * noise[k, i, 1]
            y1[i] = keep * y1[i] + a * noise[k, i, 0]
            if i == 0:
                out[k, i] = sigma[k, i] * np.sqrt(2.0 * T) * y1[i]
            else:
                root3 = np.sqrt(3.0)
                out[k, i] = sigma[k, i] * np.sqrt(T) * (root3 * y1[i] + (1.0 - root3) * y2[i])
    return out


@njit(cache=True)
def _give(gust, give, hold, dt):
    """Displacement (n, 3) of an `Airframe`; its acceleration is straight between two steps."""
    n = len(gust)
    d, v, a = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n - 1):
        for i in range(3):
            # implicit for the velocity at the step's end: stable however stiff
            rate = 1.0 / give[i] + 1.4 * hold[i]
            soft = hold[i] * hold[i]
            push = gust[k + 1, i] / give[i] - soft * (d[k, i] + dt * v[k, i] + dt * dt / 3.0 * a[k, i])
            late = push - rate * (v[k, i] + dt / 2.0 * a[k, i])
            a[k + 1, i] = late / (1.0 + rate * dt / 2.0 + soft * dt * dt / 6.0)
            d[k + 1, i] = d[k, i] + dt * v[k, i] + dt * dt * (2.0 * a[k, i] + a[k + 1, i]) / 6.0
            v[k + 1, i] = v[k, i] + dt * (a[k, i] + a[k + 1, i]) / 2.0
    return d
