"""One causal update of one unscented filter, ours and three others': predict, then one shot of an instrument.

Nine states (constant acceleration, white jerk), range, azimuth and elevation of one instrument, every row
used. Each function takes a `Task` and returns the nanoseconds per shot and the state it ends in.
Ours takes the three values one after the other, the others together: the states agree to about a millimetre.
"""

import shutil
import subprocess
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from filters.baselines.baselines import columns
from filters.models import motion
from filters.models import state as models
from filters.models.rows import ROW, Sensor
from filters.models.update import update
from filters.smoother import passes

EIGEN = ("/usr/include/eigen3", "/usr/local/include/eigen3", "/opt/homebrew/include/eigen3")
OPTIONS = ("-std=c++17", "-O3", "-march=native")
JERK_PSD = 10.0  # m²/s⁵, of every filter here
LAPS = 50  # of the fast ones, so that the clock has something to measure


class Task(NamedTuple):
    """A start and the shots of one instrument."""

    sensor: Sensor
    x: np.ndarray  # (9,) station ENU
    P: np.ndarray  # (9, 9)
    t_s: np.ndarray  # (k,) from the first shot on
    shots: np.ndarray  # (k, 3) range m, azimuth rad, elevation rad


class Timed(NamedTuple):
    ns: float  # per shot
    x: np.ndarray  # (9,) at the end


def ours(task: Task) -> Timed:
    """The kernels of the estimator, one value after the other, as its passes ahead use them."""
    model = models.build([task.sensor._replace(slow=0.0)])
    measured = np.zeros(task.shots.size, ROW)
    measured["t_ns"] = np.repeat(np.round(task.t_s * 1e9), 3).astype(np.int64)
    measured["channel"], measured["value"] = np.tile([0, 1, 2], len(task.shots)), task.shots.ravel()
    rows = columns(model, measured)
    rest = np.array([JERK_PSD, JERK_PSD, 0.0, 0.0]), passes.trace(1, 9, 1), models.scratch(9)
    _follow(model, rows, task.x.copy(), task.P.copy(), *rest)  # compiles
    begin_s = time.perf_counter()
    for _ in range(LAPS):
        x, P = task.x.copy(), task.P.copy()
        _follow(model, rows, x, P, *rest)
    return Timed(1e9 * (time.perf_counter() - begin_s) / (LAPS * len(task.shots)), x)


@njit(cache=True, fastmath=True)
def _follow(model, rows, x, P, psd, out, work):
    t_ns = rows.t[0]
    for i in range(len(rows.t)):
        if rows.t[i] != t_ns:
            motion.predict(x, P, (rows.t[i] - t_ns) * 1e-9, psd, model.rate, model.prior)
            t_ns = rows.t[i]
        v, variance = models.predict_row(model, rows, i, x, P, psd, out, 0, work)
        update(x, P, out.m[0], v, variance + rows.stated[i])


def eigen(task: Task) -> Timed | None:
    """``ukf.cpp``; None without a C++ compiler or Eigen's headers."""
    folder = _compiled()
    if folder is None:
        return None
    numbers = np.concatenate(
        [
            [LAPS, JERK_PSD], task.sensor.sigma[:3], task.sensor.offset_m, task.x, task.P.ravel(),
            np.column_stack([task.t_s, task.shots]).ravel(),
        ]
    )  # fmt: skip
    said = subprocess.run(
        [f"{folder.name}/ukf"], input=numbers.tobytes(), capture_output=True, check=True
    ).stdout.split()
    return Timed(float(said[0]), np.array(said[1:], float))


@cache
def _compiled() -> tempfile.TemporaryDirectory | None:
    """The folder that holds the program ``ukf``; it goes when the process ends."""
    compiler, headers = shutil.which("g++"), next((p for p in EIGEN if Path(p).is_dir()), None)
    if not compiler or not headers:
        return None
    folder = tempfile.TemporaryDirectory(prefix="gcs-bench-")
    source = Path(__file__).with_name("ukf.cpp")
    subprocess.run([compiler, *OPTIONS, f"-I{headers}", source, "-o", f"{folder.name}/ukf"], check=True)
    return folder


