"""The classic unscented filter of the library filterpy, to compare with: every row used, no second thought.

Textbook sigma points with α = 1, β = 0, κ = 3 − n, drawn again before each scalar update (Julier & Uhlmann
2004, *Unscented filtering and nonlinear estimation*; Wan & van der Merwe 2000). State: position, velocity,
acceleration, and the position error of each INS, Gauss-Markov. Motion, noise and what a sensor sees are the
estimator's; zero errors, clocks and latencies are taken for none. Slow: 0.3 ms a row.
"""

from collections.abc import Sequence

import numpy as np

from filters.baselines.baselines import Baseline, columns, publish
from filters.baselines.interacting import LOST, LOST_NS, LOST_ROWS, REASONS, SILENT, SILENT_NS, Mixture
from filters.models import motion, radar, theodolite
from filters.models import state as models
from filters.models.motion import CORE
from filters.models.rows import RANGE_RATE, USED, VE, VERDICT, E, Sensor
from filters.models.settings import Settings
from filters.models.unscented import difference
from filters.smoother import status

START_SIGMAS = 25.0, 30.0, 10.0  # m, m/s, m/s² per axis, of a first state: a fix, and a UAV's usual speeds
KEPT_SIGMA = 1e-3  # m/s, m/s²: of a height known beforehand, which stays; zero has no Cholesky factor
BELIEVED_SIGMAS = 9.0  # of an innovation: a position nearer than that confirms the state, as `interacting`
BROKEN = 3
WHY = REASONS | {BROKEN: "its covariance lost its digits"}


