"""The estimators by name: what ``--method`` can choose.

``default`` judges rows in a window. ``ukf``, ``gate``, ``igg`` and ``ga-bp-ukf`` are the same filter with
another weight at first sight. The last three are whole filters of the literature, to compare with; they take
no learned correction and give no protection level, and ``filterpy-ukf`` is slow: 0.3 ms a row.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from filters.baselines import baselines
from filters.baselines.classic import ClassicUkf
from filters.correction import correction as corrections
from filters.models.rows import Sensor
from filters.models.settings import Settings
from filters.models.store import InMemory, Keep
from filters.smoother import gated
from filters.smoother.estimator import FixedLagSmoother

METHODS: dict[str, gated.Rule | Callable[[Sequence[Sensor], Settings], baselines.Baseline]] = {
    "default": gated.BY_STATUS,
    "ukf": gated.Rule(gated.IGG, np.inf, np.inf),  # takes every value
    "gate": gated.Rule(gated.IGG, 4.0, 4.0),
    "igg": gated.Rule(gated.IGG, 1.5, 8.5),
    "ga-bp-ukf": gated.Rule(gated.M1, 4.0, 8.0),  # C; at 3, a curved first prediction loses its target
    **{name: partial(baselines.make, name) for name in baselines.PSD_FACTORS},  # wolf, imm
    "filterpy-ukf": ClassicUkf,
}


def make(
    method: str,
    sensors: Sequence[Sensor],
    settings: Settings | None = None,
    correction: Callable = corrections.off,
    keep: Keep = InMemory,
) -> FixedLagSmoother | baselines.Baseline:
    """An estimator by name; ``keep`` makes the places for what is final, where it keeps little else.

    Raises ValueError for an unknown one, or one that takes no ``correction``.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}")
    chosen = METHODS[method]
    if isinstance(chosen, gated.Rule):
        return FixedLagSmoother(sensors, settings or Settings(), chosen, correction, keep)
    if correction is not corrections.off:
        raise ValueError(f"method {method!r} takes no learned correction: leave out --correction")
    return chosen(sensors, settings or Settings())
