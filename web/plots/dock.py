"""The plots on one viewer's page: which, over how long, and that of the clicked outlier's channel."""

import math

import numpy as np
import viser
from viser import uplot

from gcs.contract.supervision import guarded
from web.look import colours
from web.look.colours import css
from web.memory.claims import Claim
from web.memory.flight import SeenFlight
from web.plots import curves
from web.plots.curves import BAND, LINE, MARKS, Plot

SPANS_S = {"30 s": 30.0, "1 min": 60.0, "5 min": 300.0, "whole flight": math.inf}
BOX = "Outliers in a box"
HEIGHT_PX = 150
AROUND_NS = 10_000_000_000  # of the clicked outlier's plot, each side
GRID: uplot.Axis_Grid = {"stroke": "rgba(128,128,128,0.55)", "width": 1}
SIZE_PX = {LINE: 0, MARKS: 7, curves.DOTS: 3}
WIDTH_PX = 340


class Charts:
    """A row of plots in one container; drawn anew only when what they show has another shape."""

    def __init__(self, gui: viser.GuiApi):
        self._gui = gui
        self._shown: dict[tuple, viser.GuiUplotHandle] = {}

    def show(self, plots: list[Plot], container: viser.GuiFolderHandle) -> None:
        keys = [(plot.title, *((c.label, c.style) for c in plot.curves)) for plot in plots]
        if keys != list(self._shown):
            self.clear()
            with container:
                self._shown = {key: self._make(plot) for key, plot in zip(keys, plots, strict=True)}
            return
        for key, plot in zip(keys, plots, strict=True):
            data, handle = _data(plot), self._shown[key]
            if len(data[0]) != len(handle.data[0]) or any(
                not np.array_equal(new, old, equal_nan=True)
                for new, old in zip(data, handle.data, strict=True)
            ):
                handle.data = data
            if handle.scales != (scales := _scales(plot)):
                handle.scales = scales

    def clear(self) -> None:
        for handle in self._shown.values():
            handle.remove()
        self._shown = {}

    def _make(self, plot: Plot) -> viser.GuiUplotHandle:
        bands = [i + 1 for i, curve in enumerate(plot.curves) if curve.style == BAND][::2]
        filled: list[uplot.Band] = [
            {"series": (i, i + 1), "fill": _clear(plot.curves[i - 1].colour)} for i in bands
        ]
        return self._gui.add_uplot(
            _data(plot),
            ({"label": "s"}, *(_series(curve) for curve in plot.curves)),
            title=plot.title,
            scales=_scales(plot),
            bands=tuple(filled) or None,
            axes=({}, {"splits": plot.levels, "grid": GRID, "size": 40} if plot.levels else {"size": 40}),
            cursor={"sync": {"key": "flight"}},
            legend={"show": True, "live": False},
            height=HEIGHT_PX,
            padding=(10, 18, 0, 0),
        )


class Dock:
    """The panel on the left."""

    def __init__(self, gui: viser.GuiApi, flight: SeenFlight):
        self._flight = flight
        panel = gui.add_panel()
        with panel.add_tab("Plots"):
            self.story = gui.add_html("", visible=False)
            self._picked = gui.add_folder(None)
            self._close = gui.add_button("Close", visible=False, color=colours.BUTTON)
            self.box = gui.add_button(
                BOX, color=colours.BUTTON, hint="how many, whose, and how far off; key B"
            )
            self._choice = gui.add_dropdown("Show", curves.CHOICES)
            self._span = gui.add_dropdown("Over", tuple(SPANS_S), initial_value="1 min")
            self._all = gui.add_folder(None)
        panel.dock_left()
        panel.set_width(WIDTH_PX)
        self._charts, self._near = Charts(gui), Charts(gui)
        self._close.on_click(guarded("view", lambda _: self.tell("")))

    def update(self, now_ns: int) -> None:
        span_s = SPANS_S[self._span.value]
        start_ns, _ = self._flight.span_ns
        from_ns = start_ns if math.isinf(span_s) else now_ns - round(span_s * 1e9)
        self._charts.show(curves.plots(self._choice.value, self._flight, from_ns, now_ns), self._all)

    def tell(self, story: str) -> None:
        """Show what was asked for above the plots; "": close it."""
        self.story.content = story
        self.story.visible = self._close.visible = bool(story)
        self._near.clear()

    def pick(self, claim: Claim, story: str) -> None:
        """Tell a clicked outlier's story above the plots, and show its channels' residuals."""
        self.tell(story)
        channels = [verdict.channel for verdict in claim.refused][: len(curves.PALETTE)]
        span = claim.t_ns - AROUND_NS, claim.t_ns + AROUND_NS
        plot = curves.residuals(self._flight, claim.sensor, channels, *span)
        if len(plot.x_s) >= 2:
            self._near.show([plot._replace(title=f"{claim.sensor}, 10 s around it, in σ")], self._picked)


def _data(plot: Plot) -> tuple[np.ndarray, ...]:
    return (plot.x_s, *(curve.y.astype(float) for curve in plot.curves))


def _scales(plot: Plot) -> dict[str, uplot.Scale]:
    return {"x": {"time": False}, "y": {"range": curves.reach(plot), "distr": 3 if plot.log else 1}}


def _series(curve: curves.Curve) -> uplot.Series:
    ink = css(curve.colour)
    if curve.style == LINE:
        return {"label": curve.label, "stroke": ink, "width": 1.5, "points": {"show": False}}
    if curve.style == BAND:
        return {"label": curve.label, "stroke": _clear(curve.colour), "width": 1, "points": {"show": False}}
    size = SIZE_PX[curve.style]
    return {
        "label": curve.label,
        "stroke": ink,
        "width": 0,
        "points": {"show": True, "size": size, "width": 1, "stroke": ink, "fill": ink},
    }


def _clear(colour: tuple[int, int, int]) -> str:
    return "rgba({},{},{},{})".format(*colour, colours.BAND)
