"""The wind paper's simulation and navigation, ours beside what the paper says."""

from rich.table import Table

from gcs.bench import wind

PAPER = {
    "kalman": "diverges with outliers",
    "sage-husa": "jumps with outliers",
    "arf": "stays on the truth",
}


def tables(seeds: int = 50) -> list[Table]:
    """``seeds`` winds of 400 steps, with and without runs of outliers, and the navigation by them."""
    return [_estimates(wind.table(seeds)), _navigation(*wind.navigation(seeds))]


def _estimates(found: dict[str, tuple[float, float]]) -> Table:
    table = Table(title="wind, RMSE in m/s", title_justify="left")
    for heading in ("filter", "without outliers", "with", "ratio", "the paper"):
        table.add_column(heading)
    for method, (clean, dirty) in found.items():
        table.add_row(method, f"{clean:.3f}", f"{dirty:.3f}", f"{dirty / clean:.2f}", PAPER.get(method, ""))
    return table


def _navigation(without_m: float, corrected_m: float) -> Table:
    table = Table(title="position by air data between fixes, RMS in m", title_justify="left")
    for heading in ("", "ours", "the paper"):
        table.add_column(heading)
    table.add_row("without the wind", f"{without_m:.2f}", "within 10")
    table.add_row("with it", f"{corrected_m:.2f}", "within 5")
    return table
