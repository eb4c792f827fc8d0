"""Flights to test with: smooth and plausible; position, velocity and acceleration agree exactly.

A flight is a sequence of legs (speed, bank, height) turned into a velocity command, which the aircraft
follows as a critically damped second-order system. The jerk is constant between two samples, so the
trajectory is a cubic there and known exactly at any instant: ``at``.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

GRAVITY_MPS2 = 9.80665
TURN_RATE_LIMIT_RADPS = 1.2  # a banked turn at walking speed would spin
ROLL_RATE_RADPS = 0.8


class Truth(NamedTuple):
    """A trajectory in station ENU."""

    t_s: np.ndarray  # (n,) ascending
    p: np.ndarray  # (n, 3) position, m
    v: np.ndarray  # (n, 3) velocity, m/s
    a: np.ndarray  # (n, 3) acceleration, m/s²


class Level(NamedTuple):
    """How hard a flight manoeuvres."""

    speed_mps: tuple[float, float]
    bank_deg: float  # largest
    climb_mps: float  # largest
    accel_mps2: float  # along the track, largest
    gust_mps: float  # 1-sigma of a 3 s Gauss-Markov disturbance of the velocity command
    stop_share: float  # of legs flown at zero speed
    bandwidth_radps: float  # of the response to the velocity command


LEVELS = {
    "hover": Level((0.0, 0.0), 0.0, 0.0, 1.0, 0.4, 1.0, 1.5),
    "gentle": Level((5.0, 20.0), 15.0, 2.0, 1.0, 0.3, 0.1, 1.5),
    "normal": Level((10.0, 30.0), 35.0, 4.0, 2.5, 0.5, 0.1, 2.0),
    "aggressive": Level((10.0, 40.0), 60.0, 8.0, 5.0, 0.7, 0.15, 3.0),
}
HEIGHT_M = (40.0, 350.0)
RADIUS_M = 1500.0  # farther out, every leg becomes a turn towards home


def flight(
    seconds: float,
    rate_hz: float,
    manoeuvre: str,
    rng: np.random.Generator,
    start: tuple[float, float, float] = (0.0, 0.0, 120.0),
) -> Truth:
    """A flight of one of ``LEVELS`` around the station origin, ``rate_hz`` at least 20."""
    if manoeuvre not in LEVELS:
        raise ValueError(f"manoeuvre {manoeuvre!r}: choose one of {', '.join(LEVELS)}")
    level = LEVELS[manoeuvre]
    n = round(seconds * rate_hz) + 1
    dt_s = 1.0 / rate_hz
    commands = _legs(n, dt_s, level, rng)
    gust = gauss_markov(n, dt_s, 3.0, level.gust_mps, rng)
    limits = np.array([level.climb_mps, level.accel_mps2, level.bandwidth_radps, np.radians(level.bank_deg)])
    p, v, a = _fly(commands, gust, np.array(start, float), rng.uniform(-np.pi, np.pi), limits, dt_s)
    return Truth(np.arange(n) * dt_s, p, v, a)


def track(t_s: np.ndarray, p: np.ndarray) -> Truth:
    """A measured trajectory, (n,) and (n, 3), as ``Truth``: derivatives by central differences."""
    v = np.gradient(p, t_s, axis=0)
    return Truth(t_s, p, v, np.gradient(v, t_s, axis=0))


def at(truth: Truth, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity, acceleration, each (m, 3), at ``t_s`` (m,) within the flight.

    The cubic through position and velocity at both neighbours (Hermite): exact for a ``flight``.
    """
    k = np.clip(np.searchsorted(truth.t_s, t_s, side="right") - 1, 0, len(truth.t_s) - 2)
    step_s = (truth.t_s[k + 1] - truth.t_s[k])[:, None]
    h = (t_s - truth.t_s[k])[:, None]
    p, v, v_end = truth.p[k], truth.v[k], truth.v[k + 1]
    mean_v = (truth.p[k + 1] - p) / step_s
    a = (6 * mean_v - 4 * v - 2 * v_end) / step_s
    jerk = 6 * (v + v_end - 2 * mean_v) / step_s**2
    return p + h * (v + h * (a / 2 + h * jerk / 6)), v + h * (a + h * jerk / 2), a + h * jerk


def _legs(n: int, dt_s: float, level: Level, rng) -> np.ndarray:
    """(n, 3) speed m/s, bank rad, height m commanded; legs of 4 to 20 s, every other one straight."""
    commands = np.empty((n, 3))
    begin, turning = 0, False
    while begin < n:
        end = begin + max(1, round(rng.uniform(4.0, 20.0) / dt_s))
        speed = 0.0 if rng.random() < level.stop_share else rng.uniform(*level.speed_mps)
        bank = np.radians(level.bank_deg) * rng.uniform(0.4, 1.0) * rng.choice([-1.0, 1.0]) * turning
        commands[begin:end] = speed, bank, rng.uniform(*HEIGHT_M)
        begin, turning = end, not turning
    return commands


def gauss_markov(n: int, dt_s: float, tau_s: float, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) first-order Gauss-Markov process in balance: x ← e^(−dt/τ) x + σ √(1 − e^(−2dt/τ)) ξ."""
    return _decay(rng.normal(0.0, sigma, (n, 3)), np.exp(-dt_s / tau_s))


@njit(cache=True)
def _decay(noise, phi):
    x = noise.copy()
    for k in range(1, len(x)):
        x[k] = phi * x[k - 1] + np.sqrt(1.0 - phi * phi) * noise[k]
    return x


@njit(cache=True)
def _fly(commands, gust, start, heading, limits, dt):
    climb_limit, accel_limit, w, bank_limit = limits
    n = len(commands)
    p, v, a = np.empty((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    p[0] = start
    target = np.zeros(3)
    speed, bank = commands[0, 0], 0.0
    v[0, 0], v[0, 1] = speed * np.sin(heading), speed * np.cos(heading)
    for k in range(n - 1):
        speed_command, bank_command, height = commands[k]
        if np.hypot(p[k, 0], p[k, 1]) > RADIUS_M:
            inward = np.arctan2(-p[k, 0], -p[k, 1]) - heading
            inward = (inward + np.pi) % (2 * np.pi) - np.pi
            bank_command = np.sign(inward) * min(0.7 * bank_limit, abs(inward))
        bank += min(max(bank_command - bank, -ROLL_RATE_RADPS * dt), ROLL_RATE_RADPS * dt)
        speed += min(max(speed_command - speed, -accel_limit * dt), accel_limit * dt)
        rate = GRAVITY_MPS2 * np.tan(bank) / max(speed, 1.0)
        heading += dt * min(max(rate, -TURN_RATE_LIMIT_RADPS), TURN_RATE_LIMIT_RADPS)
        target[0], target[1] = speed * np.sin(heading), speed * np.cos(heading)
        climb = min(max(0.3 * (height - p[k, 2]), -climb_limit), climb_limit)
        target[2] += min(max(climb - target[2], -accel_limit * dt), accel_limit * dt)
        # v̈ = w² (target − v) − 2 w v̇ sets the jerk, held over the step
        jerk = w * w * (target + gust[k] - v[k]) - 2 * w * a[k]
        a[k + 1] = a[k] + dt * jerk
        v[k + 1] = v[k] + dt * (a[k] + dt * jerk / 2)
        p[k + 1] = p[k] + dt * (v[k] + dt * (a[k] / 2 + dt * jerk / 6))
    return p, v, a
