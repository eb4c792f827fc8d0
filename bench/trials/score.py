"""A run against the truth: errors, honesty about them, and what was refused."""

import numpy as np

from bench.trials.flights import Flight, at
from bench.trials.run import Run
from bench.trials.scene import Scene
from bench.trials.world import ISOLATED, PATCH, simulate

SETTLE_S = 5.0  # after the first state, not counted
GRID_S = 0.05
FRESH_S = 0.3  # an older state's covariance says nothing of now
FAR_M = 5.0
CLEAR_SIGMA = 6.0  # an outlier that everybody should find
NONE_YET = {"rms": np.inf, "median": np.inf, "p95": np.inf, "worst": np.inf, "far_s": np.inf}


def figures(
    scene: Scene,
    run: Run,
    told: Run | None = None,
    settle_s: float = SETTLE_S,
    t_ns: np.ndarray | None = None,
    axes: int = 3,
) -> dict[str, float]:
    """All figures of a run: see ``columns.py`` for their names.

    ``t_ns``: where it is judged, else on `grid`. ``axes`` 2: the height is not looked at.
    """
    if not len(run.track):
        return NONE_YET | {"rms_smooth": np.inf, "resets": 0, "cpu_s": run.cpu_s, "silent_s": np.inf}
    t_ns = grid(scene.flight, run.track, settle_s) if t_ns is None else t_ns
    newest = errors(scene.flight, run.track, t_ns, True, axes)
    best = errors(scene.flight, run.smoothed, t_ns, False, axes)
    out = spread(newest[0], t_ns) | {f"{name}_smooth": x for name, x in spread(best[0], t_ns).items()}
    out |= honesty(newest, t_ns) | {f"{name}_smooth": x for name, x in honesty(best, t_ns).items()}
    out |= protection(run.track, *newest) | caught(scene, run)
    out["resets"] = int(run.track["reset_counter"].max())
    out["silent_s"] = float(np.diff(run.track["t_ns"]).max(initial=0) * 1e-9)
    out["start_s"] = (int(run.track["t_ns"][0]) - int(scene.rows["t_ns"][0])) * 1e-9
    out["cpu_s"] = run.cpu_s
    if told is not None and len(told.track):
        theirs = errors(scene.flight, told.track, t_ns, True, axes)[0]
        theirs_best = errors(scene.flight, told.smoothed, t_ns, False, axes)[0]
        out["over_told"] = out["rms"] / rms(theirs)
        out["over_told_smooth"] = out["rms_smooth"] / rms(theirs_best)
    return out


def grid(flight: Flight, track: np.ndarray, settle_s: float = SETTLE_S) -> np.ndarray:
    """(k,) UTC ns at which a track is judged, every GRID_S."""
    begin = int(track["t_ns"][0]) + round(settle_s * 1e9)
    end = min(flight.t0_ns + round(flight.truth.t_s[-1] * 1e9), int(track["t_ns"][-1]) + 1_000_000_000)
    return np.arange(begin, max(end, begin + 1), round(GRID_S * 1e9))


def errors(flight: Flight, track: np.ndarray, t_ns: np.ndarray, causal: bool, axes: int = 3):
    """((k,) m, (k, a) m, (k, a, a) m², (k,) index) of the state at ``t_ns``: moved on, never from the future.

    Not ``causal``: the nearest state, before or after. ``axes``: a, how many count. Its covariance is moved
    on like it; what the target may do meanwhile, nobody who has the state knows.
    """
    k = np.clip(np.searchsorted(track["t_ns"], t_ns, side="right") - 1, 0, len(track) - 1)
    if not causal:
        after = np.minimum(k + 1, len(track) - 1)
        nearer = np.abs(track["t_ns"][after] - t_ns) < np.abs(track["t_ns"][k] - t_ns)
        k = np.where(nearer, after, k)
    age_s, x = ((t_ns - track["t_ns"][k]) * 1e-9)[:, None], track["x"][k]
    off = x[:, :3] + age_s * (x[:, 3:6] + age_s / 2 * x[:, 6:9]) - at(flight, t_ns)[0]
    moves = np.concatenate([np.eye(3)[None] * w[:, None] for w in (age_s**0, age_s, age_s**2 / 2)], axis=2)
    off, P = off[:, :axes], (moves @ track["P"][k] @ moves.transpose(0, 2, 1))[:, :axes, :axes]
    P[np.abs(age_s[:, 0]) > FRESH_S] = np.nan
    return np.linalg.norm(off, axis=1), off, P, k


