"""The wind paper: ours beside what the paper says."""

import numpy as np

from bench.papers.m2.recorded import FROM_DEG, SPEED_MPS
from bench.papers.show.report import Grid, Line

PAPER = {"kalman": "diverges with outliers", "sage-husa": "jumps with outliers", "arf": "stays on the truth"}
RISE, HALF, THIRD = 1.1, 0.5, 1 / 3
FEW = 50  # winds that row 8 asks for
FOLLOWED = 1.5  # RMSE with outliers to that without, of a wind whose outliers were taken for the wind
SPEED_ERROR_MPS, DIRECTION_ERROR_DEG = 0.3, 3.0


def lines(found: dict) -> list[Line]:
    """Rows 8 to 10 out of what `papers.measure.m2` found."""
    without_m, corrected_m = found["navigation"]
    navigation = Line(
        9,
        "navigation: RMS position error without → with wind correction",
        "within 10 m → within 5 m",
        f"{without_m:.2f} → {corrected_m:.2f} m: {corrected_m / without_m:.2f}",
        "",
        f"≤ {HALF}",
        corrected_m <= HALF * without_m,
    )
    few = {name: rmse[:FEW] for name, rmse in found["wind"].items()}
    return [_filters(few), _filters(found["wind"]), navigation, *_recorded(found["recorded"])]


def grids(found: dict) -> list[Grid]:
    """The figures behind them."""
    rows = []
    for name, rmse in found["wind"].items():
        clean, dirty = _pooled(rmse)
        median, worst = np.quantile(np.divide(*np.transpose(rmse)[::-1]), [0.5, 1.0])
        ratios = (f"{one:.2f}" for one in (dirty / clean, median, worst))
        rows.append((name, f"{clean:.3f}", f"{dirty:.3f}", *ratios, PAPER[name]))
    columns = ("filter", "without outliers", "with", "ratio", "median wind", "worst wind", "the paper")
    return [Grid("wind, RMSE in m/s", columns, rows)]


def _filters(found: dict) -> Line:
    pooled = {name: _pooled(rmse) for name, rmse in found.items()}
    said = {name: f"{a:.2f} → {b:.2f} m/s: {b / a:.2f}" for name, (a, b) in pooled.items()}
    rmse = np.array(found["arf"])
    followed = rmse[:, 1] > FOLLOWED * rmse[:, 0]
    note = ""
    if followed.any():
        clean, dirty = _pooled(rmse[~followed])
        note = (
            f"In {followed.sum()} of {len(rmse)} winds ARF took a run of outliers for the wind; "
            f"in the others the ratio is {dirty / clean:.2f}."
        )
    clean, dirty = pooled["arf"]
    return Line(
        8,
        f"{len(rmse)} winds: RMSE without → with runs of outliers",
        "KF diverges, Sage-Husa jumps, ARF stays on the truth",
        f"ARF {said['arf']}",
        f"KF {said['kalman']}, Sage-Husa {said['sage-husa']}",
        f"≤ {RISE}",
        bool(dirty <= RISE * clean),
        note,
    )


def _pooled(rmse) -> np.ndarray:
    """RMSE over all winds of (s, 2) those of each: without outliers, with."""
    return np.sqrt(np.mean(np.square(rmse), axis=0))


def _recorded(found: dict | None) -> list[Line]:
    what = f"recorded fixed wing in {SPEED_MPS:g} m/s from {FROM_DEG:g}°"
    target = f"within {SPEED_ERROR_MPS} m/s and {DIRECTION_ERROR_DEG:g}°"
    if found is None:
        return [Line(10, what, "", "the recording is not here; name its folder with --recorded", "", target)]
    speed, direction = found["ours"]
    own_speed, own_direction = found["autopilot"]
    return [
        Line(
            10,
            f"{what}: median above 60 m",
            "",
            f"{speed:.2f} m/s from {direction:.1f}°",
            f"the autopilot's own {own_speed:.2f} m/s from {own_direction:.1f}°",
            target,
            abs(speed - SPEED_MPS) <= SPEED_ERROR_MPS and abs(direction - FROM_DEG) <= DIRECTION_ERROR_DEG,
        ),
        Line(
            10,
            f"the same: error after 60 s without any position, {found['losses']} times",
            "",
            f"{found['with_wind_m']:.0f} m with the wind; worst ratio {found['worst_ratio']:.2f}",
            f"{found['without_wind_m']:.0f} m without",
            "≤ 1/3, each time",
            found["worst_ratio"] <= THIRD,
        ),
    ]
