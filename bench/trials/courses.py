"""Flights for one radar: straight ones at any distance, air traffic, drones; and the radar's view of them."""

from typing import NamedTuple

import numpy as np

from bench.trials import flights, scene
from bench.trials.flights import Flight
from bench.trials.world import Sensor, Truth, scenario, simulate

STEP_S = 0.1
TURNS_DEGPS = (-3.0, -1.5, 0.0, 0.0, 0.0, 1.5, 3.0)  # rate-one turns, half of it, and straight more often
ROLL_S = 6.0  # a turn begins and ends over so long


class Scan(NamedTuple):
    """A radar: seconds from plot to plot; 1-sigma of range m, azimuth and elevation deg (NaN: none)."""

    every_s: float
    range_m: float
    azimuth_deg: float
    elevation_deg: float


def radar(scan: Scan, estimate: tuple[str, ...] = ()) -> Sensor:
    """A radar in the station's origin."""
    sigma = np.full(13, np.nan)
    sigma[:3] = scan.range_m, np.radians(scan.azimuth_deg), np.radians(scan.elevation_deg)
    return Sensor("radar", "radar", sigma, estimate=estimate)


def flight(name: str, truth: Truth) -> Flight:
    """A truth without an INS."""
    return flights.without_ins(name, simulate.T0_NS, truth)


def straight(distance_m: float, speed_mps: float, before_s: float, seconds: float, rng) -> Truth:
    """Level and straight, ``distance_m`` from the origin at ``before_s``, moving mostly across."""
    bearing = rng.uniform(-np.pi, np.pi)
    course = bearing + rng.choice([-1.0, 1.0]) * np.radians(rng.uniform(45.0, 90.0))  # outward on the whole
    up = np.clip(0.1 * distance_m, 100.0, 3000.0)
    there = np.array([distance_m * np.sin(bearing), distance_m * np.cos(bearing), up])
    v = speed_mps * np.array([np.sin(course), np.cos(course), 0.0])
    t_s = np.arange(0.0, seconds + 1.0)
    return Truth(
        t_s, there + (t_s - before_s)[:, None] * v, np.tile(v, (len(t_s), 1)), np.zeros((len(t_s), 3))
    )


def traffic(seconds: float, rng) -> Truth:
    """An airliner or a fast jet: 100 to 300 m/s, turns, climbs; begins 40 to 80 km out, at 3 to 11 km."""
    t_s = np.arange(0.0, seconds + STEP_S, STEP_S)
    turn, climb = (_legs(t_s, choices, rng) for choices in (TURNS_DEGPS, (-8.0, 0.0, 0.0, 8.0)))
    speed = rng.uniform(100.0, 300.0) + np.cumsum(_legs(t_s, (-0.4, 0.0, 0.0, 0.4), rng)) * STEP_S
    bearing = rng.uniform(-np.pi, np.pi)
    first = bearing + np.pi + rng.uniform(-1.0, 1.0)  # inward on the whole
    course = first + np.cumsum(np.radians(turn)) * STEP_S
    speed = np.clip(speed, 100.0, 300.0)
    v = np.column_stack([speed * np.sin(course), speed * np.cos(course), climb])
    far_m = rng.uniform(40e3, 80e3)
    start = np.array([far_m * np.sin(bearing), far_m * np.cos(bearing), rng.uniform(5e3, 9e3)])
    p = start + np.vstack([np.zeros(3), np.cumsum((v[1:] + v[:-1]) / 2, axis=0) * STEP_S])
    return Truth(t_s, p, v, np.gradient(v, t_s, axis=0))


def drone(seconds: float, rng) -> Truth:
    """A drone of the ``normal`` level, 2 to 4 km from the radar."""
    truth = scenario.flight(seconds, 1.0 / STEP_S * 2, "normal", rng)
    bearing, far_m = rng.uniform(-np.pi, np.pi), rng.uniform(2e3, 4e3)
    return truth._replace(p=truth.p + far_m * np.array([np.sin(bearing), np.cos(bearing), 0.0]))


def _legs(t_s: np.ndarray, choices, rng) -> np.ndarray:
    """(n,) one of ``choices`` for 20 to 80 s each, with ROLL_S from one to the next."""
    out, begin = np.zeros(len(t_s)), 0
    while begin < len(t_s):
        end = begin + round(rng.uniform(20.0, 80.0) / STEP_S)
        out[begin:end] = rng.choice(choices)
        begin = end
    window = np.ones(round(ROLL_S / STEP_S)) / round(ROLL_S / STEP_S)
    return np.convolve(np.pad(out, len(window), mode="edge"), window, mode="same")[len(window) : -len(window)]


def watched(name: str, truth: Truth, scan: Scan, seed: int, errors=simulate.NO_ERRORS, **lies) -> scene.Scene:
    """The radar's plots of ``truth``; ``lies`` as of `simulate.contaminate`."""
    sensor, rng = radar(scan), scene.stream(seed, f"{name}-{scan.every_s}")
    said = simulate.instrument(truth, sensor, 1.0 / scan.every_s, rng, errors)
    if lies:
        said = simulate.contaminate(said, sensor.sigma[said.channels], rng, **lies)
    return scene.assemble(flight(name, truth), [sensor], {0: said}, seed)
