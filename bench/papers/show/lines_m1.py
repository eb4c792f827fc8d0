"""The GA-BP-UKF paper: ours beside the paper's and the baselines'."""

import numpy as np

from bench.papers.show import lines_learning
from bench.papers.show.report import Grid, Line

PAPER = {"bp-ekf": (31.5347, 12.1745, 18.8466, 9.7875), "ga-bp-ukf": (9.0323, 9.6778, 11.9063, 6.5939)}
PAPER_GRADIENT_M = {"adaptive kalman + wavelet": 4.0753, "ga-bp-ukf": 2.0552}
WAVELET = "adaptive kalman + wavelet"
HALF, RISE = 0.5, 1.1


def lines(found: dict) -> list[Line]:
    """Rows 1 to 6 out of what `papers.measure.m1` found."""
    return [
        *_accuracy(found["simulations"], found["start_known"]),
        _outliers(found["simulations"]),
        *(_gradient(level, one) for level, one in found["smoothness"].items()),
        *lines_learning.lines(found),
    ]


def grids(found: dict) -> list[Grid]:
    """The figures behind them."""
    simulations = [
        (name, *(f"{figure:.3f}" for figure in one.values())) for name, one in found["simulations"].items()
    ]
    known = [tuple(f"{figure:.3g}" for figure in one.values()) for one in found["start_known"]]
    return [
        Grid(
            "simulations 1 and 2: position error per axis, m",
            ("method", "mean absolute", "median flight", "RMSE", "RMSE with outliers", "ratio"),
            simulations,
        ),
        Grid(
            "what hangs on the start: mean absolute error per axis, m, without networks",
            ("start known to, m", "EKF", "UKF", "ratio"),
            known,
        ),
        lines_learning.grid(found),
        *(_smoothness(level, one) for level, one in found["smoothness"].items()),
    ]


def _accuracy(found: dict, known: list[dict]) -> list[Line]:
    mae = {name: one["mae_m"] for name, one in found.items()}
    paper, paper_bp = (float(np.mean(PAPER[name])) for name in ("ga-bp-ukf", "bp-ekf"))
    ours, alone, bp = mae["ga-bp-ukf"], mae["ga-bp-ukf, no network"], mae["bp-ekf"]
    ekf, ukf = mae["ekf, tuned"], mae["classic ukf, tuned"]
    starts = ", ".join(f"{one['ratio']:.2f} at {one['start_m']:.0f} m" for one in known)
    return [
        Line(
            1,
            "simulation 1: mean absolute error, and its ratio to BP-EKF",
            f"{paper:.2f} to {paper_bp:.2f} m: {paper / paper_bp:.2f}",
            f"{ours:.3f} m: {ours / bp:.2f}",
            f"BP-EKF {bp:.3f} m, EKF {mae['ekf']:.3f} m",
            f"≤ {HALF}",
            ours <= HALF * bp,
            f"The ratio hangs on how well the start is known; UKF to EKF, no networks: {starts}.",
        ),
        Line(
            1,
            "the same, network off, and its ratio to EKF",
            "",
            f"{alone:.3f} m: {alone / mae['ekf']:.2f}",
            f"with the network's whole output {mae['ga-bp-ukf, full gain']:.3f} m",
            "stated",
            None,
            f"The network changes our error by {ours / alone - 1.0:+.1%}, that of the EKF by "
            f"{bp / mae['ekf'] - 1.0:+.1%}; the rest is what a UKF gains over an EKF.",
        ),
        Line(
            1,
            "the same to tuned filters: classic UKF, EKF",
            "",
            f"{ours / ukf:.2f}, {ours / ekf:.2f}",
            f"classic UKF {ukf:.3f} m, EKF {ekf:.3f} m",
            "stated",
        ),
    ]


def _outliers(found: dict) -> Line:
    ours = found["ga-bp-ukf"]
    others = (
        f"{name} {found[name]['rise']:.2f} ({found[name]['rmse_outliers_m']:.2f} m)"
        for name in ("bp-ekf", "ekf, tuned", "classic ukf, tuned")
    )
    return Line(
        2,
        "simulation 2: RMSE with outliers to that without",
        "the others follow the outliers",
        f"{ours['rise']:.2f} ({ours['rmse_outliers_m']:.2f} m)",
        ", ".join(others),
        f"≤ {RISE}",
        ours["rise"] <= RISE,
        f"BP-EKF is {found['bp-ekf']['rmse_m']:.2f} m off without outliers: a small rise of a large error.",
    )


def _gradient(level: str, found: dict) -> Line:
    (ours_m, _, _, error_m, _, _), (theirs_m, _, _, their_error_m, _, _) = (
        found[name]["median"] for name in ("ga-bp-ukf", WAVELET)
    )
    truth_m, smoothed = found["truth"]["median"][0], found["ga-bp-ukf, smoothed"]["median"]
    paper_m, paper_theirs_m = PAPER_GRADIENT_M["ga-bp-ukf"], PAPER_GRADIENT_M[WAVELET]
    note = (
        f"The target itself moves {truth_m:.4f} m a step, {truth_m / theirs_m:.2f} of the baseline's "
        "gradient: a ratio below that would be lag."
    )
    return Line(
        3,
        f"mean gradient of the range, {level} flight",
        f"{paper_m:.2f} to {paper_theirs_m:.2f} m: {paper_m / paper_theirs_m:.2f}",
        f"{ours_m:.4f} m: {ours_m / theirs_m:.2f}; true error {error_m:.3f} m; smoothed {smoothed[0]:.4f}, "
        f"{smoothed[3]:.3f} m",
        f"Kalman + wavelet {theirs_m:.4f} m; true error {their_error_m:.3f} m",
        f"≤ {HALF} at no larger error",
        ours_m <= HALF * theirs_m and error_m <= their_error_m,
        note,
    )


def _smoothness(level: str, found: dict) -> Grid:
    measured = ("range m", "azimuth °", "elevation °")
    columns = ("method", *(f"gradient {m}" for m in measured), *(f"error {m}" for m in measured), "lost")
    rows = [
        (name, *(f"{figure:.4f}" for figure in one["median"]), str(one["lost"]))
        for name, one in found.items()
    ]
    return Grid(f"mean gradient and true RMS error, {level} flight, medians", columns, rows)
