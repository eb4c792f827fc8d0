"""Figures of the residuals: over time, their distribution, and against where the instrument looks."""

from collections.abc import Iterator
from statistics import NormalDist

import numpy as np
import plotly.graph_objects as go

from gcs.contract.messages import CHANNELS
from gcs.report.basis import geometry, numbers
from gcs.report.basis.drawing import SENSORS, VERDICT, dots, sheet
from gcs.report.basis.page import Diagram
from gcs.report.basis.run import ACCEPTED, LINE, Run, is_one_of, sigmas_off

EDGE = 8.0  # sigmas that are drawn; what is farther stands at the edge
DRAWN = ("used", "deweighted", "isolated", "patch")
QUANTILES = 161
BINS = 81
LOOKS = 40  # bins in which the median of residuals is drawn against where the instrument looks


def figures(run: Run) -> Iterator[Diagram]:
    """All of them, sensor by sensor."""
    for sensor in run.heard:
        values = run.of(sensor)
        values = values[(values["channel"] != LINE) & np.isfinite(values["sigma"])]
        channels = np.unique(values["channel"]).tolist()
        if not channels:
            continue
        off = sigmas_off(values)
        yield over_time(run, sensor, values, off)
        yield distribution(sensor, values, off)
        if sensor != "ins":
            yield by_look(run, sensor, values, off)


def over_time(run: Run, sensor: str, values: np.ndarray, off: np.ndarray) -> Diagram:
    """Residuals in sigmas of each channel, by verdict; ``off`` (n,) of ``values`` (n,)."""
    channels = np.unique(values["channel"]).tolist()
    figure = sheet(len(channels), [CHANNELS[channel].replace("_", " ") for channel in channels])
    beyond = drawn = there = 0
    for row, channel in enumerate(channels, 1):
        for verdict in DRAWN:
            of = (values["channel"] == channel) & is_one_of(values, (verdict,))
            t, y = run.seconds(values["t_ns"][of]), off[of]
            at = numbers.sample(600, y)
            t, y, shown = t[at], y[at], np.clip(y[at], -EDGE, EDGE)
            there, drawn = there + int(of.sum()), drawn + len(at)
            beyond += int((np.abs(off[of]) > EDGE).sum())
            text = np.array(
                [
                    f"{CHANNELS[channel]}: {s:+.1f} sigma at {x:.2f} s, {verdict}"
                    for x, s in zip(t, y, strict=True)
                ],
                object,
            )
            dots(figure, t, shown, verdict, VERDICT[verdict], row=row, text=text, hoverinfo="text")
    figure.update_yaxes(range=[-EDGE - 0.6, EDGE + 0.6], tickvals=[-6, -3, 0, 3, 6])
    caption = (
        "Value minus what all other values say, in sigmas of that difference. Accepted ones should scatter "
        "evenly about zero, two thirds within one; a slope or a wave is an error that is not modelled."
    )
    if beyond:
        caption += f" {beyond:,} beyond {EDGE:g} sigmas stand at the edge."
    if drawn < there:
        caption += f" Of {there:,} values {drawn:,} are drawn, among them the extremes of each stretch."
    return Diagram(f"Residuals of {sensor}", caption, figure, 110 + 130 * len(channels))


