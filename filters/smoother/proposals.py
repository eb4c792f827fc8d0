"""Other explanations of the same rows: where to begin, and who may challenge an incumbent.

`candidates` are first states around the places that measurements stand for (`theodolite.places`).

    starts      nothing known before: a candidate of each sensor and its rows, then all rows
    again       the incumbent's anchor, from other weights: all rows open, annealed, or as another bank has it
    closing     rows after the begin of a run stay closed, in its channel or in its sensor
    manoeuvre   the incumbent's anchor, with a much wilder motion from just before the misfits begin

Who of them wins is the `bank`'s.
"""

from typing import NamedTuple

import numpy as np

from filters.models.kernel import kernel
from filters.models.motion import CORE
from filters.models.rows import CHANNELS, RANGE, VE, E, N, U
from filters.models.state import Model, prior_covariance
from filters.models.theodolite import places
from filters.smoother import adaptation, status
from filters.smoother.buffer import Rows, outcome, streams
from filters.smoother.hypothesis import Hypothesis, Moment, Workspace

PLACE_SIGMA_M, PLACE_SHARE = 1e3, 0.3  # of a first state about its place, m, and share of the distance: much
# more than the place is worth, and not so much that the covariance loses its digits
NEAR = 0.05  # of the distance: the same where only crossing lines of sight say it, which bend beyond
SPEED_SIGMA_MPS = 300.0  # … about what its own places show
ACCELERATION_SIGMA_MPS2 = 20.0
LEAD_NS = 100_000_000  # a jerk is under way for so long before a position shows it: (6 · 0.1 m / 600 m/s³)^⅓
MISFIT = 5.0  # rows that one misfit outweighs in the search for where a manoeuvre began
TRIES, FEW_TRIES = 8, 2  # a start is settled so often, where little is wrong so often
GAIN = 1.0  # … or until its log evidence changes by less
FASTEST_MPS = 1000.0  # 1-sigma per axis of the speeds that there are
FASTEST = 3.0  # … of which no target is faster: fixes that say so are those of a run of outliers


class Prior(NamedTuple):
    """What is known of the target before it is seen."""

    height_m: float = np.nan
    height_sigma_m: float = np.nan


def fixes(model: Model, rows: Rows) -> np.ndarray:
    """(f, 5) sensor, time (s from the first row) and position (3,) m station ENU that the rows stand for.

    Of an INS its own, of an instrument the row's place: see `theodolite.places`.
    """
    t_s, found = (rows.t - rows.t[0]) * 1e-9, []
    first = np.flatnonzero(np.diff(rows.t, prepend=-1) | np.diff(rows.sensor, prepend=-1))
    for k, end in zip(first, np.append(first[1:], len(rows.t)), strict=True):
        s = int(rows.sensor[k])
        if model.is_ins[s]:
            said = dict(zip(rows.channel[k:end].tolist(), rows.value[k:end], strict=True))
            if E in said and N in said and U in said:
                found.append((s, t_s[k], said[E], said[N], said[U]))
        elif np.isfinite(rows.place[k, 0]):
            found.append((s, t_s[k], *rows.place[k]))
    return np.array(found).reshape(-1, 5)


def candidates(
    model: Model, rows: Rows, height_m: float, height_sigma_m: float
) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """(sensor, x (n,), P (n, n)) at the time of the first row: one first state for every sensor with a fix.

    Position and velocity are the middle of what its own fixes show; their sigmas know of nothing.
    """
    all_fixes, out = fixes(model, rows), []
    for s in np.unique(all_fixes[:, 0]).astype(int):
        own = all_fixes[all_fixes[:, 0] == s]
        place, velocity = _line(own[:, 1], own[:, 2:])
        told = (rows.sensor == s) & (rows.channel >= VE) & (rows.channel < VE + 3)
        for axis in range(3):
            values = rows.value[told & (rows.channel == VE + axis)]
            velocity[axis] = np.median(values) if len(values) else velocity[axis]
        velocity *= min(1.0, FASTEST * FASTEST_MPS / max(float(np.linalg.norm(velocity)), 1e-9))
        mine = rows.sensor == s
        alone = model.is_ins[s] or (rows.channel[mine] == RANGE).any()
        distance = 0.0 if model.is_ins[s] else np.linalg.norm(place - model.offset[s])
        sigma_m = max(PLACE_SIGMA_M, PLACE_SHARE * distance) if alone else NEAR * distance
        seconds = float(np.ptp(own[:, 1]))
        sigma_mps = min(SPEED_SIGMA_MPS, 2**0.5 * sigma_m / seconds) if seconds else SPEED_SIGMA_MPS
        out.append((s, *state(model, place, sigma_m, velocity, sigma_mps, height_m, height_sigma_m)))
    return out


