"""How the report's pictures look. Nothing here keeps a state: matplotlib's figures without its pyplot."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK, GRID, GREY = "#333", "#ddd", "#9a9a9a"
OURS, CLASSIC, OTHER, FAULT = "#2a6fb0", "#c98a1b", "#7a4fa3", "#d1352b"
WIDTH_IN, PANEL_IN, DPI = 9.0, 2.9, 100


def panels(rows: int, columns: int = 1, share_x: bool = True) -> tuple[Figure, Sequence[Axes]]:
    """A figure and its axes, row by row."""
    figure = Figure(figsize=(WIDTH_IN, PANEL_IN * rows + 0.3), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share_x).ravel()
    for one in axes:
        one.grid(color=GRID, linewidth=0.6)
        one.set_axisbelow(True)
        one.spines[["top", "right"]].set_visible(False)
    return figure, axes


def label(axes: Axes, title: str, x: str, y: str, legend: str = "best", columns: int = 1) -> None:
    """Title to the left, axes with their units, legend."""
    axes.set_title(title, loc="left", fontsize=10, color=INK)
    axes.set_xlabel(x, fontsize=9, color=INK)
    axes.set_ylabel(y, fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc=legend, fontsize=8, ncols=columns, framealpha=0.9)
