"""What the newest track's colour says: nothing, speed, height, sigma or NIS; and the scale beside it."""

from typing import NamedTuple

import numpy as np

from web.look import colours

PLAIN = "plain"
UNITS = {"speed": "m/s", "height": "m", "sigma": "m", "NIS": ""}  # by what may be painted
CHOICES = (PLAIN, *UNITS)
LOW, HIGH = 2.0, 98.0  # percentiles that take the ends of the scale: one jump must not grey the flight
GROWTH = 0.2  # of the scale's width: so far the flight may leave it before it is drawn anew


class Scale(NamedTuple):
    """From dark to light."""

    low: float
    high: float


def values(rows: np.ndarray) -> np.ndarray:
    """(n,) TRACK → (n, 4) speed m/s, height above the origin m, sigma of the position m, NIS."""
    rows = np.atleast_1d(rows)
    variance = rows["covariance"][:, [0, 2, 5]].sum(axis=1)
    return np.column_stack(
        [
            np.linalg.norm(rows["velocity_enu_mps"], axis=1),
            rows["position_enu_m"][:, 2],
            np.sqrt(np.maximum(variance, 0.0)),
            rows["nis"],
        ]
    )


def scale_of(choice: str, rows: np.ndarray, before: Scale | None = None) -> Scale | None:
    """The scale for (n,) TRACK; ``before`` as long as it still fits. None: plain, or nothing to paint."""
    if choice == PLAIN or not len(rows):
        return None
    column = values(rows)[:, list(UNITS).index(choice)]
    column = column[np.isfinite(column)]
    if not len(column):
        return None
    low, high = np.percentile(column, [LOW, HIGH]).tolist()
    slack = GROWTH * max(before.high - before.low, 1e-6) if before else 0.0
    if before and abs(low - before.low) <= slack and abs(high - before.high) <= slack:
        return before
    return Scale(low, max(high, low + 1e-3))


def paint(choice: str, scale: Scale | None, values: np.ndarray) -> np.ndarray:
    """Colours (…, 3) uint8 for what ``values`` says of each end (…, 4).

    Plain has a colour for each end too: the browser does not see a line change from one kind to the other.
    """
    if choice == PLAIN or scale is None:
        return np.broadcast_to(np.array(colours.FILTERED, np.uint8), (*values.shape[:-1], 3))
    return colours.ramp((values[..., list(UNITS).index(choice)] - scale.low) / (scale.high - scale.low))
