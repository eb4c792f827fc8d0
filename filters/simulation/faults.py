"""What instruments get wrong beside noise: crooked axes, encoders, a lagging servo, the ground's echo, loss.

Axis errors of a theodolite: Deumlich & Staiger, *Instrumentenkunde der Vermessungstechnik* (2002). Echo at
low elevation: Barton, *Radar Equations for Modern Radar* (2013): the error swings as the direct ray and the
mirrored one go in and out of phase, and dies where the mirrored one leaves the beam.
"""

from typing import NamedTuple

import numpy as np

from filters.models.rows import AZIMUTH, ELEVATION, Sensor
from filters.simulation.scenario import Truth, at
from filters.simulation.simulate import NONE, PATCH, POLAR_CHANNELS, T0_NS, Observation, polar, wrapped

CLEAR = 6.0  # sigmas from which on a passing fault is labelled
LOSSES_APART_S = 1.0


class Faults(NamedTuple):
    """Of one instrument; zeros are none. Angles in rad."""

    tilt: tuple[float, float] = (0.0, 0.0)  # of the standing axis: small turn about east, about north
    collimation: float = 0.0  # sight not square to the tilting axis: azimuth + c / cos el
    trunnion: float = 0.0  # tilting axis not level: azimuth + i tan el
    eccentricity: tuple[float, float] = (0.0, 0.0)  # size and direction: azimuth + e sin(azimuth − direction)
    encoder_step: float = 0.0  # a stuck bit: now and then the azimuth jumps by it
    encoder_share: float = 0.05  # of the time
    lag_s: float = 0.0  # the servo is behind by this times the angular rate
    echo: float = 0.0  # 1: full reflection; swing of the elevation in beamwidths times this
    beam: float = np.radians(1.5)
    antenna_m: float = 5.0  # above the reflecting ground
    wave_m: float = 0.03
    loses_radps: float = np.inf  # angular rate at which it may lose its target
    loss_rate_hz: float = 0.0  # losses per second beside those
    loss_s: tuple[float, float] = (0.5, 4.0)
    pull_s: float = 0.4  # in which it comes back on target
    pull_off: float = np.radians(0.3)  # from so far
    delay_s: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # of each channel behind the stamp
    clock_s: float = 0.0
    drift: float = 0.0  # of the clock, s/s
    jitter_s: float = 0.0


def instrument(
    truth: Truth,
    sensor: Sensor,
    rate_hz: float,
    rng: np.random.Generator,
    faults: Faults = Faults(),  # noqa: B008
    t0_ns: int = T0_NS,
) -> Observation:
    """What ``sensor`` says; passing faults beyond CLEAR sigmas are labelled patches, lasting ones are not."""
    t_s = np.arange(truth.t_s[0] + rng.uniform(0.0, 1.0 / rate_hz), truth.t_s[-1], 1.0 / rate_hz)
    sigma = sensor.sigma[POLAR_CHANNELS]
    clean = _seen(truth, sensor, t_s)
    # drawn first, so that a fault does not change the noise
    noise, jitter = rng.normal(size=clean.shape) * sigma, rng.normal(size=len(t_s)) * faults.jitter_s
    values = clean.copy()
    for c, delay_s in enumerate(faults.delay_s):
        if delay_s:
            values[:, c] = _seen(truth, sensor, np.clip(t_s - delay_s, *truth.t_s[[0, -1]]))[:, c]
    rate = angular_rate(truth, sensor, t_s)
    passing = echo(clean, faults) + encoder(t_s, faults, rng)
    lost, off = losses(t_s, np.abs(rate).max(axis=1), faults, rng)
    passing += off
    values += lasting(clean, rate, faults) + passing + noise
    values[lost] = np.nan
    values[:, np.isnan(sigma)] = np.nan
    labels = np.where((np.abs(passing) > CLEAR * sigma) & np.isfinite(values), PATCH, NONE).astype(np.int8)
    late_s = faults.clock_s + faults.drift * (t_s - truth.t_s[0]) + jitter
    stamps = t0_ns + np.round((t_s + late_s) * 1e9).astype(np.int64)
    channels = np.arange(13)[POLAR_CHANNELS]
    return Observation(stamps, channels, wrapped(values, channels), clean, labels)


def _seen(truth: Truth, sensor: Sensor, t_s: np.ndarray) -> np.ndarray:
    """(m, 4) range, azimuth, elevation, range rate as they truly are."""
    p, v, _ = at(truth, t_s)
    return polar((p - sensor.offset_m) @ sensor.rotation.T, v @ sensor.rotation.T, sensor.refraction)