def spread(error_m: np.ndarray, t_ns: np.ndarray) -> dict[str, float]:
    """RMS, median, 95th percentile and worst in m, and the longest time beyond FAR_M in s."""
    near_ns = np.concatenate([t_ns[:1], t_ns[error_m <= FAR_M], t_ns[-1:]])
    far = (~(error_m <= FAR_M)).any()
    return {
        "rms": rms(error_m),
        "median": float(np.median(error_m)),
        "p95": float(np.percentile(error_m, 95)),
        "worst": float(error_m.max()),
        "far_s": float(np.diff(near_ns).max(initial=0) * 1e-9) if far else 0.0,
    }


def honesty(judged, t_ns: np.ndarray) -> dict[str, float]:
    """Shares beyond 3 and 5 sigma on any axis; mean NEES of position, and its distance from its 95 % band.

    The band is that of the mean of n independent χ²(a), a ± 1.96 √(2a/n), n one per second at most: errors of
    a filter are correlated, so more would be claiming too much. ``nees_off`` 0: inside.
    """
    _, off, P, _ = judged
    known = np.isfinite(P[:, 0, 0])
    if not known.any():
        return {}
    off, P, axes = off[known], P[known], off.shape[1]
    beyond = _in_sigmas(off, P)
    nees = np.einsum("ki,ki->k", off, np.linalg.solve(P, off[..., None])[..., 0])
    n = len(np.unique(t_ns[known] // 1_000_000_000))
    mean, half = float(np.mean(nees)), 1.96 * np.sqrt(2.0 * axes / n)
    return {
        "beyond3": float(np.mean(beyond > 3.0)),
        "beyond5": float(np.mean(beyond > 5.0)),
        "nees": mean,
        "nees_off": max(0.0, axes - half - mean, mean - axes - half),
    }


def _in_sigmas(off: np.ndarray, P: np.ndarray) -> np.ndarray:
    """(k,) largest error (k, a) of any axis in its own sigmas, by covariances (k, a, a)."""
    return np.max(np.abs(off) / np.sqrt(np.einsum("kii->ki", P)), axis=1)


def protection(track: np.ndarray, error_m, off, P, k) -> dict[str, float]:
    """Where the track tells them: doubt, and protection levels and how often the error is beyond them.

    ``sure5``: beyond 5 sigma and not called ambiguous.

    ``misleading``: beyond a level and not called ambiguous. A level that is infinite protects from all.
    """
    fresh = np.isfinite(P[:, 0, 0])
    off, k, out = off[fresh], k[fresh], {}
    doubt = np.zeros(len(k), bool)
    if "ambiguous" in track.dtype.names:
        doubt = track["ambiguous"][k] > 0
        out["ambiguous"] = float(doubt.mean())
    if len(k):
        out["sure5"] = float(np.mean((_in_sigmas(off, P[fresh]) > 5.0) & ~doubt))
    if "protection_h_m" not in track.dtype.names or np.isnan(track["protection_h_m"][k]).all():
        return out
    flat_m, up_m = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2:]).sum(axis=1)
    level_h, level_v = track["protection_h_m"][k], track["protection_v_m"][k]
    out["misleading"] = float((((flat_m > level_h) | (up_m > level_v)) & ~doubt).mean())
    out["level_h"] = float(np.median(level_h) / np.percentile(flat_m, 95))
    if off.shape[1] == 3:
        out["level_v"] = float(np.median(level_v) / np.percentile(up_m, 95))
    return out


def caught(scene: Scene, run: Run) -> dict[str, float]:
    """Share refused of all values, of clear outliers, of the INS's; false alarms in 10,000 of the others'."""
    refused = np.zeros(len(scene.rows), bool)
    refused[run.verdicts["id"]] = np.isin(run.verdicts["verdict"], (ISOLATED, PATCH))
    ours = np.array([s.kind == "ins" for s in scene.sensors])[scene.rows["sensor"]]
    good = (scene.labels == simulate.NONE) & ~ours
    clear = (scene.labels != simulate.NONE) & ~ours & (scene.off_sigma >= CLEAR_SIGMA)
    out = {"refused": float(refused.mean())}
    if good.any():
        out["false"] = 1e4 * float(refused[good].mean())
    if clear.any():
        out["found"] = float(refused[clear].mean())
    if ours.any():
        out["ins_refused"] = float(refused[ours].mean())
    return out


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
