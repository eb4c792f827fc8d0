"""The estimator's evidence in numbers: consistency per channel, systematic errors, resets."""

from collections.abc import Sequence

import numpy as np

from filters.models.motion import CORE
from filters.models.rows import CHANNELS, Sensor
from filters.models.state import Model, common_shift, common_variance

SEEN = 0.5  # a systematic error is observable when the flight has at least halved its prior sigma
UNITS = {
    "range": "m", "azimuth": "rad", "elevation": "rad", "e": "m", "n": "m", "u": "m",
    "ve": "m/s", "vn": "m/s", "vu": "m/s",
}  # fmt: skip


def report(
    sensors: Sequence[Sensor],
    model: Model,
    x: np.ndarray,
    P: np.ndarray,
    tally: np.ndarray,
    resets: list[dict],
) -> dict:
    """Per sensor: channels with counts and mean NIS in its 95 % band, and the systematic errors with 1-sigma.

    The band is that of the mean of independent χ²(1) values, 1 ± 1.96 √(2/count) (Bar-Shalom et al., 5.4.2).
    """
    out = {"sensors": {}, "resets": list(resets)}
    heard = tally[..., 0].any(axis=1)
    for s, sensor in enumerate(sensors):
        channels = {}
        for c in np.flatnonzero(np.isfinite(sensor.sigma)):
            used, total, refused = tally[s, c]
            half = 1.96 * np.sqrt(2.0 / used) if used else 0.0
            channels[CHANNELS[c]] = {
                "used": int(used),
                "refused": int(refused),
                "nis_mean": float(total / used) if used else None,
                "nis_band_95": [float(1.0 - half), float(1.0 + half)] if used else None,
            }
        out["sensors"][sensor.name] = {"channels": channels, "errors": _errors(model, s, x, P, heard)}
    return out


def _errors(model, s, x, P, heard) -> dict:
    """Systematic errors of sensor ``s``, slow ones aside: value, sigma, prior sigma, unit, observable."""
    lasting = [(c, i) for c, i in enumerate(model.bias_at[s]) if i >= 0 and model.slow_of[i - CORE] < 0]
    where = {CHANNELS[c]: (i, UNITS[CHANNELS[c]]) for c, i in lasting}
    if model.clock_at[s] >= 0:
        where["latency" if model.is_ins[s] else "clock"] = (model.clock_at[s], "s")
    out = {}
    for name, (i, unit) in where.items():
        if i < len(x):
            value, variance, prior = float(x[i]), P[i, i], float(np.sqrt(model.prior[i]))
            if i == model.clock_at[s]:
                value -= common_shift(model, x[None, model.clock_at], heard)[0]
                variance += common_variance(model)
            sigma = float(np.sqrt(variance))
            out[name] = {
                "value": float(value), "sigma": sigma, "prior_sigma": prior, "unit": unit,
                "observable": sigma < SEEN * prior,
            }  # fmt: skip
    return out
