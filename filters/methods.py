"""The estimators by name: what ``--method`` can choose."""

from collections.abc import Callable, Sequence

import numpy as np

from filters.correction import correction as corrections
from filters.models.rows import Sensor
from filters.models.settings import Settings
from filters.smoother import gated
from filters.smoother.estimator import FixedLagSmoother

METHODS = {
    "default": gated.BY_STATUS,
    "ukf": gated.Rule(gated.IGG, np.inf, np.inf),  # takes every value
    "gate": gated.Rule(gated.IGG, 4.0, 4.0),
    "igg": gated.Rule(gated.IGG, 1.5, 8.5),
    "ga-bp-ukf": gated.Rule(gated.M1, 4.0, 8.0),  # C; at 3, a curved first prediction loses its target
}


def make(
    method: str,
    sensors: Sequence[Sensor],
    settings: Settings | None = None,
    correction: Callable = corrections.off,
) -> FixedLagSmoother:
    """An estimator by name. Raises ValueError for an unknown one."""
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}")
    return FixedLagSmoother(sensors, settings or Settings(), METHODS[method], correction)
