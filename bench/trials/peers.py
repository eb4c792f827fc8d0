"""Small filters to stand beside the estimator: extended Kalman filters on the ground instruments alone.

jerk    nine states, white jerk, takes every value: told the labels, it is what a textbook filter can reach
cv      constant velocity, 3-sigma gate per value; begins again after a gap or a run of refusals
cv-all  constant velocity, takes every value

Formulas: Bar-Shalom, Li, Kirubarajan (2001), 5.2, 6.2, 8.6 (smoother of Rauch, Tung, Striebel), 10.3.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from bench.trials.world import AZIMUTH, CHANNELS, ELEVATION, ISOLATED, RANGE, ROW, TRACK, VERDICT, Step

ACCELERATION_SIGMA_MPS2 = 10.0
GAP_S = 10.0  # of silence, after which it begins again
RUN = 5  # instants in a row with a refused value: the same
HEIGHT_SIGMA_M = 50.0  # of a first fix that has no elevation
TURN = np.array([2, 1, 0, *range(3, len(CHANNELS))])  # of the channels at one instant


class Peer(NamedTuple):
    """order: 2 constant velocity, 3 constant acceleration; psd: of the white noise that drives it."""

    order: int
    psd: float
    gate: float  # sigmas
    speed_mps: float = 30.0  # 1-sigma per axis before anything is known


PEERS = {"jerk": Peer(3, 20.0, np.inf), "cv": Peer(2, 10.0, 3.0), "cv-all": Peer(2, 10.0, np.inf)}


def make(name: str, sensors, psd: float | None = None, **other) -> "Ekf":
    """One of PEERS, ``psd`` and ``other`` fields in place of its own."""
    other |= {} if psd is None else {"psd": psd}
    return Ekf(sensors, PEERS[name]._replace(**other))


class Ekf:
    """The interface of the estimator: rows in order of time; those of the INS are not looked at."""

    def __init__(self, sensors, peer: Peer):
        self._sensors, self.peer = tuple(sensors), peer
        self._sigma = np.array([s.sigma for s in sensors])
        self._offset = np.array([s.offset_m for s in sensors], float)
        self._turn = np.array([s.rotation for s in sensors], float)
        self._ground = np.array([s.kind != "ins" for s in sensors])
        n = 3 * peer.order
        self._x, self._P = np.zeros(n), np.zeros((n, n))
        self._clock = np.zeros(
            4
        )  # started, time s of the state, instants with a refusal in a row, times begun
        self._waiting = np.zeros(0, ROW)
        self._epochs: list[tuple] = []
        self._t0_ns: int | None = None
        self.log_likelihood = 0.0

    def warm_up(self) -> None:
        """Nothing: the first step compiles."""

    def step(self, rows: np.ndarray) -> Step:
        """Take in ``rows`` (n,) ROW in order of time."""
        rows = np.concatenate([self._waiting, rows[self._ground[rows["sensor"]]]])
        self._waiting = np.zeros(0, ROW)
        if not len(rows):
            return _nothing()
        # Angles first: a long range bends more than it is wide across what an angle has not yet narrowed.
        rows = rows[np.lexsort((TURN[rows["channel"]], rows["t_ns"]))]
        if self._t0_ns is None:
            self._t0_ns = int(rows["t_ns"][0])
        n, m = len(self._x), len(rows)
        out = np.zeros((m, n)), np.zeros((m, n, n)), np.zeros(m, np.int8), np.zeros((m, 3)), np.zeros((m, 3))
        x, P, verdict, fit, when = out
        t_s = (rows["t_ns"] - self._t0_ns) * 1e-9
        columns = t_s, rows["sensor"].astype(np.int64), rows["channel"].astype(np.int64), rows["value"].copy()
        k, likelihood = _follow(
            *columns, self._sigma, self._offset, self._turn, np.array(self.peer, float),
            self._x, self._P, self._clock, x, P, verdict, fit, when,
        )  # fmt: skip
        self.log_likelihood += likelihood
        verdicts = np.zeros(m, VERDICT)
        verdicts["id"], verdicts["verdict"], verdicts["final"] = rows["id"], verdict, True
        verdicts["predicted"], verdicts["sigma"], verdicts["weight"] = fit.T
        t_ns = self._t0_ns + np.round(when[:k, 0] * 1e9).astype(np.int64)
        self._epochs.append((t_ns, x[:k], P[:k], when[:k, 1]))
        return Step(self._track(t_ns, x[:k], P[:k], when[:k, 1]), np.zeros(0, TRACK), verdicts)

    def finish(self) -> Step:
        """Nothing is left to decide."""
        return _nothing()

    def smooth(self) -> np.ndarray:
        """Rauch-Tung-Striebel back over the flight, each stretch between two beginnings for itself."""
        if not self._epochs:
            return np.zeros(0, TRACK)
        t_ns, x, P, begun = (np.concatenate(column) for column in zip(*self._epochs, strict=True))
        x, P = x.copy(), P.copy()
        if len(x):
            _back((t_ns - t_ns[0]) * 1e-9, begun, np.array(self.peer, float), x, P)
        return self._track(t_ns, x, P, begun)

    def report(self) -> dict:
        return {"sensors": {}, "resets": [], "log_likelihood": self.log_likelihood}

    def _track(self, t_ns, x, P, begun) -> np.ndarray:
        n, track = x.shape[1], np.zeros(len(t_ns), TRACK)
        track["t_ns"], track["quality"], track["reset_counter"] = t_ns, 100, begun - 1
        track["protection_h_m"] = track["protection_v_m"] = np.nan
        track["P"][:, range(6, 9), range(6, 9)] = ACCELERATION_SIGMA_MPS2**2
        track["x"][:, :n], track["P"][:, :n, :n] = x, P
        return track


def _nothing() -> Step:
    return Step(np.zeros(0, TRACK), np.zeros(0, TRACK), np.zeros(0, VERDICT))


@njit(cache=True)
def _transition(order, dt):
    """(n, n) of ``order`` derivatives: blocks dt^k/k!."""
    n = 3 * order
    F = np.eye(n)
    for i in range(n - 3):
        F[i, i + 3] = dt
    if order == 3:
        for i in range(3):
            F[i, i + 6] = 0.5 * dt * dt
    return F


@njit(cache=True)
def _noise(order, dt, psd):
    """(n, n) of white noise on the highest derivative."""
    n = 3 * order
    Q = np.zeros((n, n))
    fact = (1.0, 1.0, 2.0)
    for a in range(order):
        for b in range(order):
            i, j = order - 1 - a, order - 1 - b
            q = psd * dt ** (i + j + 1) / ((i + j + 1) * fact[i] * fact[j])
            for k in range(3):
                Q[3 * a + k, 3 * b + k] = q
    return Q


@njit(cache=True)
def _observe(channel, x, offset, turn, h):
    """Value of one polar channel and its gradient into ``h`` (n,)."""
    h[:] = 0.0
    y = turn @ (x[:3] - offset)
    flat2 = max(y[0] ** 2 + y[1] ** 2, 1e-6)
    flat, r = np.sqrt(flat2), np.sqrt(flat2 + y[2] ** 2)
    if channel == RANGE:
        h[:3] = y / r @ turn
        return r
    if channel == AZIMUTH:
        h[:3] = np.array([y[1] / flat2, -y[0] / flat2, 0.0]) @ turn
        return np.arctan2(y[0], y[1])
    if channel == ELEVATION:
        h[:3] = np.array([-y[0] * y[2] / flat, -y[1] * y[2] / flat, flat]) / r**2 @ turn
        return np.arctan2(y[2], flat)
    w = turn @ x[3:6]
    rate = y @ w / r
    h[:3] = (w - rate * y / r) / r @ turn
    h[3:6] = y / r @ turn
    return rate


@njit(cache=True)
def _begin(t_s, sensor, channel, value, i, offset, turn, sigma, speed, x, P):
    """Start at row ``i`` if it completes a fix with the rows of the last second; True where it does."""
    said = np.full((len(offset), 4), np.nan)
    for j in range(i, -1, -1):
        if t_s[i] - t_s[j] > 1.0:
            break
        if channel[j] < 4 and np.isnan(said[sensor[j], channel[j]]):
            said[sensor[j], channel[j]] = value[j]
    s = sensor[i]
    rays = np.zeros((len(offset), 3))
    for k in range(len(offset)):
        el = 0.0 if np.isnan(said[k, ELEVATION]) else said[k, ELEVATION]
        local = np.array([np.cos(el) * np.sin(said[k, 1]), np.cos(el) * np.cos(said[k, 1]), np.sin(el)])
        rays[k] = turn[k].T @ local
    wide, tall, found = 0.0, 0.0, False
    if not np.isnan(said[s, 0]) and not np.isnan(said[s, 1]):
        x[:3] = offset[s] + said[s, 0] * rays[s]
        wide = sigma[s, 0] + said[s, 0] * sigma[s, 1]
        tall = sigma[s, 0] + said[s, 0] * sigma[s, 2]
        found = not (np.isnan(said[s, 2]) and not np.isnan(sigma[s, 2]))
    for k in range(len(offset)):
        if not found and k != s and not np.isnan(said[k, 1]) and not np.isnan(said[s, 1]):
            c, base = rays[k] @ rays[s], offset[s] - offset[k]
            if 1.0 - c * c < 1e-2:
                continue
            a = (base @ rays[k] - c * (base @ rays[s])) / (1.0 - c * c)
            b = (c * (base @ rays[k]) - base @ rays[s]) / (1.0 - c * c)
            if a > 0.0 and b > 0.0:
                x[:3] = 0.5 * (offset[k] + a * rays[k] + offset[s] + b * rays[s])
                wide, found = max(a * sigma[k, 1], b * sigma[s, 1]) / np.sqrt(1.0 - c * c), True
                tall = wide
    if found:
        x[3:], P[:, :] = 0.0, 0.0
        for k in range(3):
            P[k, k] = (3.0 * wide) ** 2
            P[k + 3, k + 3] = speed**2
        P[2, 2] = HEIGHT_SIGMA_M**2 if np.isnan(said[s, 2]) else (3.0 * tall) ** 2
        for k in range(6, len(x)):
            P[k, k] = ACCELERATION_SIGMA_MPS2**2
    return found


@njit(cache=True)
def _follow(t_s, sensor, channel, value, sigma, offset, turn, peer, x, P, clock, xs, Ps, verdict, fit, when):
    """Rows through the filter, in place; returns (epochs, log likelihood). ``clock``: see `Ekf`."""
    order, psd, gate = int(peer[0]), peer[1], peer[2]
    n, epoch, likelihood, refused = len(x), 0, 0.0, False
    h = np.zeros(n)
    for i in range(len(t_s)):
        if clock[0] == 1.0 and (t_s[i] - clock[1] > GAP_S or clock[2] >= RUN) and gate < np.inf:
            clock[0] = 0.0
        if clock[0] == 0.0:
            if not _begin(t_s, sensor, channel, value, i, offset, turn, sigma, peer[3], x, P):
                verdict[i] = ISOLATED
                continue
            clock[0], clock[1], clock[2], clock[3] = 1.0, t_s[i], 0.0, clock[3] + 1.0
        dt = t_s[i] - clock[1]
        if dt > 0.0:
            F = _transition(order, dt)
            x[:] = F @ x
            P[:, :] = F @ P @ F.T + _noise(order, dt, psd)
        clock[1] = t_s[i]
        s, c = sensor[i], channel[i]
        seen = _observe(c, x, offset[s], turn[s], h)
        v = value[i] - seen
        if c == AZIMUTH:
            v = (v + np.pi) % (2.0 * np.pi) - np.pi
        m = P @ h
        S = h @ m + sigma[s, c] ** 2
        fit[i, 0], fit[i, 1] = seen, np.sqrt(S)
        if v * v <= gate * gate * S:
            K = m / S
            x += K * v
            P -= np.outer(K, m)
            likelihood -= 0.5 * (v * v / S + np.log(2.0 * np.pi * S))
            fit[i, 2] = 1.0
        else:
            verdict[i] = ISOLATED
            refused = True
        if i + 1 == len(t_s) or t_s[i + 1] != t_s[i]:
            clock[2] = clock[2] + 1.0 if refused else 0.0
            refused = False
            xs[epoch], Ps[epoch] = x, P
            when[epoch, 0], when[epoch, 1] = t_s[i], clock[3]
            epoch += 1
    return epoch, likelihood


@njit(cache=True)
def _back(t_s, begun, peer, x, P):
    """Smooth filtered states (k, n), (k, n, n) in place."""
    order, psd = int(peer[0]), peer[1]
    for k in range(len(x) - 2, -1, -1):
        if begun[k] != begun[k + 1]:
            continue
        dt = t_s[k + 1] - t_s[k]
        F = _transition(order, dt)
        ahead = F @ P[k] @ F.T + _noise(order, dt, psd) + 1e-12 * np.eye(x.shape[1])
        G = np.linalg.solve(ahead, F @ P[k]).T
        x[k] += G @ (x[k + 1] - F @ x[k])
        P[k] += G @ (P[k + 1] - ahead) @ G.T
