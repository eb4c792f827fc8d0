"""Pictures of the wind paper's figures."""

import numpy as np
from matplotlib.figure import Figure

from bench.papers.m2 import wind
from bench.papers.show.picture import FAULT, GREY, INK, OTHER, OURS, label, panels
from filters.wind import arf

FILTERS = {"kalman": ("KF", FAULT), "sage-husa": ("Sage-Husa", OTHER), "arf": ("ARF", OURS)}
SHOWN_MPS = (-10.0, 35.0)


def filters(seed: int) -> Figure:
    """One wind without and with outliers: truth and the three filters."""
    figure, (clean, dirty, error) = panels(3)
    for axes, share in ((clean, 0.0), (dirty, wind.OUTLIERS)):
        scene = wind.scene(seed, share)
        axes.plot(scene.measured, ".", color=GREY, markersize=3, label="measured")
        axes.plot(scene.truth, color=INK, linewidth=1.6, label="truth")
        for method, (name, colour) in FILTERS.items():
            estimated = arf.estimate(scene.measured, method, wind.MODEL).x
            axes.plot(estimated, color=colour, linewidth=1.0, label=name)
            if share:
                error.plot(np.abs(estimated - scene.truth), color=colour, linewidth=1.0, label=name)
    dirty.set_ylim(SHOWN_MPS)
    label(clean, "wind without outliers", "", "wind, m/s")
    label(dirty, "with outliers, some out of the picture", "", "wind, m/s")
    label(error, "error with outliers", "step", "|estimate − truth|, m/s")
    return figure


def navigation(seed: int) -> Figure:
    """Position error in the plane of one flight by air data, without and with the wind's correction."""
    figure, (one,) = panels(1)
    shown = (("without the wind", FAULT, 10.0), ("with it", OURS, 5.0))
    for errors, (name, colour, paper_m) in zip(wind.navigate(seed, wind.OUTLIERS), shown, strict=True):
        away = np.linalg.norm(errors, axis=0)
        rms = float(np.sqrt(np.mean(away**2)))
        one.plot(away, color=colour, linewidth=0.9, label=f"{name}, RMS {rms:.1f} m")
        one.axhline(paper_m, color=colour, linestyle=":", label=f"the paper's {paper_m:g} m")
    one.set_ylim(bottom=0.0)
    label(one, "position by air data", "fix, one a second", "position error, m")
    return figure
