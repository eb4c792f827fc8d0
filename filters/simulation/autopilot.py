"""What an autopilot says of itself: its own filter's output, so nothing in it is white, and all is late.

Position: a slow error, a quicker one, and what a GPS fault does to it. Velocity: an error over seconds that
grows with acceleration. Acceleration: the accelerometers' vibration, which comes and goes, and gravity that
leaks through the attitude's error. Each group has its own delay behind the stamp. The figures are those of
recorded flights of ArduPilot against their truth, and a little more.
"""

from typing import NamedTuple

import numpy as np

from filters.simulation.scenario import GRAVITY_MPS2, Truth, at, gauss_markov
from filters.simulation.simulate import INS_CHANNELS, NONE, PATCH, T0_NS, Observation


class Glitch(NamedTuple):
    """A GPS fault: a jump of position that the filter follows, or silence in which it drifts."""

    begin_s: float
    seconds: float
    jump_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_mps2: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of a silence: error ½ drift t²


class Autopilot(NamedTuple):
    """How wrong, how late and how often."""

    state_hz: float = 10.0  # position and velocity
    imu_hz: float = 25.0
    latency_s: tuple[float, float, float] = (0.10, 0.12, 0.02)  # position, velocity, acceleration
    slow_m: float = 1.2  # 1-sigma per axis, correlated over slow_s
    slow_s: float = 100.0
    quick_m: float = 0.15
    quick_s: float = 3.0
    velocity_mps: float = 0.06
    velocity_s: float = 2.0
    swing_s: float = 0.02  # velocity error per m/s² of acceleration: its filter lags in a manoeuvre
    vibration_mps2: float = 0.8  # typical; its level wanders by half over vibration_s
    vibration_s: float = 8.0
    level_rad: float = 0.01  # attitude error, correlated over level_s
    level_s: float = 30.0
    steps: tuple[float, float] = (0.01, 0.01)  # of position m and velocity m/s in the message
    follow_s: float = 1.5  # in which it follows a jump of its GPS, and comes back


def glitches(seconds: float, per_hour: float, rng: np.random.Generator) -> tuple[Glitch, ...]:
    """Faults at random, none in the first 10 s: jumps of 10 to 60 m for 5 to 30 s, silences of 10 to 60 s."""
    out = []
    for _ in range(rng.poisson(per_hour * seconds / 3600.0)):
        begin_s, turn = rng.uniform(10.0, max(seconds, 11.0)), rng.uniform(0.0, 2 * np.pi)
        way = np.array([np.sin(turn), np.cos(turn), 0.3 * rng.normal()])
        if rng.random() < 0.5:
            jump = tuple(float(x) for x in rng.uniform(10.0, 60.0) * way)
            out.append(Glitch(begin_s, rng.uniform(5.0, 30.0), jump_m=jump))
        else:
            drift = tuple(float(x) for x in rng.uniform(0.005, 0.05) * way)
            out.append(Glitch(begin_s, rng.uniform(10.0, 60.0), drift_mps2=drift))
    return tuple(sorted(out))


def ins(
    truth: Truth,
    rng: np.random.Generator,
    about: Autopilot = Autopilot(),  # noqa: B008
    faults: tuple[Glitch, ...] = (),
    t0_ns: int = T0_NS,
) -> Observation:
    """Nine channels in station ENU, NaN where a message has no such value; GPS faults labelled as patches."""
    state_s, imu_s = (_steady(truth, hz, rng) for hz in (about.state_hz, about.imu_hz))
    state, label, clean = _state(truth, state_s, rng, about, faults)
    force, true_force = _force(truth, imu_s, rng, about)
    t_s = np.concatenate([state_s, imu_s])
    n, m = len(state_s), len(imu_s)
    values, true = np.full((n + m, 9), np.nan), np.full((n + m, 9), np.nan)
    values[:n, :6], true[:n, :6] = state, clean
    values[n:, 6:], true[n:, 6:] = force, true_force
    labels = np.zeros((n + m, 9), np.int8)
    labels[:n, :6] = label
    order = np.argsort(t_s, kind="stable")
    stamps = t0_ns + np.round(t_s[order] * 1e9).astype(np.int64)
    return Observation(stamps, np.arange(13)[INS_CHANNELS], values[order], true[order], labels[order])


def _state(truth: Truth, t_s, rng, about: Autopilot, faults) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position and velocity (n, 6) as told at stamps ``t_s``, their labels, and the truth then."""
    n, dt_s = len(t_s), 1.0 / about.state_hz
    late_p, late_v, _ = about.latency_s
    p = at(truth, np.maximum(t_s - late_p, truth.t_s[0]))[0]
    _, v, a = at(truth, np.maximum(t_s - late_v, truth.t_s[0]))
    p = p + gauss_markov(n, dt_s, about.slow_s, about.slow_m, rng)
    p += gauss_markov(n, dt_s, about.quick_s, about.quick_m, rng)
    v = v + gauss_markov(n, dt_s, about.velocity_s, about.velocity_mps, rng) - about.swing_s * a
    off = followed(t_s, faults, about.follow_s)
    p += off
    v += np.gradient(off, t_s, axis=0)
    values = np.hstack(
        [np.round(p / about.steps[0]) * about.steps[0], np.round(v / about.steps[1]) * about.steps[1]]
    )
    wrong = np.linalg.norm(off, axis=1) > 3.0 * about.slow_m
    label = np.where(wrong[:, None], PATCH, NONE) * np.array([1, 1, 1, 0, 0, 0])
    return values, label, np.hstack(at(truth, t_s)[:2])


def followed(t_s: np.ndarray, faults: tuple[Glitch, ...], follow_s: float) -> np.ndarray:
    """(n, 3) m: position error of an autopilot that follows its GPS's ``faults`` with a first-order lag."""
    asked = np.zeros((len(t_s), 3))
    for fault in faults:
        since_s = t_s - fault.begin_s
        during = (since_s >= 0) & (since_s < fault.seconds)
        drift = 0.5 * np.array(fault.drift_mps2) * np.where(during, since_s, 0.0)[:, None] ** 2
        asked += np.where(during[:, None], np.array(fault.jump_m), 0.0) + drift
    out = np.zeros_like(asked)
    for k in range(1, len(t_s)):
        share = 1.0 - np.exp(-(t_s[k] - t_s[k - 1]) / follow_s)
        out[k] = out[k - 1] + share * (asked[k] - out[k - 1])
    return out


def _force(truth: Truth, t_s, rng, about: Autopilot) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration (m, 3) as told at stamps ``t_s``, gravity taken off by attitude, and the truth then."""
    m, dt_s = len(t_s), 1.0 / about.imu_hz
    a = at(truth, np.maximum(t_s - about.latency_s[2], truth.t_s[0]))[2]
    level = np.exp(0.5 * gauss_markov(m, dt_s, about.vibration_s, 1.0, rng))
    tilt = gauss_markov(m, dt_s, about.level_s, about.level_rad, rng)
    force = a + np.array([0.0, 0.0, GRAVITY_MPS2])
    leak = np.cross(tilt, force)  # a small rotation of what the accelerometers feel
    return a + leak + rng.normal(size=(m, 3)) * about.vibration_mps2 * level, at(truth, t_s)[2]


def _steady(truth: Truth, rate_hz: float, rng) -> np.ndarray:
    """Stamps: a steady rate with a phase of its own."""
    return np.arange(truth.t_s[0] + rng.uniform(0.0, 1.0 / rate_hz), truth.t_s[-1], 1.0 / rate_hz)
