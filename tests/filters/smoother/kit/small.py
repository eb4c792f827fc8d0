"""Small sets of sensors, rows and flights for the tests, and dense linear algebra as their oracle."""

import numpy as np
from scipy.linalg import expm

from filters.models import motion, state
from filters.models.motion import CORE, MOTIONS
from filters.models.rows import AE, AZIMUTH, ELEVATION, RANGE, RANGE_RATE, ROW, E, Sensor
from filters.models.theodolite import places
from filters.smoother.buffer import Outcome, Rows, outcome

NO_TIME_S = 1e-9  # prior of a latency that is as good as none: an INS is linear then
PSD = np.array([10.0, 4.0, 0.5, 0.2])


def sigmas(**by_channel) -> np.ndarray:
    """(13,) NaN but for the channels given: ``r, az, el, rr``, ``p`` position, ``v`` velocity, ``a``."""
    out = np.full(13, np.nan)
    for name, at in {"r": RANGE, "az": AZIMUTH, "el": ELEVATION, "rr": RANGE_RATE}.items():
        if name in by_channel:
            out[at] = by_channel[name]
    for name, at in {"p": E, "v": E + 3, "a": AE}.items():
        if name in by_channel:
            out[at : at + 3] = by_channel[name]
    return out


def ins(name="ins", clock_sigma_s=NO_TIME_S, **sigma) -> Sensor:
    return Sensor(name, "ins", sigmas(**(sigma or {"p": 0.5, "v": 0.2})), clock_sigma_s=clock_sigma_s)


def theodolite(name="theodolite", place=(0.0, 0.0, 0.0), estimate=(), slow=0.0, **sigma) -> Sensor:
    sigma = sigmas(**(sigma or {"r": 1.0, "az": 1e-4, "el": 1e-4}))
    return Sensor(name, "theodolite", sigma, np.array(place, float), estimate=estimate, slow=slow)


def radar(name="radar", place=(0.0, 0.0, 0.0), estimate=(), slow=0.0, **sigma) -> Sensor:
    sigma = sigmas(**(sigma or {"r": 5.0, "az": 1e-3, "el": 1e-3, "rr": 0.3}))
    return Sensor(name, "radar", sigma, np.array(place, float), estimate=estimate, slow=slow)


def polar(sensor: Sensor, p: np.ndarray, v: np.ndarray | None = None) -> dict[int, float]:
    """What an instrument sees of a target at ``p`` (3,) with velocity ``v`` (3,)."""
    q = sensor.rotation @ (np.asarray(p) - sensor.offset_m)
    seen = {
        RANGE: np.linalg.norm(q),
        AZIMUTH: np.arctan2(q[0], q[1]),
        ELEVATION: np.arctan2(q[2], np.hypot(q[0], q[1])),
    }
    if v is not None:
        seen[RANGE_RATE] = q @ (sensor.rotation @ v) / np.linalg.norm(q)
    return seen


def densities(model, psd=PSD, factor=1.0) -> np.ndarray:
    """(n − 5,) of the motion's ``psd`` (4,) and of the errors, all of ``factor`` or (n − 9,) of each."""
    return motion.densities(psd, np.broadcast_to(factor, len(model.prior) - CORE))


def as_rows(said, model) -> Rows:
    """Rows of a list of (t_s, sensor, channel, value), in the order given, with the sensors' own noise."""
    t, sensor, channel, value = (np.array(column) for column in zip(*said, strict=True))
    sensor, channel = sensor.astype("i2"), channel.astype("i1")
    stated = model.variance[sensor, channel]
    t_ns = np.round(t * 1e9).astype("i8")
    return Rows(t_ns, sensor, channel, value.astype(float), stated, np.full((len(t), 3), np.nan))


def fresh(rows: Rows, weight=1.0) -> Outcome:
    """Not judged, all of ``weight``, with the noise as stated."""
    own = outcome(len(rows.t))
    own.weight[:], own.noise[:] = weight, rows.stated
    return own


def truth(t_s, p0=(300.0, 900.0, 200.0), v0=(30.0, -10.0, 2.0), turn=0.3):
    """Position and velocity (k, 3) each: level turns around a straight line, bending by 5 m/s² at most."""
    t = np.asarray(t_s, float)[:, None]
    radius = 30.0
    phase = turn * t + [0.0, 0.5 * np.pi, 0.0]
    sway = radius * np.sin(phase) * [1.0, 1.0, 0.3]
    speed = radius * turn * np.cos(phase) * [1.0, 1.0, 0.3]
    return np.asarray(p0) + np.asarray(v0) * t + sway, np.asarray(v0) + speed


