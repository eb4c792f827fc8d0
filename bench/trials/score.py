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


def figures(scene: Scene, run: Run, told: Run | None = None, settle_s: float = SETTLE_S) -> dict[str, float]:
    """All figures of a run: see ``columns.py`` for their names."""
    if not len(run.track):
        return NONE_YET | {"rms_smooth": np.inf, "resets": 0, "cpu_s": run.cpu_s, "silent_s": np.inf}
    t_ns = grid(scene.flight, run.track, settle_s)
    newest = errors(scene.flight, run.track, t_ns, True)
    best = errors(scene.flight, run.smoothed, t_ns, False)
    out = spread(newest[0], "") | {f"{name}_smooth": x for name, x in spread(best[0], "").items()}
    out |= honesty(newest, "") | {f"{name}_smooth": x for name, x in honesty(best, "").items()}
    out |= protection(run.track, *newest) | caught(scene, run)
    out["resets"] = int(run.track["reset_counter"].max())
    out["silent_s"] = float(np.diff(run.track["t_ns"]).max(initial=0) * 1e-9)
    out["start_s"] = (int(run.track["t_ns"][0]) - int(scene.rows["t_ns"][0])) * 1e-9
    out["cpu_s"] = run.cpu_s
    if told is not None and len(told.track):
        theirs = errors(scene.flight, told.track, t_ns, True)[0]
        theirs_best = errors(scene.flight, told.smoothed, t_ns, False)[0]
        out["over_told"] = out["rms"] / rms(theirs)
        out["over_told_smooth"] = out["rms_smooth"] / rms(theirs_best)
    return out


def grid(flight: Flight, track: np.ndarray, settle_s: float = SETTLE_S) -> np.ndarray:
    """(k,) UTC ns at which a track is judged, every GRID_S."""
    begin = int(track["t_ns"][0]) + round(settle_s * 1e9)
    end = min(flight.t0_ns + round(flight.truth.t_s[-1] * 1e9), int(track["t_ns"][-1]) + 1_000_000_000)
    return np.arange(begin, max(end, begin + 1), round(GRID_S * 1e9))


def errors(flight: Flight, track: np.ndarray, t_ns: np.ndarray, causal: bool):
    """((k,) m, (k, 3) m, (k, 3, 3) m², (k,) index) of the state at ``t_ns``: moved on, never from the future.

    Not ``causal``: the nearest state, before or after.
    """
    k = np.clip(np.searchsorted(track["t_ns"], t_ns, side="right") - 1, 0, len(track) - 1)
    if not causal:
        after = np.minimum(k + 1, len(track) - 1)
        nearer = np.abs(track["t_ns"][after] - t_ns) < np.abs(track["t_ns"][k] - t_ns)
        k = np.where(nearer, after, k)
    age_s, x = ((t_ns - track["t_ns"][k]) * 1e-9)[:, None], track["x"][k]
    off = x[:, :3] + age_s * (x[:, 3:6] + age_s / 2 * x[:, 6:9]) - at(flight, t_ns)[0]
    P = track["P"][k, :3, :3].copy()
    P[np.abs(age_s[:, 0]) > FRESH_S] = np.nan
    return np.linalg.norm(off, axis=1), off, P, k


def spread(error_m: np.ndarray, prefix: str) -> dict[str, float]:
    """RMS, median, 95th percentile and worst in m, and the longest time beyond FAR_M in s."""
    far = np.concatenate([[0], (~(error_m <= FAR_M)).astype(int), [0]])
    edge = np.flatnonzero(np.diff(far))
    return {
        f"{prefix}rms": rms(error_m),
        f"{prefix}median": float(np.median(error_m)),
        f"{prefix}p95": float(np.percentile(error_m, 95)),
        f"{prefix}worst": float(error_m.max()),
        f"{prefix}far_s": float((edge[1::2] - edge[::2]).max(initial=0) * GRID_S),
    }


def honesty(judged, prefix: str) -> dict[str, float]:
    """Shares beyond 3 and 5 sigma on any axis; mean NEES of position, and its distance from its 95 % band.

    The band is that of the mean of n independent χ²(3), 3 ± 1.96 √(6/n), n one per second: errors of a
    filter are correlated, so more would be claiming too much. ``nees_off`` 0: inside.
    """
    _, off, P, _ = judged
    known = np.isfinite(P[:, 0, 0])
    if not known.any():
        return {}
    off, P = off[known], P[known]
    beyond = np.max(np.abs(off) / np.sqrt(np.einsum("kii->ki", P)), axis=1)
    nees = np.einsum("ki,ki->k", off, np.linalg.solve(P, off[..., None])[..., 0])
    mean, half = float(np.mean(nees)), 1.96 * np.sqrt(6.0 / max(1.0, known.sum() * GRID_S))
    return {
        f"{prefix}beyond3": float(np.mean(beyond > 3.0)),
        f"{prefix}beyond5": float(np.mean(beyond > 5.0)),
        f"{prefix}nees": mean,
        f"{prefix}nees_off": max(0.0, 3.0 - half - mean, mean - 3.0 - half),
    }


def protection(track: np.ndarray, error_m, off, P, k) -> dict[str, float]:
    """Where the track has protection levels: how often the error is beyond them though it says it knows."""
    if "protection_h_m" not in track.dtype.names:
        return {}
    fresh = np.isfinite(P[:, 0, 0])
    off, k = off[fresh], k[fresh]
    flat_m, up_m = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
    level_h, level_v = track["protection_h_m"][k], track["protection_v_m"][k]
    beyond = (flat_m > level_h) | (up_m > level_v)
    out = {"misleading": float(beyond.mean())}
    out["level_h"] = float(np.median(level_h) / np.percentile(flat_m, 95))
    out["level_v"] = float(np.median(level_v) / np.percentile(up_m, 95))
    if "ambiguous" in track.dtype.names:
        doubt = track["ambiguous"][k] > 0
        out["misleading"] = float((beyond & ~doubt).mean())
        out["ambiguous"] = float(doubt.mean())
    return out


def caught(scene: Scene, run: Run) -> dict[str, float]:
    """Share of clear outliers refused; false alarms per 10,000 good instrument values; INS values refused."""
    refused = np.zeros(len(scene.rows), bool)
    refused[run.verdicts["id"]] = np.isin(run.verdicts["verdict"], (ISOLATED, PATCH))
    ours = np.array([s.kind == "ins" for s in scene.sensors])[scene.rows["sensor"]]
    good = (scene.labels == simulate.NONE) & ~ours
    clear = (scene.labels != simulate.NONE) & (scene.off_sigma >= CLEAR_SIGMA)
    out = {"false": 1e4 * float(refused[good].mean())} if good.any() else {}
    if clear.any():
        out["found"] = float(refused[clear].mean())
    if ours.any():
        out["ins_refused"] = float(refused[ours].mean())
    return out


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
