"""Pictures of the screening paper's channel: what is wrong with it and what is found."""

import numpy as np
from matplotlib.figure import Figure

from bench.papers.m3 import screening
from bench.papers.show.picture import FAULT, GREY, INK, OTHER, OURS, label, panels, signed_decades
from filters.screening import screening as screens
from filters.simulation import simulate

PART = 400  # values, 20 s
NAMES = {simulate.ISOLATED: ("isolated", FAULT), simulate.PATCH: ("in a run", OTHER)}


def channel(seed: int, size: tuple[float, float]) -> Figure:
    """The whole record, and the part with the most outliers in runs as the screening saw it."""
    made = screening.record(seed, size)
    found = screening.screened(made, screening.OURS)
    range_m = screening.flight_ranges()[1]
    figure, (whole, near, cleaned) = panels(3, share_x=False)
    whole.plot(made.t_s, made.values / 1e3, ".", color=GREY, markersize=1.5, label="measured")
    whole.plot(made.t_s, range_m / 1e3, color=INK, linewidth=0.8, label="truth")
    part = _part(made.label)
    t_s, labels, flag = made.t_s[part], made.label[part], found.flag[part]
    off, left = (((one - range_m) / made.sigma)[part] for one in (made.values, found.cleaned))
    near.plot(t_s, off, ".", color=GREY, markersize=3, label="good")
    for kind, (name, colour) in NAMES.items():
        near.plot(t_s[labels == kind], off[labels == kind], "o", color=colour, markersize=4, label=name)
    refused = flag == screens.OUTLIER
    near.plot(t_s[refused], off[refused], "o", color=OURS, markersize=8, fillstyle="none", label="found")
    missed = (labels != simulate.NONE) & (flag == screens.GOOD)
    near.plot(t_s[missed], off[missed], "x", color=INK, markersize=8, label="missed")
    signed_decades(near, 10.0)
    cleaned.sharex(near)
    cleaned.plot(t_s, left, color=OURS, linewidth=0.9, label="cleaned channel")
    label(whole, f"whole record, {np.count_nonzero(made.label)} outliers", "time, s", "range, km")
    label(near, "part of it", "", "error of the value, σ")
    label(cleaned, "the same, outliers replaced", "time, s", "error of the value, σ")
    return figure


def _part(labels: np.ndarray) -> slice:
    """PART values with the most outliers in runs among them, these in the middle."""
    count = np.convolve(labels == simulate.PATCH, np.ones(PART), "valid")
    begin = int(np.median(np.flatnonzero(count == count.max())))
    return slice(begin, begin + PART)
