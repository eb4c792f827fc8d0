"""How every figure of the report looks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from gcs.report.basis import numbers

LIVE, BEST, RAW, LEVEL, LIMIT = "#2080e0", "#009e73", "#8c929c", "#cc64b4", "#e43c14"
SENSORS = ("#8c929c", "#e69f00", "#009e73", "#cc64b4", "#a07850", "#2080e0")  # the INS, then the instruments
VERDICT = {  # colour, symbol, size: told apart without colour too
    "used": ("#8aa4c8", "circle", 3),
    "deweighted": ("#d68c00", "diamond", 4),
    "isolated": ("#e43c14", "x-thin", 7),
    "patch": ("#a020a0", "square-open", 6),
    "invalid": ("#6b7280", "triangle-down-open", 7),
}
POINTS = 2_400  # of one trace, about; a screen has fewer columns
MARKS = 900  # of one kind of dots


def sheet(
    rows: int, titles: Sequence[str], *, columns: int = 1, time: bool = True, **options: Any
) -> go.Figure:
    """An empty figure of ``rows`` × ``columns`` panels; ``time``: all share the flight's time, in s."""
    figure = make_subplots(
        rows=rows,
        cols=columns,
        shared_xaxes=time,
        vertical_spacing=min(0.08, 0.25 / rows),
        horizontal_spacing=0.07,
        **options,
    )
    figure.update_layout(
        template=go.layout.Template(),
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        margin={"l": 65, "r": 15, "t": 36, "b": 44},
        font={"size": 12, "family": "system-ui, Liberation Sans, Arial, sans-serif"},
        legend={"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "font": {"size": 12}},
        hoverlabel={"font": {"size": 12}},
        meta={"time": time},
    )
    figure.update_xaxes(showgrid=True, zeroline=False, ticks="outside")
    figure.update_yaxes(showgrid=True, zeroline=True, zerolinewidth=1, automargin=True)
    for k, title in enumerate(titles):
        figure.update_yaxes(title_text=title, row=k // columns + 1, col=k % columns + 1)
    if time:
        figure.update_xaxes(title_text="s since the first state", row=rows, col=1)
    return figure


def line(
    figure: go.Figure, x: np.ndarray, y: np.ndarray, name: str, colour: str, row: int = 1, **options: Any
) -> None:
    """A line through the extremes of each stretch of (n,) points; named once in the legend."""
    at = numbers.thin(POINTS, y)
    style = {"color": colour, "width": options.pop("width", 1.5), "dash": options.pop("dash", "solid")}
    figure.add_trace(
        go.Scatter(
            x=_short(x[at]), y=_short(y[at]), name=name, mode="lines", line=style, legendgroup=name,
            showlegend=not _named(figure, name), hovertemplate="%{y:.4g} at %{x:.2f} s", **options,
        ),
        row=row, col=1,
    )  # fmt: skip


def dots(
    figure: go.Figure, x: np.ndarray, y: np.ndarray, name: str, style: tuple[str, str, int], **options: Any
) -> None:
    """Dots, the extremes of each stretch where there are many; ``style``: colour, symbol, size."""
    at = numbers.sample(MARKS, y)
    place = {"row": options.pop("row", 1), "col": options.pop("col", 1)}
    colour, symbol, size = style
    marker = {
        "color": colour,
        "symbol": symbol,
        "size": size,
        "line": {"width": 1.5 if "thin" in symbol else 1, "color": colour},
    }
    if "text" in options:
        options["text"] = options["text"][at]
    figure.add_trace(
        go.Scatter(
            x=_short(x[at]), y=_short(y[at]), name=name, mode="markers", marker=marker, legendgroup=name,
            showlegend=not _named(figure, name), **options,
        ),
        **place,
    )  # fmt: skip


def limit(figure: go.Figure, metres: float | None, row: int, name: str = "tolerance") -> None:
    """A level line at a tolerance, where there is one, on a logarithmic axis."""
    if metres is None:
        return
    figure.add_hline(y=metres, line={"color": LIMIT, "dash": "dash", "width": 1.5}, row=row, col=1)
    x_axis, y_axis = (
        next(axes).anchor for axes in (figure.select_yaxes(row=row), figure.select_xaxes(row=row))
    )
    figure.add_annotation(  # its place on a logarithmic axis is an exponent, that of a line is not
        text=name, x=1.0, xref=f"{x_axis} domain", xanchor="right", y=np.log10(metres), yref=y_axis,
        yanchor="bottom", showarrow=False,
    )  # fmt: skip


def colour_of(sensor: str, sensors: Sequence[str]) -> str:
    """A sensor's colour; beyond five instruments they repeat."""
    k = list(sensors).index(sensor)
    return SENSORS[k if k == 0 else 1 + (k - 1) % (len(SENSORS) - 1)]


def _short(values: np.ndarray) -> np.ndarray:
    """As plotly sends it: four bytes a number."""
    return np.asarray(values, np.float32)


def _named(figure: go.Figure, name: str) -> bool:
    return any(trace.name == name for trace in figure.data)
