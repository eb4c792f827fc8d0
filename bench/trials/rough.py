"""Simulated flights in a rough world: gusts, an autopilot's own errors and GPS faults, faulty instruments.

calm       gusts only; the autopilot's errors are correlated, late and shaken, the instruments only noisy
gps        GPS faults too, about two a flight
tilt collimation eccentricity encoder lag echo loss stamps clock      that one fault, in every instrument
mild hard  all of them, small or large, GPS faults and outliers besides
"""

import argparse
import itertools

import numpy as np

from bench.trials import columns, common, flights, run, scene, score
from bench.trials.world import autopilot, faults, gusts, scenario, simulate

DEG = np.radians(1.0)
SIZES = {  # fault → its fields when it is large, 1-sigma of a normal draw where it is an error of set-up
    "tilt": {"tilt": 0.02 * DEG},
    "collimation": {"collimation": 0.02 * DEG, "trunnion": 0.02 * DEG},
    "eccentricity": {"eccentricity": 0.02 * DEG},
    "encoder": {"encoder_step": 0.1 * DEG},
    "lag": {"lag_s": 0.01},
    "echo": {"echo": 1.0, "beam": 10.0 * DEG},
    "loss": {"loss_rate_hz": 0.05, "loses_radps": 0.25},
    "stamps": {"delay_s": 0.05},
    "clock": {"clock_s": 0.05, "drift": 2e-5, "jitter_s": 0.002},
}
SMALL = 0.2  # of the large size
WORLDS = ("calm", "gps", *SIZES, "mild", "hard")
SHARES = {"mild": 0.02, "hard": 0.08}
RATE_HZ = 100.0
WIND_MPS = 10.0  # at 6 m: between light and moderate
GPS_PER_HOUR = 60.0


def options(parser: argparse.ArgumentParser) -> None:
    common.options(parser, __doc__, "0:2", ("gentle", "aggressive"))
    parser.add_argument("--world", nargs="+", default=list(WORLDS), choices=list(WORLDS))
    parser.add_argument("--sensors", nargs="+", default=list(scene.STANDARD))
    parser.add_argument("--estimate", nargs="*", default=["bias", "clock"], help="of every instrument")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--no-told", action="store_true")


def main(asked: argparse.Namespace) -> None:
    cases = list(itertools.product(asked.world, asked.flight, asked.seeds))
    got = common.spread_out(one, asked, cases)
    print(f"{asked.method}: {' '.join(asked.sensors)}, estimated: {' '.join(asked.estimate) or 'nothing'}")
    print(columns.table(common.by_key(cases, got, lambda c: f"{c[0]}, {c[1]}")))


def one(asked, case) -> dict:
    """Figures of one flight."""
    kind, level, seed = case
    flight = fly(kind, level, seed, asked.seconds)
    seen = watch(flight, kind, asked.sensors, seed, tuple(asked.estimate))
    make = common.maker(asked)
    labelled = bool((seen.labels != simulate.NONE).any())
    told = run.tried(seen, make, told=True) if labelled and not asked.no_told else None
    return score.figures(seen, run.tried(seen, make), told)


def fly(kind: str, level: str, seed: int, seconds: float) -> flights.Flight:
    """A gusty flight and what its autopilot says."""
    rng = scene.stream(seed, f"rough-{level}")
    calm = scenario.flight(seconds, RATE_HZ, level, rng)
    airframe = gusts.AIRFRAMES["copter" if level in ("hover", "gentle") else "plane"]
    truth = gusts.buffeted(calm, WIND_MPS, airframe, rng, (WIND_MPS, 0.0, 0.0))
    broken = autopilot.glitches(seconds, GPS_PER_HOUR, rng) if kind in ("gps", "mild", "hard") else ()
    flight, labels = flights.told_by(level, truth, autopilot.ins(truth, rng, faults=broken))
    return flight._replace(ins_labels=labels)


def watch(flight, kind: str, names, seed: int, estimate: tuple[str, ...]) -> scene.Scene:
    """Every instrument with faults of its own."""
    sensors = [scene.instrument(flight, name, estimate) for name in names]
    seen = {}
    for k, sensor in enumerate(sensors):
        if sensor.kind == "ins":
            continue
        rng = scene.stream(seed, sensor.name)
        rate_hz = scene.MAKES[scene.SITES[sensor.name].make].rate_hz
        said = faults.instrument(flight.truth, sensor, rate_hz, rng, draw(kind, sensor.kind, rng))
        seen[k] = simulate.contaminate(said, sensor.sigma[said.channels], rng, SHARES.get(kind, 0.0))
    return scene.assemble(flight, sensors, seen, seed)


def draw(kind: str, make: str, rng) -> faults.Faults:
    """The faults of one instrument in a world; the ground's echo is a radar's affair."""
    if kind in ("calm", "gps"):
        return faults.Faults()
    scale = SMALL if kind == "mild" else 1.0
    fields = {}
    for name in SIZES if kind in ("mild", "hard") else (kind,):
        if name == "echo" and make != "radar":
            continue
        fields |= {field: drawn(field, scale * size, rng) for field, size in SIZES[name].items()}
    return faults.Faults(**fields)


def drawn(field: str, size: float, rng):
    """A value of one field of `faults.Faults`."""
    if field == "tilt":
        return tuple(float(x) for x in rng.normal(0.0, size, 2))
    if field == "eccentricity":
        return size, float(rng.uniform(0.0, 2 * np.pi))
    if field == "delay_s":
        return float(abs(rng.normal(0.0, size))), 0.0, 0.0, 0.0
    if field in ("collimation", "trunnion", "clock_s", "drift", "lag_s"):
        return float(rng.normal(0.0, size))
    if field == "beam":
        return SIZES["echo"]["beam"]
    if field == "loses_radps":
        return size if size >= 0.1 else np.inf  # a mild world has no such losses
    return size
