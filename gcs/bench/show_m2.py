"""The wind paper: ours beside what the paper says."""

from gcs.bench.papers_recorded import FROM_DEG, SPEED_MPS
from gcs.bench.papers_report import Grid, Line

PAPER = {"kalman": "diverges with outliers", "sage-husa": "jumps with outliers", "arf": "stays on the truth"}
RISE, HALF, THIRD = 1.1, 0.5, 1 / 3
SPEED_ERROR_MPS, DIRECTION_ERROR_DEG = 0.3, 3.0


def lines(found: dict) -> list[Line]:
    """Rows 8 to 10 out of what `papers.measure_m2` found."""
    rise = {name: dirty / clean for name, (clean, dirty) in found["wind"].items()}
    both = {
        name: f"{clean:.2f} → {dirty:.2f} m/s: {rise[name]:.2f}"
        for name, (clean, dirty) in found["wind"].items()
    }
    without_m, corrected_m = found["navigation"]
    return [
        Line(
            8,
            "wind: RMSE without → with runs of outliers",
            "KF diverges, Sage-Husa jumps, ARF stays on the truth",
            f"ARF {both['arf']}",
            f"KF {both['kalman']}, Sage-Husa {both['sage-husa']}",
            f"≤ {RISE}",
            rise["arf"] <= RISE,
        ),
        Line(
            9,
            "navigation: RMS position error without → with wind correction",
            "within 10 m → within 5 m",
            f"{without_m:.2f} → {corrected_m:.2f} m: {corrected_m / without_m:.2f}",
            "",
            f"≤ {HALF}",
            corrected_m <= HALF * without_m,
        ),
        *_recorded(found["recorded"]),
    ]


def grids(found: dict) -> list[Grid]:
    """The figures behind them."""
    rows = [
        (name, f"{clean:.3f}", f"{dirty:.3f}", f"{dirty / clean:.2f}", PAPER[name])
        for name, (clean, dirty) in found["wind"].items()
    ]
    return [Grid("wind, RMSE in m/s", ("filter", "without outliers", "with", "ratio", "the paper"), rows)]


def _recorded(found: dict | None) -> list[Line]:
    what = f"recorded fixed wing in {SPEED_MPS:g} m/s from {FROM_DEG:g}°"
    target = f"within {SPEED_ERROR_MPS} m/s and {DIRECTION_ERROR_DEG:g}°"
    if found is None:
        return [Line(10, what, "", "the recording is not here; name its folder with --recorded", "", target)]
    speed, direction = found["ours"]
    return [
        Line(
            10,
            f"{what}: median above 60 m",
            "",
            f"{speed:.2f} m/s from {direction:.1f}°",
            "the autopilot's own {:.2f} m/s from {:.1f}°".format(*found["autopilot"]),
            target,
            abs(speed - SPEED_MPS) <= SPEED_ERROR_MPS and abs(direction - FROM_DEG) <= DIRECTION_ERROR_DEG,
        ),
        Line(
            10,
            f"the same, error after 60 s without any position, {found['losses']} times",
            "",
            f"{found['with_wind_m']:.0f} m with the wind; worst ratio {found['worst_ratio']:.2f}",
            f"{found['without_wind_m']:.0f} m without",
            "≤ 1/3, each time",
            found["worst_ratio"] <= THIRD,
        ),
    ]
