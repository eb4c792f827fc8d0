"""The GA-BP-UKF paper's tables, ours beside the paper's and the baselines'."""

import numpy as np
from rich.table import Table

from gcs.bench import papers_m1, smoothness_m1


def tables(runs: int = papers_m1.RUNS, seeds: int = 20, count: int = 20) -> list[Table]:
    """``runs`` simulated flights, ``seeds`` theodolite flights, ``count`` trainings of each start."""
    shown = [
        _simulations(papers_m1.simulations(runs)),
        _known(papers_m1.start_table(runs)),
        _starts(papers_m1.starts(count)),
    ]
    return shown + [
        _smoothness(level, smoothness_m1.smoothness(level, seeds)) for level in ("hover", "normal")
    ]


def _simulations(found: dict) -> Table:
    table = _table(
        "simulations 1 and 2, position error per axis, m",
        (
            "method",
            "mean absolute",
            "median run",
            "RMSE",
            "RMSE with outliers",
            "ratio",
            "the paper, mean of four",
        ),
    )
    for name, one in found.items():
        ratio = one["rmse_outliers_m"] / one["rmse_m"]
        paper = f"{np.mean(papers_m1.PAPER[name]):.2f}" if name in papers_m1.PAPER else ""
        figures = (one["mae_m"], one["median_m"], one["rmse_m"], one["rmse_outliers_m"], ratio)
        table.add_row(name, *(f"{figure:.3f}" for figure in figures), paper)
    return table


def _known(found: list[dict]) -> Table:
    table = _table(
        "what hangs on the start: mean absolute error, m", ("start known to, m", "EKF", "UKF", "ratio")
    )
    for one in found:
        table.add_row(
            f"{one['start_m']:.0f}", f"{one['ekf']:.3f}", f"{one['ukf']:.3f}", f"{one['ratio']:.3f}"
        )
    return table


def _starts(found: dict) -> Table:
    table = _table(
        "starts of the training on what an EKF leaves, held-out error in sigma²",
        ("start", "best", "median", "worst", "diversity left", "different parents"),
    )
    for name, one in found.items():
        low, _, middle, _, high = one["after"]
        kept = (f"{one[k]:.2f}" if k in one else "" for k in ("diversity", "parents"))
        table.add_row(name, f"{low:.3f}", f"{middle:.3f}", f"{high:.3f}", *kept)
    return table


def _smoothness(level: str, found: dict) -> Table:
    table = _table(
        f"mean gradient and true RMS error, {level} flight",
        (
            "method",
            "gradient range m",
            "azimuth °",
            "elevation °",
            "error range m",
            "azimuth °",
            "elevation °",
            "lost",
        ),
    )
    for name, one in found.items():
        table.add_row(name, *(f"{figure:.4f}" for figure in one["median"]), str(one["lost"]))
    return table


def _table(title: str, columns: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(column)
    return table
