"""The estimators by name: what ``--method`` can choose."""

from collections.abc import Callable, Sequence

import numpy as np

from filters.baselines import m1
from filters.correction import correction as corrections
from filters.models.rows import Sensor
from filters.window import decide, outlier
from filters.window.estimator import Estimator, Settings

METHODS = {
    "default": {},
    "ukf": {"hard": np.inf, "soft": np.inf, "horizon_s": 0.0},
    "gate": {"hard": 4.0, "soft": 4.0, "horizon_s": 0.0},
    "igg": {"hard": 8.5, "soft": 1.5, "horizon_s": 0.0},
    "ga-bp-ukf": {"hard": m1.NOTHING, "soft": m1.C, "horizon_s": 0.0},
}
HANDLING = {"ga-bp-ukf": (m1.admit, m1.label)}  # how fresh rows are decided and named; else the default


def make(
    method: str,
    sensors: Sequence[Sensor],
    settings: Settings | None = None,
    correction: Callable = corrections.off,
) -> Estimator:
    """An estimator by name, which overrides some ``settings``. Raises ValueError for an unknown one."""
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}")
    handling = HANDLING.get(method, (decide.admit, outlier.label))
    return Estimator(sensors, (settings or Settings())._replace(**METHODS[method]), handling, correction)
