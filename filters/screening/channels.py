"""Every raw channel of the instruments screened alone: what its own past makes doubtful, no trajectory.

One `screening` state per sensor and channel, stepped row by row. It never changes a value: the estimator
judges, and the record tells where both agree.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from filters.models.rows import AZIMUTH, CHANNELS, Sensor
from filters.screening import screening
from filters.screening.screening import OUTLIER, ChannelState, Thresholds, step


class ChannelScreening:
    """Watches rows in order of time; one that comes after a newer one of its channel is not judged."""

    def __init__(self, sensors: Sequence[Sensor]):
        """The INS is not watched: its values are filtered already, so they have no noise to judge by."""
        shape = len(sensors), len(CHANNELS)
        usual = Thresholds(1.0)
        window = usual.window
        self._sigma = np.stack([sensor.sigma for sensor in sensors])
        self._sigma[[sensor.kind == "ins" for sensor in sensors]] = np.nan
        self._settings = screening.plain(usual)
        self._state = ChannelState(
            np.zeros((*shape, window)),
            np.zeros((*shape, window)),
            np.zeros((*shape, window)),
            np.zeros((*shape, window), np.bool_),
            np.zeros((*shape, 4), np.int64),
            np.zeros((*shape, 3)),
        )
        self._state.track[..., 2] = self._sigma
        self._newest = np.full(shape, -np.inf)
        self._begin_ns: int | None = None

    def doubts(self, rows: np.ndarray) -> np.ndarray:
        """(n,) bool of (n,) ROW: is it an outlier by what its own channel said before?"""
        out = np.zeros(len(rows), np.bool_)
        if len(rows):
            self._begin_ns = int(rows["t_ns"][0]) if self._begin_ns is None else self._begin_ns
            t_s = (rows["t_ns"] - self._begin_ns) * 1e-9
            columns = (rows[name].copy() for name in ("sensor", "channel", "value"))
            _watch(self._state, self._sigma, self._newest, t_s, *columns, self._settings, out)
        return out


class NoScreening:
    """Doubts nothing."""

    def doubts(self, rows: np.ndarray) -> np.ndarray:
        return np.zeros(len(rows), np.bool_)


@njit(cache=True)
def _watch(state, sigma, newest, t_s, sensor, channel, value, settings, out):
    for i in range(len(out)):
        k = sensor[i], channel[i]
        if not (sigma[k] > 0.0 and t_s[i] > newest[k]):
            continue
        newest[k] = t_s[i]
        own = ChannelState(
            state.t[k], state.x[k], state.residual[k], state.refused[k], state.count[k], state.track[k]
        )
        period = 2.0 * np.pi if channel[i] == AZIMUTH else 0.0
        mine = Thresholds(
            sigma[k],
            settings.start,
            settings.threshold,
            settings.window,
            settings.reach,
            settings.alpha,
            period,
        )
        out[i] = step(own, t_s[i], value[i], mine, True, True)[0] == OUTLIER
