"""Pictures of the GA-BP-UKF paper's figures."""

import numpy as np
from matplotlib.figure import Figure

from gcs.bench import baselines_m1 as baselines
from gcs.bench.papers_convergence import Convergence
from gcs.bench.papers_m1 import FIRST_OUTLIER, RANGE_SIGMA_M, STEP_S, STEPS, Run
from gcs.bench.papers_picture import CLASSIC, FAULT, GREY, INK, OURS, label, panels
from gcs.bench.papers_simulations import Errors
from gcs.bench.smoothness_m1 import Watched

COLOURS = {"ga-bp-ukf": OURS, "bp-ekf": FAULT, "classic ukf, tuned": CLASSIC}
WATCHED = {"adaptive kalman + wavelet": FAULT, "ga-bp-ukf": OURS, "ga-bp-ukf, smoothed": CLASSIC}
ROULETTE = {"improved": OURS, "classic": FAULT}
T_S = STEP_S * np.arange(1, STEPS + 1)


def simulation_1(found: dict[str, Errors]) -> Figure:
    """Distance to the truth, of the first flight and of all."""
    figure, (one, every) = panels(2)
    for name, colour in COLOURS.items():
        away = np.sqrt((found[name].clean ** 2).sum(axis=2))
        one.plot(T_S, away[0], color=colour, label=name)
        every.plot(T_S, away.mean(axis=0), color=colour, label=f"{name}, mean")
        every.plot(T_S, np.median(away, axis=0), color=colour, linewidth=0.9, linestyle=":")
    for axes, title in ((one, "simulation 1, first flight"), (every, f"{len(away)} flights; dotted: median")):
        axes.set_yscale("log")
        label(axes, title, "time, s", "position error, m", "upper right")
    return figure


def simulation_2(found: dict[str, Errors], run: Run) -> Figure:
    """Range of the first flight, measured and filtered, and the position errors of all."""
    figure, (measured, filtered, every) = panels(3)
    true_m = np.linalg.norm(run.truth[:, :3], axis=1)
    off_m = run.z[:, 0] - true_m
    hit = (np.abs(off_m) > 5.0 * RANGE_SIGMA_M) & (np.arange(STEPS) >= FIRST_OUTLIER)
    measured.plot(T_S, off_m, ".", color=GREY, label="measured")
    measured.plot(T_S[hit], off_m[hit], "o", color=FAULT, markersize=5, label="outlier")
    for name, colour in COLOURS.items():
        errors = found[name].dirty
        range_m = baselines.observe(run.truth[:, :3] + errors[0])[:, 0]
        filtered.plot(T_S, range_m - true_m, color=colour, label=name)
        every.plot(T_S, np.sqrt((errors**2).sum(axis=2).mean(axis=0)), color=colour, label=name)
    measured.set_yscale("symlog", linthresh=10.0)
    filtered.set_yscale("symlog", linthresh=1.0)
    every.set_yscale("log")
    label(measured, "simulation 2, first flight", "", "measured − true range, m", "upper left", 2)
    label(filtered, "the same, filtered", "", "filtered − true range, m", "lower right", 3)
    label(every, f"{len(errors)} flights", "time, s", "RMS position error, m", "upper right")
    return figure


def convergence(found: dict[str, Convergence], starts: dict) -> Figure:
    """The genetic algorithm by either roulette, and what 20 trainings from each start come to."""
    figure, (error, diversity, trained, spare) = panels(2, 2, share_x=False)
    spare.remove()
    for name, colour in ROULETTE.items():
        one = found[name]
        error.plot(one.best, color=colour, label=f"{name}, best")
        error.plot(one.mean, color=colour, linestyle=":", label=f"{name}, population's mean")
        diversity.plot(one.diversity, color=colour, label=name)
    diversity.set_ylim(bottom=0.0)
    label(error, "genetic algorithm: error, the inverse of fitness", "generation", "mean squared error, σ²")
    label(diversity, "diversity of the population", "generation", "spread of genes, share of the start's")
    boxes = [_box(name, starts[name]["after"]) for name in ("improved", "classic", "random")]
    trained.bxp(boxes, showfliers=False, medianprops={"color": OURS}, orientation="horizontal", widths=0.5)
    trained.invert_yaxis()
    label(trained, "after training: held-out error by start", "mean squared error, σ²", "")
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
    step.plot(
        watched.t_s[1:], np.abs(np.diff(true_m)), color=INK, linewidth=1.0, linestyle="--", label="truth"
    )
    error.set_yscale("symlog", linthresh=1.0)
    step.set_yscale("log")
    step.set_ylim(bottom=1e-4)
    label(error, f"theodolite, {level} flight", "", "range − true range, m", "lower right", 4)
    label(
        step, "gradient: change from one value to the next", "time, s", "|step| of range, m", "lower right", 4
    )
    return figure


def _box(name: str, quantiles: list[float]) -> dict:
    return dict(zip(("whislo", "q1", "med", "q3", "whishi"), quantiles, strict=True)) | {"label": name}