def fly(sensors, seconds, hz=10.0, seed=0, begin_s=0.0, noise=1.0, **path) -> np.ndarray:
    """(k,) ROW of all ``sensors`` along `truth`, with white noise, each a little after the other."""
    rng, out, count = np.random.default_rng(seed), [], round(seconds * hz)
    for s, sensor in enumerate(sensors):
        t = begin_s + np.arange(count) / hz + 0.003 * s
        p, v = truth(t, **path)
        for i in range(count):
            if sensor.kind == "ins":
                seen = {E + a: p[i, a] for a in range(3)} | {E + 3 + a: v[i, a] for a in range(3)}
            else:
                seen = polar(sensor, p[i], v[i])
            for c, value in seen.items():
                if np.isfinite(sensor.sigma[c]):
                    value += noise * sensor.sigma[c] * rng.normal()
                    out.append((0, round(t[i] * 1e9), s, c, value, 0.0))
    rows = np.array(out, ROW)
    rows = rows[np.lexsort((rows["channel"], rows["sensor"], rows["t_ns"]))]
    rows["id"] = np.arange(len(rows))
    return rows


def drift(flight: np.ndarray, sensors, size, tau_s, seed=0) -> np.ndarray:
    """``flight`` with slow errors of ``size`` times the noise in every range and angle; a copy.

    Each a Gauss-Markov process of its own, one draw after the other.
    """
    rng, out = np.random.default_rng(seed), flight.copy()
    for s, sensor in enumerate(sensors):
        for c in (RANGE, AZIMUTH, ELEVATION):
            mine = np.flatnonzero((out["sensor"] == s) & (out["channel"] == c))
            error, before_ns = rng.normal(), 0
            for i in mine:
                keep = np.exp(-(out["t_ns"][i] - before_ns) * 1e-9 / tau_s)
                error = keep * error + np.sqrt(1.0 - keep**2) * rng.normal()
                out["value"][i] += size * sensor.sigma[c] * error
                before_ns = out["t_ns"][i]
    return out


def to_rows(flight: np.ndarray, model, height_m=np.nan) -> Rows:
    """Rows of (k,) ROW in order of time, with the places that they stand for."""
    said = [(r["t_ns"] * 1e-9, r["sensor"], r["channel"], r["value"]) for r in flight]
    rows = as_rows(said, model)
    rows.t[:] = flight["t_ns"]
    places(rows, model.offset, model.rotation, model.is_ins, height_m, 0)
    return rows


def four() -> list[Sensor]:
    """An INS, two theodolites and a radar around the path of `truth`."""
    return [
        ins(clock_sigma_s=0.05, p=0.1, v=0.05),
        theodolite("a", (0.0, -300.0, 0.0)),
        theodolite("b", (900.0, 500.0, 10.0)),
        radar("radar", (-500.0, 700.0, 0.0)),
    ]


# ---- dense oracle


def transition(dt, psd, model=None) -> tuple[np.ndarray, np.ndarray]:
    """(n, n) transition and noise: the motion's by Van Loan's matrix exponential, each error's by its own.

    ``psd`` (4,), or (n − 5,) as `densities`, with the factor of each error's variance.
    """
    A, W = np.zeros((CORE, CORE)), np.diag(np.concatenate([np.zeros(3), psd[[2, 2, 3]], psd[[0, 0, 1]]]))
    A[0:3, 3:6] = A[3:6, 6:9] = np.eye(3)
    big = expm(dt * np.block([[-A, W], [np.zeros((CORE, CORE)), A.T]]))
    n = CORE if model is None else len(model.rate)
    F, Q = np.eye(n), np.zeros((n, n))
    F[:CORE, :CORE] = big[CORE:, CORE:].T
    Q[:CORE, :CORE] = F[:CORE, :CORE] @ big[:CORE, CORE:]
    for i in range(CORE, n):
        F[i, i] = np.exp(-model.rate[i] * dt)
        factor = psd[i - CORE + MOTIONS] if len(psd) > MOTIONS else 1.0
        Q[i, i] = -factor * model.prior[i] * np.expm1(-2.0 * model.rate[i] * dt)
    return F, Q