def angular_rate(truth: Truth, sensor: Sensor, t_s: np.ndarray, step_s: float = 0.02) -> np.ndarray:
    """(m, 2) rad/s of azimuth and elevation."""
    low, high = truth.t_s[[0, -1]]
    before, after = (np.clip(t_s + h, low, high) for h in (-step_s, step_s))
    change = (_seen(truth, sensor, after) - _seen(truth, sensor, before))[:, [AZIMUTH, ELEVATION]]
    change = (change + np.pi) % (2 * np.pi) - np.pi
    return change / (after - before)[:, None]


def lasting(clean: np.ndarray, rate: np.ndarray, faults: Faults) -> np.ndarray:
    """(m, 4) what crooked axes and the servo add: it depends on where one looks and how fast."""
    azimuth, elevation = clean[:, AZIMUTH], np.clip(clean[:, ELEVATION], -1.5, 1.5)
    out = np.zeros_like(clean)
    about_east, about_north = faults.tilt
    # the mount's up is tilted: a level target to the north rises by the turn about east
    rise = about_east * np.cos(azimuth) - about_north * np.sin(azimuth)
    side = about_east * np.sin(azimuth) + about_north * np.cos(azimuth)
    out[:, ELEVATION] = -rise
    out[:, AZIMUTH] = -side * np.tan(elevation)
    out[:, AZIMUTH] += faults.collimation / np.cos(elevation) + faults.trunnion * np.tan(elevation)
    size, direction = faults.eccentricity
    out[:, AZIMUTH] += size * np.sin(azimuth - direction)
    out[:, AZIMUTH] -= faults.lag_s * rate[:, 0]
    out[:, ELEVATION] -= faults.lag_s * rate[:, 1]
    return out


def echo(clean: np.ndarray, faults: Faults) -> np.ndarray:
    """(m, 4) the ground's echo: elevation swings while the mirrored ray is inside the beam."""
    out = np.zeros_like(clean)
    if faults.echo:
        elevation = np.maximum(clean[:, ELEVATION], 0.0)
        inside = np.exp(-4.0 * np.log(2.0) * (2.0 * elevation / faults.beam) ** 2)
        phase = 4.0 * np.pi * faults.antenna_m * np.sin(elevation) / faults.wave_m
        out[:, ELEVATION] = 0.3 * faults.echo * faults.beam * inside * np.sin(phase)
    return out


def encoder(t_s: np.ndarray, faults: Faults, rng: np.random.Generator) -> np.ndarray:
    """(m, 4) a bit that sticks for some seconds at a time: the azimuth is off by its worth."""
    out = np.zeros((len(t_s), 4))
    if faults.encoder_step and faults.encoder_share:
        on, now_s = False, t_s[0]
        while now_s < t_s[-1]:
            mean_s = 3.0 if on else 3.0 * (1.0 - faults.encoder_share) / faults.encoder_share
            end_s = now_s + rng.exponential(mean_s)
            if on:
                out[(t_s >= now_s) & (t_s < end_s), AZIMUTH] = faults.encoder_step
            on, now_s = not on, end_s
    return out


def losses(
    t_s: np.ndarray, rate_radps: np.ndarray, faults: Faults, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """((m,) lost, (m, 4) off): nothing while it is lost, then it slides back on target."""
    lost, off = np.zeros(len(t_s), bool), np.zeros((len(t_s), 4))
    chance = rng.random(len(t_s))
    step_s = np.diff(t_s, prepend=t_s[0])
    may = np.where(rate_radps > faults.loses_radps, 1.0 / LOSSES_APART_S, faults.loss_rate_hz) * step_s
    free_s = t_s[0]
    for k in np.flatnonzero(chance < may):
        if t_s[k] < free_s:
            continue
        end_s = t_s[k] + rng.uniform(*faults.loss_s)
        lost |= (t_s >= t_s[k]) & (t_s < end_s)
        back = (t_s >= end_s) & (t_s < end_s + 8.0 * faults.pull_s)
        start = faults.pull_off * rng.normal(size=2)
        slide = np.exp(-(t_s[back] - end_s) / faults.pull_s)[:, None]
        off[np.ix_(back, [AZIMUTH, ELEVATION])] = slide * start
        free_s = end_s + 8.0 * faults.pull_s
    return lost, off
