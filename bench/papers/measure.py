"""Everything that ``python -m bench papers`` measures, and the pictures of it."""

from pathlib import Path

import numpy as np

from bench.accuracy import FIRST_SEED
from bench.papers.counts import Counts
from bench.papers.m1 import baselines, convergence, simulations, smoothness
from bench.papers.m1 import network as default_network
from bench.papers.m1.simulated_flight import FIRST_OUTLIER
from bench.papers.m2 import recorded as recorded_flight
from bench.papers.m2 import wind
from bench.papers.m3 import joined, screening
from bench.papers.show import pictures_m1, pictures_m2, pictures_m3
from bench.papers.show.report import Drawn
from gcs.learning import training
from gcs.outputs.console import say

LEVELS = ("hover", "normal")
SIZES = (screening.SIZE, screening.SMALLER)


def m1(counts: Counts) -> tuple[dict, list[Drawn]]:
    """Rows 1 to 6: the GA-BP-UKF paper."""
    say("simulations 1 and 2")
    plan = simulations.PLAN
    compared = simulations.methods(counts.lessons, counts.tuning, plan)
    errors = simulations.simulations(compared, counts.runs)
    known = simulations.start_table(counts.runs)
    say(f"{counts.trainings} trainings of each start")
    lessons = simulations.lessons(baselines.ekf, counts.lessons)
    starts = training.starts(lessons, plan, counts.trainings)
    converged = convergence.converge(*training.pool(lessons.fit), plan, counts.trainings)
    say("theodolite flights")
    smooth = {level: smoothness.smoothness(level, counts.theodolites) for level in LEVELS}
    say("the default network")
    network = default_network.measure(counts.flights, counts.unseen, _silent)
    found = {
        "simulations": simulations.figures(errors),
        "start_known": known,
        "training_starts": starts,
        "smoothness": smooth,
        "network": network,
    }
    return found, _drawn_m1(errors, converged, starts)


def _drawn_m1(errors: dict, converged: dict, starts: dict) -> list[Drawn]:
    picture = pictures_m1
    runs = simulations.flights(len(errors["ekf"].dirty), first_outlier=FIRST_OUTLIER)
    theodolite = [
        Drawn(
            f"m1-gradient-{level}",
            picture.gradient(smoothness.watch(level, FIRST_SEED), level),
            f"M1, smoothness, {level} flight: the gradient beside the true error.",
        )
        for level in LEVELS
    ]
    return [
        Drawn("m1-simulation-1", picture.simulation_1(errors), "M1, simulation 1: no outliers."),
        Drawn("m1-simulation-2", picture.simulation_2(errors, runs), "M1, simulation 2: outliers in range."),
        Drawn("m1-genetic", picture.convergence(converged, starts), "M1: roulettes, and starts of training."),
        *theodolite,
    ]


def m2(counts: Counts, recorded: Path) -> tuple[dict, list[Drawn]]:
    """Rows 8 to 10: the wind paper."""
    say("wind")
    found = {
        "wind": {name: rmse.tolist() for name, rmse in wind.table(counts.winds).items()},
        "navigation": wind.navigation(counts.winds),
        "recorded": recorded_flight.measure(recorded),
    }
    picture = pictures_m2
    drawn = [
        Drawn("m2-wind", picture.filters(FIRST_SEED), "M2: the wind and three filters."),
        Drawn("m2-navigation", picture.navigation(FIRST_SEED), "M2: position without and with the wind."),
    ]
    return found, drawn


def m3(counts: Counts) -> tuple[dict, list[Drawn]]:
    """Row 7: the screening paper."""
    alone, both = [], []
    for size in SIZES:
        for regular in (False, True):
            case = f"outliers of {size[0]:g} to {size[1]:g} σ, {'regular' if regular else 'irregular'} runs"
            say(f"screening, {case}")
            scores = screening.table(counts.records, size, regular=regular)
            alone.append({"case": case, "scores": {name: _plain(one) for name, one in scores.items()}})
            seeds = range(FIRST_SEED, FIRST_SEED + counts.joined)
            found = [joined.joined(seed, size, counts.points, regular=regular) for seed in seeds]
            both.append({"case": case, "seeds": len(found)} | _means(found))
    drawn = [
        Drawn(
            f"m3-channel-{size[0]:g}-sigma",
            pictures_m3.channel(FIRST_SEED, size),
            f"M3: a range with outliers of {size[0]:g} to {size[1]:g} σ, and what is found.",
        )
        for size in SIZES
    ]
    return {"alone": alone, "joined": both}, drawn


def _plain(score: screening.Score) -> dict[str, float]:
    return {name: float(value) for name, value in score._asdict().items()}


def _means(found: list[joined.Joined]) -> dict[str, list[float]]:
    return {who: np.mean([getattr(one, who) for one in found], axis=0).tolist() for who in found[0]._fields}


def _silent(line: str) -> None:
    """The training's own report is not this one's."""