class ClassicUkf(Baseline):
    """The interface of `FixedLagSmoother`; starts, and starts anew, as the others of this folder."""

    def __init__(self, sensors: Sequence[Sensor], settings: Settings):
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # 0.8 s

        super().__init__(sensors, settings, (1.0,), imq=False)
        self.model = reduced(self.model)
        if np.isfinite(settings.height_m):
            self._psd[[1, 3]] = 0.0
        n = len(self.model.prior)
        points = MerweScaledSigmaPoints(n, 1.0, 0.0, 3.0 - n)
        self._kf = UnscentedKalmanFilter(n, 1, 1.0, hx=None, fx=lambda x, _, F: F @ x, points=points)
        self._epochs: list[list[tuple[int, np.ndarray, np.ndarray]]] = []  # of each stretch: time, x, P

    def _lock_on(self, x: np.ndarray, P: np.ndarray, t_ns: int) -> None:
        """Start from ``x`` (n,) with sigmas that sigma points can bear; of ``P`` the errors count."""
        P = np.diag(np.diag(P))
        P[range(CORE), range(CORE)] = np.repeat(START_SIGMAS, 3) ** 2
        if np.isfinite(self._height[0]):
            P[[2, 5, 8], [2, 5, 8]] = np.array([self._height[1], KEPT_SIGMA, KEPT_SIGMA]) ** 2
        super()._lock_on(x, P, t_ns)
        self._kf.x, self._kf.P = x.copy(), P
        self._epochs.append([])

    def _follow(self, new: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Filter ``new`` (k,) ROW until the lock is lost: (rows taken, their TRACK, their VERDICT)."""
        rows, kf, lock = columns(self.model, new, self._height[0]), self._kf, self._mixture.lock
        residual, sigma = np.zeros((2, len(new)))
        first, count, lost = len(self._epochs[-1]), len(new), 0
        for i, t in enumerate(rows.t):
            if t != self._now_ns:
                lost = _lost(t, lock)
                if lost:
                    count = i
                    break
            try:
                if t != self._now_ns:
                    self._predict((t - self._now_ns) * 1e-9)
                self._now_ns = int(t)
                residual[i], sigma[i] = self._update(rows, i)
            except np.linalg.LinAlgError:
                lost, count = BROKEN, i + 1
                break
            if rows.channel[i] < VE and rows.channel[i] != RANGE_RATE:
                believed = abs(residual[i]) < BELIEVED_SIGMAS * sigma[i]
                lock[:] = (t, 0) if believed else (lock[0], lock[1] + 1)
            if i + 1 == len(rows.t) or rows.t[i + 1] != t:
                self._epochs[-1].append((int(t), kf.x.copy(), kf.P.copy()))
        self._mixture = Mixture(kf.x[None], kf.P[None], np.ones(1), lock)
        if lost:
            self._resets.append({"t_ns": int(rows.t[min(count, len(new) - 1)]), "reason": WHY[lost]})
            self._mixture = None
        track = _stacked(self._epochs[-1][first:], len(self._epochs) - 1)
        return count, track, self._judge(new[:count], rows.value[:count], residual[:count], sigma[:count])

    def smooth(self) -> np.ndarray:
        """Forward and backward over each stretch (Rauch, Tung & Striebel 1965), (k,) TRACK."""
        parts = [_stacked(self._back(epochs), k) for k, epochs in enumerate(self._epochs)]
        return np.concatenate([_stacked([], 0), *parts])

    def _predict(self, dt: float) -> None:
        F, self._kf.Q = self._transition(dt)
        self._kf.predict(F=F)

    def _update(self, rows, i: int) -> tuple[float, float]:
        """Take row ``i`` in; its innovation and 1-sigma. Raises LinAlgError where P is no covariance."""
        kf, s, channel = self._kf, rows.sensor[i], int(rows.channel[i])
        centre = observe(self.model, s, channel, kf.x)
        kf.sigmas_f = kf.points_fn.sigma_points(kf.x, kf.P)  # filterpy keeps those of before the last update
        kf.update(
            np.array([difference(channel, rows.value[i], centre)]),
            R=rows.stated[i],
            hx=lambda x: np.array([difference(channel, observe(self.model, s, channel, x), centre)]),
        )
        if not (kf.S[0, 0] > 0.0 and np.isfinite(kf.x).all()):
            raise np.linalg.LinAlgError
        return kf.y[0], np.sqrt(kf.S[0, 0])

    def _transition(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """(n, n) transition and noise of `motion.predict`, which is linear."""
        n, model = len(self.model.prior), self.model
        F, Q = np.eye(n), np.zeros((n, n))
        motion.carry(F, dt)
        F[range(CORE, n), range(CORE, n)] = np.exp(-model.rate[CORE:] * dt)
        motion.predict(np.zeros(n), Q, dt, self._psd, model.rate, model.prior)
        return F, Q

    def _back(self, epochs: list) -> list:
        """The ``epochs`` of one stretch, each by all of its rows."""
        out = epochs[-1:]
        for t, x, P in epochs[-2::-1]:
            later, x_later, P_later = out[-1]
            F, Q = self._transition((later - t) * 1e-9)
            ahead = F @ P @ F.T + Q
            gain = np.linalg.solve(ahead, F @ P).T
            out.append((t, x + gain @ (x_later - F @ x), P + gain @ (P_later - ahead) @ gain.T))
        return out[::-1]

    def _judge(self, new, value, residual, sigma) -> np.ndarray:
        """(k,) VERDICT: every row is used, whatever it says."""
        out, where = np.zeros(len(new), VERDICT), (new["sensor"], new["channel"])
        there = sigma > 0.0  # but for one that broke the filter
        np.add.at(self._tally[..., 0], where, 1.0)
        np.add.at(
            self._tally[..., 1], where, np.where(there, residual / np.where(there, sigma, 1.0), 0.0) ** 2
        )
        out["id"], out["final"], out["weight"] = new["id"], True, 1.0
        out["predicted"], out["sigma"] = value - residual, sigma
        out["verdict"], out["reason"] = USED, status.NONE
        return out


def reduced(model: models.Model) -> models.Model:
    """``model`` with the position errors of the INS alone: no zero errors, no clocks."""
    bias_at, rate, prior = np.full_like(model.bias_at, -1), [0.0] * CORE, [0.0] * CORE
    for s in np.flatnonzero(model.is_ins):
        for channel in range(E, VE):
            at = model.bias_at[s, channel]
            if at >= 0:
                bias_at[s, channel] = len(prior)
                rate.append(model.rate[at])
                prior.append(model.prior[at])
    clock_at, slow_of = np.full_like(model.clock_at, -1), np.full(len(prior) - CORE, -1)
    return model._replace(
        bias_at=bias_at, clock_at=clock_at, rate=np.array(rate), prior=np.array(prior), slow_of=slow_of
    )


def observe(model: models.Model, s: int, channel: int, x: np.ndarray) -> float:
    """What sensor ``s`` says on ``channel`` of a state ``x`` (n,) of the `reduced` model."""
    if model.is_ins[s]:
        at = model.bias_at[s, channel]
        return x[channel - E] + (x[at] if at >= 0 else 0.0)
    p = model.rotation[s] @ (x[:3] - model.offset[s])
    if channel == RANGE_RATE:
        return radar.range_rate(p, model.rotation[s] @ x[3:6])
    return theodolite.observe(channel, p, model.bend[s])


def _lost(t_ns: int, lock: np.ndarray) -> int:
    """Why the filter has to begin anew before ``t_ns``: LOST, SILENT or 0."""
    silence = t_ns - lock[0]
    if silence > LOST_NS and lock[1] >= LOST_ROWS:
        return LOST
    return SILENT if silence > SILENT_NS else 0


def _stacked(epochs: list, stretch: int) -> np.ndarray:
    """(k,) TRACK of (time, x, P)."""
    if not epochs:
        return publish(np.zeros(0, np.int64), np.zeros((0, CORE)), np.zeros((0, CORE, CORE)), stretch)
    t, x, P = (np.array(column) for column in zip(*epochs, strict=True))
    return publish(t, x, P, stretch)
