"""Pictures of the screening paper's channel: what is wrong with it and what is found."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from filters import screening as screens
from filters import simulate
from gcs.bench import screening
from gcs.bench.papers_picture import CLASSIC, FAULT, GREY, INK, OURS, label, panels

PART = 400  # values around the longest run: 20 s
KINDS = ((simulate.ISOLATED, "isolated", FAULT), (simulate.PATCH, "in a run", CLASSIC))


def channel(seed: int, size: tuple[float, float]) -> Figure:
    """The whole record, and the part around its longest run as seen by the screening."""
    made = screening.record(seed, size)
    found = screens.screen(made.t_s, made.values, screens.Settings(sigma=float(made.sigma.mean())))
    missed = (made.label != simulate.NONE) & (found.flag == screens.GOOD)
    false = (made.label == simulate.NONE) & (found.flag == screens.OUTLIER)
    range_m = screening.flight_ranges()[1]
    off = (made.values - range_m) / made.sigma
    figure, (whole, near, cleaned) = panels(3, share_x=False)
    whole.plot(made.t_s, made.values / 1e3, ".", color=GREY, markersize=1.5, label="measured")
    whole.plot(made.t_s, range_m / 1e3, color=INK, linewidth=0.8, label="truth")
    label(
        whole, f"range of the whole record, {made.label.astype(bool).sum()} outliers", "time, s", "range, km"
    )
    part = _part(made.label)
    near.plot(made.t_s[part], off[part], ".", color=GREY, markersize=3, label="good value")
    for kind, name, colour in KINDS:
        _dots(near, made.t_s, off, part, made.label == kind, colour, f"outlier, {name}")
    caught = (found.flag != screens.GOOD) & np.isfinite(made.values)
    near.plot(
        *_at(made.t_s, off, part, caught), "o", color=OURS, markersize=8, fillstyle="none", label="found"
    )
    near.plot(*_at(made.t_s, off, part, missed | false), "x", color=INK, label="missed, or false alarm")
    near.set_yscale("symlog", linthresh=5.0)
    label(near, "part of it: error of the measured values", "", "error, σ of the noise", "lower left", 5)
    near.sharex(cleaned)
    cleaned.plot(
        made.t_s[part], ((found.cleaned - range_m) / made.sigma)[part], color=OURS, label="cleaned channel"
    )
    cleaned.axhline(0.0, color=INK, linewidth=0.8)
    label(cleaned, "the same, outliers replaced by their predictions", "time, s", "error, σ of the noise")
    return figure


def _part(labels: np.ndarray) -> slice:
    """PART values with the most outliers in runs among them."""
    count = np.convolve(labels == simulate.PATCH, np.ones(PART), "valid")
    begin = int(count.argmax())
    return slice(begin, begin + PART)


def _dots(axes: Axes, t_s, values, part: slice, which, colour: str, name: str) -> None:
    axes.plot(*_at(t_s, values, part, which), "o", color=colour, markersize=4, label=name)


def _at(t_s, values, part: slice, which) -> tuple[np.ndarray, np.ndarray]:
    return t_s[part][which[part]], values[part][which[part]]