class Dense:
    """All states and rows of a short linear case as one Gaussian. ``H`` (k, n) are the rows' gradients.

    ``psd`` as in `transition`.
    """

    def __init__(self, model, rows: Rows, x, P, psd, H):
        times = np.unique(rows.t)
        n, e = len(x), len(times)
        self.mean, self.cov = np.zeros(e * n), np.zeros((e * n, e * n))
        self.mean[:n], self.cov[:n, :n] = x, P  # at the first row's time
        for k in range(1, e):
            F, Q = transition((times[k] - times[k - 1]) * 1e-9, psd, model)
            before, now = slice((k - 1) * n, k * n), slice(k * n, (k + 1) * n)
            self.mean[now] = F @ self.mean[before]
            self.cov[now, : k * n] = F @ self.cov[before, : k * n]
            self.cov[: k * n, now] = self.cov[now, : k * n].T
            self.cov[now, now] = F @ self.cov[before, before] @ F.T + Q
        self.H = np.zeros((len(rows.t), e * n))
        for i, k in enumerate(np.searchsorted(times, rows.t)):
            self.H[i, k * n : (k + 1) * n] = H[i]
        self.n, self.y = n, rows.value

    def rows(self, noise):
        """Mean and covariance of the rows with ``noise`` (k,) variances."""
        return self.H @ self.mean, self.H @ self.cov @ self.H.T + np.diag(noise)

    def log_density(self, noise) -> float:
        mean, S = self.rows(noise)
        d = self.y - mean
        return -0.5 * (d @ np.linalg.solve(S, d) + np.linalg.slogdet(S)[1] + len(d) * np.log(2 * np.pi))

    def given(self, use, noise):
        """Mean and covariance of all states given the rows ``use`` (indices)."""
        H, G = self.H[use], self.cov @ self.H[use].T
        gain = np.linalg.solve(H @ G + np.diag(noise[use]), G.T).T
        return self.mean + gain @ (self.y[use] - H @ self.mean), self.cov - gain @ G.T

    def left_out(self, k, use, noise, own_noise):
        """Residual of row ``k`` and its 1-sigma, by all rows ``use`` but itself."""
        mean, cov = self.given([i for i in use if i != k], noise)
        return self.y[k] - self.H[k] @ mean, np.sqrt(self.H[k] @ cov @ self.H[k] + own_noise)


def linear_case(seed=0, epochs=6):
    """(model, rows, x, P, H) of one INS without latency: positions, velocities and some accelerations."""
    rng = np.random.default_rng(seed)
    model = state.build([ins(p=0.5, v=0.2, a=0.4)])
    n = len(model.prior)
    said, H = [], []
    for k in range(epochs):
        t = 0.13 * k + 0.02 * (k % 3)
        for c in [E + k % 3, E + (k + 1) % 3, E + 3 + k % 3, AE + k % 3]:
            said.append((t, 0, c, rng.normal(scale=3.0)))
            h = np.zeros(n)
            h[c - E] = 1.0
            if model.bias_at[0, c] >= 0:
                h[model.bias_at[0, c]] = 1.0
            H.append(h)
    P = state.prior_covariance(model)
    root = rng.normal(size=(CORE, CORE))
    P[:CORE, :CORE] = root @ root.T + np.eye(CORE)
    x = np.zeros(n)
    x[:CORE] = rng.normal(size=CORE)
    return model, as_rows(said, model), x, P, np.array(H)


def ranging_case(seed=0, epochs=7):
    """As `linear_case`, of an INS and two instruments with slow errors, and the rows as coordinates.

    Of ranges alone, one along each horizontal axis, from so far away that a range is the coordinate:
    (model, rows, x, P, H, rows without that distance).
    """
    rng, far = np.random.default_rng(seed), 1e9
    east = theodolite("east", (-far, 0.0, 0.0), slow=1.0, r=0.7)
    north = theodolite("north", (0.0, -far, 0.0), slow=2.0, r=0.4)
    model = state.build([ins(p=0.5, v=0.2), east, north])
    n, said, H = len(model.prior), [], []
    for k in range(epochs):
        for s, c in [(0, E + k % 3), (1, RANGE), (0, E + 3 + k % 3), (2, RANGE)]:
            h = np.zeros(n)
            h[s - 1 if s else c - E] = h[model.bias_at[s, c]] = 1.0
            H.append(h)
            said.append((0.9 * k + 0.2 * (k % 3), s, c, rng.normal(scale=3.0)))
    rows = as_rows(said, model)
    P = state.prior_covariance(model)
    root = rng.normal(size=(CORE, CORE))
    P[:CORE, :CORE] = root @ root.T + np.eye(CORE)
    x = np.where(np.arange(n) == model.clock_at[0], 0.0, rng.normal(size=n))
    return model, rows._replace(value=rows.value + far * (rows.sensor > 0)), x, P, np.array(H), rows