def distribution(sensor: str, values: np.ndarray, off: np.ndarray) -> Diagram:
    """Histogram and quantile plot of the accepted residuals."""
    figure = sheet(1, ["density", "sigmas"], columns=2, time=False)
    edges = np.linspace(-5.0, 5.0, BINS + 1)
    centre = 0.5 * (edges[1:] + edges[:-1])
    shares = (np.arange(QUANTILES) + 0.5) / QUANTILES
    normal = np.array([NormalDist().inv_cdf(share) for share in shares])
    for k, channel in enumerate(np.unique(values["channel"]).tolist()):
        u = off[(values["channel"] == channel) & is_one_of(values, ACCEPTED)]
        u = u[np.isfinite(u)]
        if len(u) < 10:
            continue
        name = CHANNELS[channel].replace("_", " ")
        style = {
            "color": SENSORS[(k + 1) % len(SENSORS)],
            "width": 1.5,
            "dash": ("solid", "dash", "dot")[k // len(SENSORS) % 3],
        }
        density = np.histogram(u, edges)[0] / (len(u) * (edges[1] - edges[0]))
        for column, x, y in ((1, centre, density), (2, normal, np.quantile(u, shares))):
            figure.add_trace(
                go.Scatter(
                    x=np.asarray(x, np.float32), y=np.asarray(y, np.float32), name=name,
                    mode="lines", line=style,
                    legendgroup=name, showlegend=column == 1,
                ),
                row=1, col=column,
            )  # fmt: skip
    bell = np.exp(-0.5 * centre**2) / np.sqrt(2 * np.pi)
    for column, x, y in ((1, centre, bell), (2, normal, normal)):
        figure.add_trace(
            go.Scatter(
                x=x, y=y, name="normal", mode="lines", line={"color": SENSORS[0], "width": 4}, opacity=0.5,
                legendgroup="normal", showlegend=column == 1,
            ),
            row=1, col=column,
        )  # fmt: skip
    figure.update_xaxes(title_text="sigmas", col=1)
    figure.update_xaxes(title_text="of a normal distribution", col=2)
    caption = (
        "Accepted values. Left: narrower than the grey curve is less noise than stated, wider is more. "
        "Right: on the grey line the residuals are normal; ends that bend away are tails, a parallel line "
        "is a zero error."
    )
    return Diagram(f"Distribution of {sensor}'s residuals", caption, figure, 400)


def by_look(run: Run, sensor: str, values: np.ndarray, off: np.ndarray) -> Diagram:
    """Accepted residuals against range, azimuth and elevation of the best estimate."""
    channels = np.unique(values["channel"]).tolist()
    titles = [title for channel in channels for title in (CHANNELS[channel].replace("_", " "), "", "")]
    figure = sheet(len(channels), titles, columns=3, time=False)
    look = geometry.sight(run, sensor, values["t_ns"])
    for row, channel in enumerate(channels, 1):
        of = (values["channel"] == channel) & is_one_of(values, ACCEPTED)
        for column, x in enumerate(look, 1):
            known = of & np.isfinite(x) & np.isfinite(off)
            order = np.argsort(x[known])
            x_in_order, y = x[known][order], np.clip(off[known][order], -EDGE, EDGE)
            at = numbers.sample(400, y)
            dots(
                figure,
                x_in_order[at],
                y[at],
                "accepted",
                VERDICT["used"],
                row=row,
                col=column,
                hoverinfo="skip",
            )
            _add_medians(figure, x_in_order, y, row, column)
    figure.update_yaxes(range=[-5, 5], tickvals=[-3, 0, 3])
    for column, title in enumerate(("range, m", "azimuth, °", "elevation, °"), 1):
        figure.update_xaxes(title_text=title, row=len(channels), col=column)
    caption = (
        "The line is the median of equally many values each. It should stay on zero: a slope with range is a "
        "scale, a wave over azimuth a mount that leans, a bend at low elevation the refraction."
    )
    return Diagram(f"Residuals of {sensor} by where it looks", caption, figure, 120 + 140 * len(channels))


def _add_medians(figure: go.Figure, x: np.ndarray, y: np.ndarray, row: int, column: int) -> None:
    """The running median of (n,) ``y`` in order of ``x``."""
    count = min(LOOKS, len(x) // 20)
    if count < 2:
        return
    parts = np.array_split(np.arange(len(x)), count)
    figure.add_trace(
        go.Scatter(
            x=np.array([np.median(x[p]) for p in parts], np.float32),
            y=np.array([np.median(y[p]) for p in parts], np.float32),
            name="median", mode="lines", line={"color": "#e43c14", "width": 2}, legendgroup="median",
            showlegend=row == column == 1,
        ),
        row=row, col=column,
    )  # fmt: skip
