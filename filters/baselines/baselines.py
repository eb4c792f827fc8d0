"""Two robust filters of the literature, as published, to compare with: no window, no second thought.

wolf   weighted-observation-likelihood filter, inverse multi-quadric weights (Duran-Martin et al. 2024,
       *Outlier-robust Kalman filtering through generalised Bayes*, ICML; arXiv 2405.05646): the noise R of a
       value with innovation v becomes R/w, w = 1/(1 + v²/(c² R)).
imm    two interacting filters, for calm flight and for manoeuvres (Blom & Bar-Shalom 1988; Bar-Shalom, Li,
       Kirubarajan 2001, 11.6.6), with a soft gate: beyond it the noise grows with v² (Huber's weight, as in
       Karlgaard & Schaub 2007), so that no value pulls more than one at the gate does.

Model, start and updates are the estimator's. Rows come in order of time; older ones get the verdict ``late``.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from filters.models import model as models
from filters.models import motion
from filters.models.motion import CORE
from filters.models.rows import CHANNELS, DEWEIGHTED, LATE, ROW, TRACK, USED, VERDICT, Sensor, Step
from filters.models.unscented import difference
from filters.models.update import update
from filters.window import outlier, passes, start
from filters.window import report as reports
from filters.window.estimator import Settings

IMQ_SIGMAS = 3.0  # c: a value so far off has half its weight; 2 to 4 make little difference
SOFT_GATE = 3.0  # sigmas of the innovation
STAY_S = 2.0  # a manoeuvre lasts about so long, and so does the calm
PSD_FACTORS = {"wolf": (1.0,), "imm": (0.1, 3.0)}  # times the estimator's jerk density, one filter each
START_NS = 1_000_000_000  # rows so far apart may still make a fix together; the first track comes after it


def make(method: str, sensors: Sequence[Sensor], settings: Settings) -> "Baseline":
    """One of PSD_FACTORS; of ``settings`` the motion and the INS errors count."""
    model = models.build(sensors, settings.jerk_psd, settings.ins_bias_sigma_m, settings.ins_bias_tau_s)
    return Baseline(sensors, model, settings.jerk_psd * np.array(PSD_FACTORS[method]), imq=method == "wolf")


class Mind(NamedTuple):
    """m filters side by side and how much each is believed."""

    x: np.ndarray  # (m, n)
    P: np.ndarray  # (m, n, n)
    chance: np.ndarray  # (m,) sums to 1


class Baseline:
    """The interface of `Estimator`: step, finish, smooth, report."""

    def __init__(self, sensors: Sequence[Sensor], model: models.Model, jerk_psd: np.ndarray, *, imq: bool):
        self.sensors, self.model = tuple(sensors), model
        self._jerk_psd, self._imq = jerk_psd, imq
        self._waiting = np.zeros(0, ROW)
        self._start: tuple[np.ndarray, np.ndarray] | None = None
        self._mind: Mind | None = None
        self._newest_ns = np.iinfo(np.int64).min
        self._rows: list[np.ndarray] = []
        self._weights: list[np.ndarray] = []
        self._tally = np.zeros((len(sensors), len(CHANNELS), 3))

    def warm_up(self) -> None:
        """Nothing: the first step compiles."""

    def step(self, rows: np.ndarray) -> Step:
        """Take in ``rows`` (n,) ROW in order of time."""
        late = rows["t_ns"] < self._newest_ns
        refused = np.zeros(late.sum(), VERDICT)
        refused["id"], refused["final"] = rows["id"][late], True
        refused["verdict"], refused["reason"] = LATE, outlier.TOO_OLD
        rows = rows[~late]
        if self._mind is None:
            self._waiting = np.concatenate([self._waiting, rows])
            self._begin()
            rows = self._waiting
        if self._mind is None or not len(rows):
            return Step(np.zeros(0, TRACK), np.zeros(0, TRACK), refused)
        track, verdicts = self._follow(rows)
        return Step(track, np.zeros(0, TRACK), np.concatenate([refused, verdicts]))

    def finish(self) -> Step:
        """Nothing is left to decide."""
        return Step(np.zeros(0, TRACK), np.zeros(0, TRACK), np.zeros(0, VERDICT))

    def smooth(self) -> np.ndarray:
        """Ahead and back over the whole flight with the weights given at first sight, (k,) TRACK."""
        if self._mind is None:
            return np.zeros(0, TRACK)
        rows, weight, n = np.concatenate(self._rows), np.concatenate(self._weights), len(self.model.prior)
        (x, P), end = (part.copy() for part in self._start), len(rows)
        t, sensor, channel = rows["t_ns"], rows["sensor"], rows["channel"]
        noise, jerk = self.model.variance[sensor, channel], np.full(len(rows), self.model.jerk_psd)
        given = passes.Given(t, sensor, channel, rows["value"], noise, jerk, weight)
        out, work = passes.trace(end, n, end), models.scratch(n)
        passes.ahead(self.model, given, 0, end, x, P, t[0], out, work)
        r, N = np.zeros(n), np.zeros((n, n))
        passes.back(self.model, given, 0, end, out, r, N, work)
        first = np.flatnonzero(np.diff(t, prepend=t[0] - 1))
        return _track(t[first], out.x[first], out.P[first])

    def report(self) -> dict:
        """As `Estimator.report`."""
        x, P = (self._mind.x[0], self._mind.P[0]) if self._mind else (np.zeros(0), np.zeros((0, 0)))
        return reports.report(self.sensors, self.model, x, P, self._tally, [])

    def _begin(self) -> None:
        """Start from the surest fix of the first START_NS that have one; older rows get no state."""
        while len(self._waiting) and np.ptp(self._waiting["t_ns"]) >= START_NS:
            t = self._waiting["t_ns"]
            first = self._waiting[t <= t[0] + START_NS]
            fixes = start.fixes(self.model, first["sensor"], first["channel"], first["value"])
            if not fixes:
                self._waiting = self._waiting[t > t[0] + START_NS]
                continue
            self._start, m = start.state(self.model, *fixes[0]), len(self._jerk_psd)
            x, P = (np.repeat(part[None], m, axis=0) for part in self._start)
            self._mind, self._newest_ns = Mind(x, P, np.full(m, 1.0 / m)), t[0]
            return

    def _follow(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        last = np.flatnonzero(np.diff(rows["t_ns"], append=rows["t_ns"][-1] + 1))
        n = len(self.model.prior)
        x, P = np.zeros((len(last), n)), np.zeros((len(last), n, n))
        verdicts, nis = np.zeros(len(rows), VERDICT), np.zeros(len(rows))
        columns = (np.ascontiguousarray(rows[name]) for name in ("t_ns", "sensor", "channel", "value"))
        weight, predicted, sigma = (np.zeros(len(rows)) for _ in range(3))
        follow(
            self.model, *columns, self._newest_ns, self._jerk_psd, self._imq, self._mind,
            weight, predicted, sigma, nis, x, P, passes.trace(1, n, 1), models.scratch(n),
        )  # fmt: skip
        self._newest_ns = rows["t_ns"][-1]
        self._rows.append(rows)
        self._weights.append(weight)
        np.add.at(self._tally, (rows["sensor"], rows["channel"], 0), 1)
        np.add.at(self._tally, (rows["sensor"], rows["channel"], 1), nis)
        verdicts["id"], verdicts["final"] = rows["id"], True
        verdicts["weight"], verdicts["predicted"], verdicts["sigma"] = weight, predicted, sigma
        verdicts["verdict"] = np.where(weight < 0.5, DEWEIGHTED, USED)
        return _track(rows["t_ns"][last], x, P), verdicts


def _track(t_ns, x, P) -> np.ndarray:
    track = np.zeros(len(t_ns), TRACK)
    track["t_ns"], track["x"], track["P"], track["quality"] = t_ns, x[:, :CORE], P[:, :CORE, :CORE], 100
    return track


@njit(cache=True)
def follow(
    model, t, sensor, channel, value, t_ns, jerk_psd, imq, mind,
    weight, predicted, sigma, nis, x, P, out, work,
):  # fmt: skip
    """Filter rows (n,) from ``mind`` at ``t_ns``, in place; the state after each epoch to ``x``, ``P``."""
    evidence, epoch = np.zeros(len(jerk_psd)), 0
    for i in range(len(t)):
        s, c = sensor[i], channel[i]
        noise = model.variance[s, c]
        if i == 0 or t[i] != t_ns:
            dt = (t[i] - t_ns) * 1e-9
            mix(mind, dt)
            for k, psd in enumerate(jerk_psd):
                motion.predict(mind.x[k], mind.P[k], dt, psd, model.rate, model.prior)
            evidence[:] = 0.0
            t_ns = t[i]
        for k, chance in enumerate(mind.chance):
            psd = jerk_psd[k]
            seen, variance = models.predict_row(model, s, c, mind.x[k], mind.P[k], psd, out, 0, work)
            v = difference(c, value[i], seen)
            u2 = v * v / (variance + noise)
            w = _imq(v * v / noise) if imq else _huber(u2)
            S = variance + noise / w
            update(mind.x[k], mind.P[k], out.m[0], v, S)
            evidence[k] -= 0.5 * (v * v / S + np.log(S))
            weight[i] += chance * w
            predicted[i] += chance * (value[i] - v)
            sigma[i] += chance * np.sqrt(variance + noise)
            nis[i] += chance * u2
        if i + 1 == len(t) or t[i + 1] != t_ns:
            mind.chance[:] *= np.exp(evidence - evidence.max())
            mind.chance[:] /= mind.chance.sum()
            blend(mind, mind.chance, x[epoch], P[epoch])
            epoch += 1


@njit(cache=True)
def _imq(u2):
    return 1.0 / (1.0 + u2 / IMQ_SIGMAS**2)


@njit(cache=True)
def _huber(u2):
    return 1.0 if u2 <= SOFT_GATE**2 else SOFT_GATE**2 / u2


@njit(cache=True)
def mix(mind, dt):
    """Each filter begins from what all of them may have become in ``dt`` seconds, in place."""
    m = len(mind.chance)
    if m == 1:
        return
    leave = 0.5 - 0.5 * np.exp(-2.0 * dt / STAY_S)
    before = Mind(mind.x.copy(), mind.P.copy(), mind.chance.copy())
    for j in range(m):
        share = before.chance * leave / (m - 1)
        share[j] = before.chance[j] * (1.0 - leave)
        mind.chance[j] = share.sum()
        blend(before, share / share.sum(), mind.x[j], mind.P[j])


@njit(cache=True)
def blend(mind, share, x, P):
    """Mean and covariance of the mixture, in place of ``x`` (n,), ``P`` (n, n)."""
    x[:], P[:] = 0.0, 0.0
    for k in range(len(share)):
        x += share[k] * mind.x[k]
    for k in range(len(share)):
        off = mind.x[k] - x
        P += share[k] * (mind.P[k] + np.outer(off, off))