def _line(t_s: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position at t = 0 and velocity, (3,) each: medians of slopes and offsets (Theil 1950, Sen 1968)."""
    use = np.linspace(0, len(t_s) - 1, min(len(t_s), 30)).astype(int)
    t_s, p = t_s[use], p[use]
    i, j = np.triu_indices(len(t_s), 1)
    apart = t_s[j] - t_s[i]
    far = apart >= 0.3 * max(apart.max(initial=0.0), 1e-9)
    if not far.any() or apart.max() <= 0.0:
        return np.median(p, axis=0), np.zeros(3)
    velocity = np.median((p[j] - p[i])[far] / apart[far, None], axis=0)
    return np.median(p - t_s[:, None] * velocity, axis=0), velocity


def state(
    model: Model,
    place: np.ndarray,
    sigma_m: float,
    velocity: np.ndarray,
    sigma_mps: float,
    height_m: float,
    height_sigma_m: float,
) -> tuple[np.ndarray, np.ndarray]:
    """State (n,) and covariance (n, n) around a place, with an open mind."""
    n = len(model.prior)
    x, P = np.zeros(n), prior_covariance(model)
    x[:3], x[3:6] = place, velocity
    P[range(3), range(3)] = sigma_m**2
    if np.isfinite(height_m):
        x[2], P[2, 2] = height_m, height_sigma_m**2
    P[range(3, 6), range(3, 6)] = sigma_mps**2
    P[range(6, CORE), range(6, CORE)] = ACCELERATION_SIGMA_MPS2**2
    if np.isfinite(height_m):  # and keeps it
        x[5], P[5, 5], P[8, 8] = 0.0, 0.0, 0.0
    return x, P


def again(incumbent: Hypothesis, rows: Rows, weight: np.ndarray, *, annealed: bool) -> Hypothesis:
    """The same anchor, from other weights (k,)."""
    trial = incumbent.copy()
    trial.own.weight[:] = np.where(rows.sensor == trial.excluded, 0.0, weight)
    trial.settle(rows, 0, annealed=annealed)
    return trial


def closing(incumbent: Hypothesis, rows: Rows, closed: np.ndarray) -> list[Hypothesis]:
    """The same anchor; ``closed`` rows (k,) stay closed in one, and are opened again in the other."""
    trial = incumbent.copy()
    trial.settle(rows, 0, closed)
    return [trial, again(incumbent, rows, trial.own.weight, annealed=False)]


def going_wrong(incumbent: Hypothesis, rows: Rows, of: np.ndarray) -> list[np.ndarray]:
    """(k,) bool each: rows ``of`` (k,) one channel or sensor from a patch in it on, if some are used."""
    found, used, out = patches(incumbent, rows), incumbent.own.weight >= status.DOUBT, []
    for one in np.unique(of[found]):
        since = of == one
        since[: np.argmax(found & since)] = False
        if used[since].any():
            out.append(since)
    return out


def patches(incumbent: Hypothesis, rows: Rows) -> np.ndarray:
    """(k,) bool: rows at which the first patch of outliers begins in their channel, one each at most."""
    found = np.zeros(len(rows.t), bool)
    length, begin = np.zeros((2, len(incumbent.anchor.memory), len(CHANNELS)), np.int64)
    _patches(rows, incumbent.own.weight, incumbent.excluded, length, begin, found)
    return found


@kernel
def _patches(rows, weight, excluded, length, begin, found):
    """`patches` into ``found`` (k,); ``length``: outliers in a row of a channel, −1 after its first patch."""
    for k in range(rows.t.size):
        s, c = rows.sensor[k], rows.channel[k]
        if s == excluded or length[s, c] < 0:
            continue
        if weight[k] >= status.DOUBT:
            length[s, c] = 0
            continue
        if length[s, c] == 0:
            begin[s, c] = k
        length[s, c] += 1
        if length[s, c] == status.PATCH_ROWS:
            found[begin[s, c]], length[s, c] = True, -1


def going_on(incumbent: Hypothesis, rows: Rows) -> bool:
    """Whether a run has begun within the rows of a channel, and goes on to its newest ones.

    A manoeuvre looks like that at first, and costs a model that expects outliers no more than they do.
    """
    outlier, name = incumbent.own.weight < status.DOUBT, streams(rows)
    of_channel = (outlier[name == one] for one in name[patches(incumbent, rows)])
    return any(not mine[0] and mine[-status.PATCH_ROWS :].all() for mine in of_channel)


def manoeuvre(incumbent: Hypothesis, rows: Rows) -> Hypothesis:
    """The same anchor; from where the misfits begin, all rows open again and a much wilder motion."""
    trial, begin = incumbent.copy(), onset(incumbent, rows)
    own = trial.own
    own.weight[begin:] = rows.sensor[begin:] != trial.excluded
    own.regime[:begin], own.regime[begin:] = 1, 0
    trial.psd_before = trial.psd
    trial.psd = adaptation.wilder(trial.psd, trial.space.prior_psd)
    trial.settle(rows, 0, annealed=True)
    trial.settle(rows, 0)
    return trial


def onset(incumbent: Hypothesis, rows: Rows) -> int:
    """The first row of a manoeuvre: somewhat before the one from which on there are more misfits.

    That by a cumulative sum, reversed (Page 1954).
    """
    outlier = (incumbent.own.weight < status.DOUBT) & (rows.sensor != incumbent.excluded)
    seen = int(len(outlier) - 1 - np.argmax(np.cumsum((MISFIT * outlier - 1.0)[::-1])))
    return int(np.searchsorted(rows.t, rows.t[seen] - LEAD_NS))


def starts(
    space: Workspace,
    rows: Rows,
    of: np.ndarray,
    prior: Prior,
    incumbent: Hypothesis | None,
    excluded: int,
    slow: np.ndarray,
    tries: int,
) -> list[Hypothesis]:
    """From what each sensor ``of`` some (m,) says; what an ``incumbent`` knows of errors is kept.

    ``excluded``, ``slow``: see `Hypothesis`.
    """
    model, trials = space.model, []
    usable = Rows(*(column[rows.sensor != excluded] for column in rows))
    if not len(usable.t):
        return trials
    if excluded >= 0:  # what it says is no part of a place
        places(usable, model.offset, model.rotation, model.is_ins, prior.height_m, 0)
    for s, x, P in candidates(model, usable, prior.height_m, prior.height_sigma_m):
        if s not in of:
            continue
        if incumbent is not None:
            keep_errors(incumbent, x, P)
        anchor = Moment(int(usable.t[0]), x, P, status.fresh_memory(len(model.is_ins)))
        trial = Hypothesis(space, anchor, excluded)
        trial.follow(slow)
        if incumbent is not None:
            trial.scale, trial.motion, trial.psd = incumbent.scale, incumbent.motion, incumbent.usual_psd
        trial.judged(outcome(len(rows.t)))
        trial.own.weight[:] = rows.sensor == s
        for _ in range(tries):
            before = trial.log_evidence
            trial.settle(rows, 0)
            if abs(trial.log_evidence - before) < GAIN:
                break
        trial.log_evidence -= 0.5 * float(np.sum((trial.head.x[3:6] / FASTEST_MPS) ** 2))
        trials.append(trial)
    return trials


def keep_errors(incumbent: Hypothesis, x: np.ndarray, P: np.ndarray) -> None:
    """The instruments' errors keep what is known of them, twice as unsure; in place."""
    model, known = incumbent.space.model, incumbent.anchor
    kept = np.setdiff1d(model.bias_at[~model.is_ins], [-1])
    both = np.ix_(kept, kept)
    usual = np.maximum(incumbent.factors[kept - CORE], 1.0)
    wide, most = 4.0 * known.P[both], model.prior[kept] * usual
    shrink = np.sqrt(np.minimum(1.0, most / np.maximum(np.diag(wide), 1e-300)))
    x[kept] = known.x[kept]
    P[both] = shrink[:, None] * wide * shrink  # never wider than the prior, and still a covariance
