"""How the report's pictures look. Nothing here keeps a state: matplotlib's figures without its pyplot."""

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

INK, GRID, GREY = "#333", "#ddd", "#9a9a9a"
OURS, FAULT, OTHER = "#2a6fb0", "#d1352b", "#c98a1b"
WIDTH_IN, PANEL_IN, DPI = 9.0, 2.7, 100


def panels(rows: int, *, share_x: bool = True) -> tuple[Figure, Sequence[Axes]]:
    """A figure of ``rows`` panels above one another."""
    figure = Figure(figsize=(WIDTH_IN, PANEL_IN * rows + 0.3), dpi=DPI, layout="constrained")
    return figure, figure.subplots(rows, squeeze=False, sharex=share_x)[:, 0]


def label(axes: Axes, title: str, x: str, y: str) -> None:
    """Title to the left, legend to the right of it, axes with their units."""
    axes.set_title(title, loc="left", fontsize=10, color=INK)
    axes.set_xlabel(x, fontsize=9, color=INK)
    axes.set_ylabel(y, fontsize=9, color=INK)
    axes.tick_params(which="both", labelsize=8, colors=INK)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    _, names = axes.get_legend_handles_labels()
    if names:
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "borderaxespad": 0.0}
        axes.legend(**place, ncols=len(names), fontsize=8, frameon=False, columnspacing=1.2, handlelength=1.4)


def decades(axes: Axes) -> None:
    """A logarithmic y axis with plain numbers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(FuncFormatter(_two_and_five))


def signed_decades(axes: Axes, linear: float) -> None:
    """The same for either sign, linear up to ``linear``."""
    axes.set_yscale("symlog", linthresh=linear)
    axes.yaxis.set_major_formatter("{x:g}")


def _two_and_five(value: float, _) -> str:
    return f"{value:g}" if round(value / 10.0 ** math.floor(math.log10(value))) in (2, 5) else ""
