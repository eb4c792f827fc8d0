"""Pictures of the GA-BP-UKF paper's figures."""

import numpy as np
from matplotlib.figure import Figure

from bench.papers.m1 import baselines
from bench.papers.m1.convergence import Convergence
from bench.papers.m1.simulated_flight import FIRST_OUTLIER, RANGE_SIGMA_M, STEP_S, STEPS, SimulatedRun
from bench.papers.m1.simulations import SimulationErrors
from bench.papers.m1.smoothness import Watched
from bench.papers.show.picture import (
    DPI,
    FAULT,
    GREY,
    INK,
    OTHER,
    OURS,
    PANEL_IN,
    WIDTH_IN,
    decades,
    label,
    panels,
    signed_decades,
)

COLOURS = {"ga-bp-ukf": OURS, "bp-ekf": FAULT, "classic ukf, tuned": OTHER}
WATCHED = {"adaptive kalman + wavelet": FAULT, "ga-bp-ukf": OURS, "ga-bp-ukf, smoothed": OTHER}
ROULETTE = {"improved": OURS, "classic": FAULT}
ENOUGH = 3  # outliers in the flight that is shown
T_S = STEP_S * np.arange(1, STEPS + 1)


def simulation_1(found: dict[str, SimulationErrors]) -> Figure:
    """Distance to the truth, of the first flight and of all."""
    figure, (one, every) = panels(2)
    for name, colour in COLOURS.items():
        away = np.sqrt((found[name].clean ** 2).sum(axis=2))
        one.plot(T_S, away[0], color=colour, label=name)
        every.plot(T_S, away.mean(axis=0), color=colour, label=name)
        every.plot(T_S, np.median(away, axis=0), color=colour, linewidth=0.9, linestyle=":")
    decades(one)
    decades(every)
    label(one, "simulation 1, the first flight", "", "position error, m")
    label(every, f"{len(away)} flights: mean; dotted: median", "time, s", "position error, m")
    return figure


def simulation_2(found: dict[str, SimulationErrors], runs: list[SimulatedRun]) -> Figure:
    """Range of the first flight with ENOUGH outliers, measured and filtered, and the errors of all."""
    figure, (measured, filtered, every) = panels(3)
    true_m = np.array([np.linalg.norm(run.truth[:, :3], axis=1) for run in runs])
    off_m = np.array([run.z[:, 0] for run in runs]) - true_m
    hit = (np.abs(off_m) > 5.0 * RANGE_SIGMA_M) & (np.arange(STEPS) >= FIRST_OUTLIER)
    hits = hit.sum(axis=1)
    enough = min(ENOUGH, hits.max())
    one = int((hits >= enough).argmax())
    measured.plot(T_S, off_m[one], ".", color=GREY, label="measured")
    measured.plot(T_S[hit[one]], off_m[one][hit[one]], "o", color=FAULT, markersize=5, label="outlier")
    for name, colour in COLOURS.items():
        errors = found[name].dirty
        range_m = baselines.observe(runs[one].truth[:, :3] + errors[one])[:, 0]
        filtered.plot(T_S, range_m - true_m[one], color=colour, label=name)
        every.plot(T_S, np.sqrt((errors**2).sum(axis=2).mean(axis=0)), color=colour, label=name)
    signed_decades(measured, 10.0)
    signed_decades(filtered, 1.0)
    decades(every)
    label(
        measured,
        f"simulation 2, first flight with {enough} outliers or more",
        "",
        "measured − true range, m",
    )
    label(filtered, "the same, filtered", "", "filtered − true range, m")
    label(every, f"{len(errors)} flights", "time, s", "RMS position error, m")
    return figure


def convergence(found: dict[str, Convergence], starts: dict) -> Figure:
    """The genetic algorithm by either roulette, and what the trainings from each start come to."""
    figure = Figure(figsize=(WIDTH_IN, 2 * PANEL_IN), dpi=DPI, layout="constrained")
    axes = figure.subplot_mosaic([["error", "diversity"], ["trained", "trained"]])
    for name, colour in ROULETTE.items():
        axes["error"].plot(found[name].best, color=colour, label=name)
        axes["error"].plot(found[name].mean, color=colour, linestyle=":")
        axes["diversity"].plot(found[name].diversity, color=colour, label=name)
    axes["diversity"].set_ylim(bottom=0.0)
    boxes = [_box(name, starts[name]["after"]) for name in ("improved", "classic", "random")]
    axes["trained"].bxp(
        boxes, showfliers=False, medianprops={"color": OURS}, orientation="horizontal", widths=0.5
    )
    axes["trained"].invert_yaxis()
    label(axes["error"], "best; dotted: population", "generation", "mean squared error, σ²")
    label(axes["diversity"], "diversity", "generation", "spread of genes, share")
    label(axes["trained"], "after training, by start", "held-out mean squared error, σ²", "")
    return figure


def gradient(watched: Watched, level: str) -> Figure:
    """A theodolite's range by each filter: its error, and its step-to-step change beside the truth's."""
    figure, (error, step) = panels(2)
    true_m, raw = watched.clean[:, 0], watched.values["raw"][:, 0]
    error.plot(watched.t_s, raw - true_m, ".", color=GREY, markersize=2, label="raw")
    for name, colour in WATCHED.items():
        range_m = watched.values[name][:, 0]
        error.plot(watched.t_s, range_m - true_m, color=colour, linewidth=1.0, label=name)
        step.plot(watched.t_s[1:], np.abs(np.diff(range_m)), color=colour, linewidth=0.8, label=name)
    true_step = np.abs(np.diff(true_m))
    step.plot(watched.t_s[1:], true_step, color=INK, linewidth=1.0, linestyle="--", label="truth")
    signed_decades(error, 1.0)
    decades(step)
    step.set_ylim(bottom=1e-3)
    label(error, f"theodolite, {level} flight", "", "range − true range, m")
    label(step, "gradient", "time, s", "|change of range| a step, m")
    return figure


def _box(name: str, quantiles: list[float]) -> dict:
    return dict(zip(("whislo", "q1", "med", "q3", "whishi"), quantiles, strict=True)) | {"label": name}
