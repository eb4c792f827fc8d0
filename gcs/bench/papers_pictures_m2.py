"""Pictures of the wind paper's figures."""

import numpy as np
from matplotlib.figure import Figure

from filters import arf
from gcs.bench import wind
from gcs.bench.papers_picture import CLASSIC, FAULT, GREY, INK, OURS, label, panels

COLOURS = {"kalman": FAULT, "sage-husa": CLASSIC, "arf": OURS}
NAMES = {"kalman": "KF", "sage-husa": "Sage-Husa", "arf": "ARF"}


def filters(seed: int) -> Figure:
    """One wind without and with outliers: truth and the three filters."""
    figure, axes = panels(3)
    for one, share in zip(axes, (0.0, wind.OUTLIERS), strict=False):
        scene = wind.scene(seed, share)
        one.plot(scene.measured, ".", color=GREY, markersize=3, label="measured")
        one.plot(scene.truth, color=INK, linewidth=1.6, label="truth")
        for name, colour in COLOURS.items():
            estimated = arf.estimate(scene.measured, name, _model()).x
            one.plot(estimated, color=colour, linewidth=1.0, label=NAMES[name])
            if share:
                axes[2].plot(np.abs(estimated - scene.truth), color=colour, linewidth=1.0, label=NAMES[name])
    axes[1].set_ylim(-10.0, 35.0)
    label(axes[0], "wind without outliers", "", "wind, m/s", "upper left", 5)
    label(
        axes[1],
        "the same with outliers, singly and in runs (some out of the picture)",
        "",
        "wind, m/s",
        "upper left",
        5,
    )
    label(axes[2], "error with outliers", "step", "|estimate − truth|, m/s", "upper left", 3)
    return figure


def navigation(seed: int) -> Figure:
    """Position error in the plane of one flight by air data, without and with the wind's correction."""
    figure, (one,) = panels(1)
    without, corrected = (np.linalg.norm(errors, axis=0) for errors in wind.navigate(seed, wind.OUTLIERS))
    one.plot(without, color=FAULT, linewidth=0.9, label=f"without the wind, RMS {_rms(without):.1f} m")
    one.plot(corrected, color=OURS, linewidth=0.9, label=f"with it, RMS {_rms(corrected):.1f} m")
    one.axhline(10.0, color=FAULT, linestyle=":", label="the paper: within 10 m")
    one.axhline(5.0, color=OURS, linestyle=":", label="the paper: within 5 m")
    one.set_ylim(0.0, 1.35 * without.max())
    label(
        one, "position by air data between fixes", "fix, one a second", "position error, m", "upper left", 2
    )
    return figure


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _model() -> arf.Wind1D:
    return arf.Wind1D(noise_var=wind.NOISE_VAR, noise_memory=wind.NOISE_MEMORY)