def filterpy(task: Task) -> Timed:
    """Its own Merwe points with the same spread: α = 1, β = 0, κ = 3 − n."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    offset = task.sensor.offset_m

    def f(x, dt):
        return _transition(dt) @ x

    def h(x):
        e, n, u = x[:3] - offset
        flat = np.hypot(e, n)
        return np.array([np.hypot(flat, u), np.arctan2(e, n), np.arctan2(u, flat)])

    ukf = UnscentedKalmanFilter(9, 3, 0.05, h, f, MerweScaledSigmaPoints(9, 1.0, 0.0, -6.0), residual_z=_off)
    ukf.x, ukf.P, ukf.R = task.x.copy(), task.P.copy(), np.diag(task.sensor.sigma[:3] ** 2)
    begin_s = time.perf_counter()
    for k, shot in enumerate(task.shots):
        dt = task.t_s[k] - task.t_s[max(k - 1, 0)]
        ukf.Q = JERK_PSD * _noise(dt)
        ukf.predict(dt=dt)
        ukf.update(shot)
    return Timed(1e9 * (time.perf_counter() - begin_s) / len(task.shots), ukf.x)


def stonesoup(task: Task) -> Timed | None:
    """None where Stone Soup is not installed."""
    try:
        from stonesoup.models.measurement.nonlinear import CartesianToElevationBearingRange
    except ModuleNotFoundError:
        return None
    from datetime import datetime, timedelta

    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantAcceleration
    from stonesoup.predictor.kalman import UnscentedKalmanPredictor
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import UnscentedKalmanUpdater

    order = np.arange(9).reshape(3, 3).T.ravel()  # ours p v a per kind, theirs per axis
    spread = {"alpha": 1.0, "beta": 0.0, "kappa": -6.0}
    motion_model = CombinedLinearGaussianTransitionModel([ConstantAcceleration(JERK_PSD)] * 3)
    seen = CartesianToElevationBearingRange(
        9, (3, 0, 6), np.diag(task.sensor.sigma[[2, 1, 0]] ** 2),
        translation_offset=StateVector(task.sensor.offset_m[[1, 0, 2]]),
    )  # fmt: skip
    predictor = UnscentedKalmanPredictor(motion_model, **spread)
    updater = UnscentedKalmanUpdater(seen, **spread)
    start = datetime(2026, 1, 1)
    state = GaussianState(StateVector(task.x[order]), task.P[np.ix_(order, order)], start)
    begin_s = time.perf_counter()
    for t_s, shot in zip(task.t_s, task.shots, strict=True):
        now = start + timedelta(seconds=t_s)
        said = Detection(seen._typed_vector() + StateVector(shot[::-1]), now, measurement_model=seen)
        state = updater.update(SingleHypothesis(predictor.predict(state, timestamp=now), said))
    took_s = time.perf_counter() - begin_s
    x = np.empty(9)
    x[order] = np.asarray(state.state_vector, float).ravel()
    return Timed(1e9 * took_s / len(task.shots), x)


PEERS = {"ours, numba": ours, "C++, Eigen": eigen, "filterpy": filterpy, "Stone Soup": stonesoup}


def _transition(dt: float) -> np.ndarray:
    return np.kron([[1.0, dt, dt * dt / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]], np.eye(3))


def _noise(dt: float) -> np.ndarray:
    """White jerk of density 1 (Bar-Shalom et al. 2001, eq. 6.2.3-9)."""
    per_axis = [
        [dt**5 / 20, dt**4 / 8, dt**3 / 6],
        [dt**4 / 8, dt**3 / 3, dt**2 / 2],
        [dt**3 / 6, dt**2 / 2, dt],
    ]
    return np.kron(per_axis, np.eye(3))


def _off(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a − b, the azimuth the short way round."""
    off = a - b
    off[1] = (off[1] + np.pi) % (2 * np.pi) - np.pi
    return off
