"""What the trials of starts, ramps, liars and systematic errors have in common."""

import argparse
import multiprocessing
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from bench.trials import flights, run, scene, score
from bench.trials.world import Truth, scenario, simulate

WRONG_SIGMA, WRONG_M = 5.0, 10.0  # a state further off than both, that does not call itself ambiguous


def options(parser: argparse.ArgumentParser, doc: str, seeds: str, of: Sequence[str]) -> None:
    """Those of every such trial."""
    parser.description, parser.formatter_class = doc, argparse.RawDescriptionHelpFormatter
    parser.add_argument("--data", type=Path, help="folder of the recorded flights; else GCS_DATA")
    parser.add_argument("--flight", nargs="+", default=list(of), help=", ".join(flights.names()))
    parser.add_argument("--method", default="default")
    parser.add_argument("--setting", nargs="*", default=[], metavar="NAME=VALUE", help="of the estimator")
    seeds_option(parser, seeds)
    parser.add_argument("--jobs", type=int, default=2)


def seeds_option(parser: argparse.ArgumentParser, default: str) -> None:
    """``--seeds``: a range."""
    parser.add_argument("--seeds", type=_range, default=default, help="FIRST:END, or one")


def _range(text: str) -> range:
    first, _, end = text.partition(":")
    return range(int(first), int(end or int(first) + 1))


def told(seeds: range) -> str:
    """As it is asked for."""
    return f"{seeds.start}:{seeds.stop}"


def maker(asked: argparse.Namespace, **more: float) -> Callable:
    """sensors → estimator, as asked."""
    settings = {name: float(x) for name, x in (s.split("=") for s in asked.setting)}
    return lambda sensors: run.make_estimator(asked.method, sensors, **(more | settings))


def spread_out(what: Callable, asked: argparse.Namespace, cases: list) -> list:
    """``what(asked, case)`` of every case, on a few processes."""
    if asked.jobs <= 1:
        return [what(asked, case) for case in cases]
    with multiprocessing.get_context("fork").Pool(asked.jobs) as pool:
        return pool.map(partial(what, asked), cases, chunksize=max(1, len(cases) // (8 * asked.jobs)))


def flight(asked: argparse.Namespace, name: str, seed: int, seconds: float) -> flights.Flight:
    """``seconds`` of a flight, from a moment aloft that ``seed`` chooses where it is a recorded one."""
    if name in flights.LEVELS:
        return flights.simulated(name, seed, seconds)
    whole = flights.load(name, flights.folder(asked.data), seed, None)
    begin_s = flights.aloft_s(whole.truth)
    last_s = landed_s(whole.truth) - seconds
    rng = scene.stream(seed, name)
    return flights.cut(whole, rng.uniform(begin_s, max(last_s, begin_s + 1.0)), seconds)


def landed_s(truth: Truth) -> float:
    """When it was last clear of the ground."""
    clear = truth.p[:, 2] - truth.p[0, 2] > flights.ALOFT_M
    return float(truth.t_s[len(clear) - 1 - np.argmax(clear[::-1])])


def parked(seed: int, seconds: float) -> flights.Flight:
    """A vehicle on the ground, its autopilot on."""
    rng, n = np.random.default_rng([seed, 77]), round(seconds * 20) + 1
    place = np.array([*rng.uniform(-200.0, 200.0, 2), 1.0])
    truth = scenario.Truth(np.arange(n) / 20.0, np.tile(place, (n, 1)), np.zeros((n, 3)), np.zeros((n, 3)))
    return flights.with_ins("ground", truth, rng)


def watched(seen_flight, names, seed: int, share: float = 0.0, change: Callable | None = None, estimate=()):
    """As `scene.watch`, but ``change(name, observation, sensor)`` may tamper with what an instrument says."""
    sensors = [scene.instrument(seen_flight, name, estimate) for name in names]
    seen = {}
    for k, sensor in enumerate(sensors):
        if sensor.kind == "ins":
            continue
        said = scene.say(seen_flight, sensor, seed, scene.Wrong(share))
        seen[k] = change(sensor.name, said, sensor) if change else said
    return scene.assemble(seen_flight, sensors, seen, seed)


def confident(seen: scene.Scene, ran: run.Run, t_ns: np.ndarray, axes: int = 3) -> np.ndarray:
    """(k,) bool: wrong by WRONG_SIGMA on some axis and by WRONG_M, and not ambiguous."""
    error_m, off, P, k = score.errors(seen.flight, ran.track, t_ns, True, axes)
    beyond = np.max(np.abs(off) / np.sqrt(np.einsum("kii->ki", P)), axis=1) > WRONG_SIGMA
    out = beyond & (error_m > WRONG_M)
    if "ambiguous" in ran.track.dtype.names:
        out &= ~(ran.track["ambiguous"][k] > 0)
    return out


def lies(said: simulate.Observation, since_ns: int, values: np.ndarray) -> simulate.Observation:
    """``said`` with ``values`` (m, c) from ``since_ns`` on, labelled as a patch."""
    rows = said.t_ns >= since_ns
    mixed = np.where(rows[:, None], values, said.values)
    labels = said.labels.copy()
    labels[np.isfinite(mixed) & (mixed != said.values)] = simulate.PATCH
    return said._replace(values=simulate.wrapped(mixed, said.channels), labels=labels)


def by_key(cases: list, got: list, key: Callable) -> dict[str, list]:
    """Results in groups, in the order of the cases."""
    groups: dict[str, list] = {}
    for case, one in zip(cases, got, strict=True):
        groups.setdefault(key(case), []).append(one)
    return groups


def plain_table(titles: Sequence[str], lines: dict[str, Sequence[float]]) -> str:
    """Names and numbers in columns."""

    def text(x: float) -> str:
        return (
            "-" if np.isnan(x) else f"{x:.3f}" if abs(x) < 1 else f"{x:.2f}" if abs(x) < 100 else f"{x:.3g}"
        )

    table = [["", *titles]] + [[name, *(text(float(x)) for x in many)] for name, many in lines.items()]
    width = [max(len(line[k]) for line in table) for k in range(len(table[0]))]
    return "\n".join(
        "  ".join([line[0].ljust(width[0]), *(x.rjust(w) for x, w in zip(line[1:], width[1:], strict=True))])
        for line in table
    )
