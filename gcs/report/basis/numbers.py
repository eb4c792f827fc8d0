"""The statistics of the report, on plain arrays."""

from typing import NamedTuple

import numpy as np

LEVELS = (50.0, 95.0, 99.0)  # percentiles that are listed
LONGEST_STEP_S = 1.0  # a state stands for the time up to the next one, and for no longer than this
USUAL = 5.0  # usual intervals: a longer one is a pause
SLOW_MPS = 1.0  # below it there is no direction of flight
DRMS_95 = 2.0  # times the root of the horizontal variances: covers 95.4 to 98.2 % (Bowditch, app. Q)
NORMAL_95 = 1.96


class Whiteness(NamedTuple):
    """How much each residual resembles the one before."""

    lag1: float  # autocorrelation at lag 1
    band: float  # |lag1| of white noise is below it in 95 % of all cases: 1.96 / √n
    length: int


class Streak(NamedTuple):
    """Consecutive values of a channel."""

    length: int
    first_ns: int
    last_ns: int


class Gap(NamedTuple):
    """A time without data, from the last one before to the first one after."""

    begin_ns: int
    end_ns: int

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.begin_ns) * 1e-9


def horizontal(x: np.ndarray, names: tuple[str, str]) -> np.ndarray:
    """(n,) root of the sum of two squared columns of a structured array."""
    return np.hypot(x[names[0]], x[names[1]])


def duration_s(t_ns: np.ndarray) -> np.ndarray:
    """(n,) s that each state of (n,) times in order stands for."""
    step = np.diff(t_ns, append=t_ns[-1:]) * 1e-9
    return np.minimum(step, LONGEST_STEP_S)


def time_share(t_ns: np.ndarray, holds: np.ndarray) -> float:
    """Which part of the time, 0 … 1, something (n,) bool holds for states at (n,) times in order."""
    weight = duration_s(t_ns)
    return float(weight[holds].sum() / weight.sum()) if weight.sum() > 0.0 else float(holds.mean())


def longest_s(t_ns: np.ndarray, least_s: float = LONGEST_STEP_S) -> float:
    """What is no pause yet in (n,) times in order, s: ``USUAL`` usual intervals, and ``least_s`` at least."""
    return max(USUAL * float(np.median(np.diff(t_ns))) * 1e-9, least_s) if len(t_ns) > 1 else least_s


def gaps(t_ns: np.ndarray, least_s: float = 0.5) -> list[Gap]:
    """Pauses of more than ``USUAL`` usual intervals, and more than ``least_s``, in times in any order."""
    t = np.unique(t_ns)
    if len(t) < 2:
        return []
    at = np.flatnonzero(np.diff(t) * 1e-9 > longest_s(t, least_s))
    return [Gap(int(t[k]), int(t[k + 1])) for k in at]


def longest_run(t_ns: np.ndarray, holds: np.ndarray) -> Streak | None:
    """The longest row of values at (n,) times in order for which (n,) bool holds; None: it never does."""
    edges = np.flatnonzero(np.diff(np.r_[False, holds, False]))
    begins, ends = edges[::2], edges[1::2]
    if not len(begins):
        return None
    k = int(np.argmax(ends - begins))
    return Streak(int(ends[k] - begins[k]), int(t_ns[begins[k]]), int(t_ns[ends[k] - 1]))


def whiteness(residuals: np.ndarray) -> Whiteness | None:
    """Of (n,) residuals in order of time (Bar-Shalom, Li & Kirubarajan 2001, 5.4.2); None for too few."""
    u = residuals[np.isfinite(residuals)]
    if len(u) < 10 or not (power := float(u @ u)):
        return None
    return Whiteness(float(u[1:] @ u[:-1]) / power, NORMAL_95 / np.sqrt(len(u)), len(u))


def along_across_up(difference: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(n, 3) differences in ENU turned into along the level course, to the right of it, and up.

    ``velocity`` (n, ≥2) in m/s; where the target stands still there is no course, and the first two are NaN.
    """
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        east, north = np.where(speed >= SLOW_MPS, velocity[:, :2].T / speed, np.nan)
    along = difference[:, 0] * east + difference[:, 1] * north
    across = difference[:, 0] * north - difference[:, 1] * east
    return np.column_stack([along, across, difference[:, 2]])


def at_times(t_ns: np.ndarray, known_ns: np.ndarray, columns: np.ndarray, reach_s: float) -> np.ndarray:
    """(n, k) ``columns`` (m, k) of times ``known_ns`` (m,) in order, straight between them, at ``t_ns`` (n,).

    NaN outside, and within a pause longer than ``reach_s``.
    """
    known_ns, first = np.unique(known_ns, return_index=True)
    columns = columns[first]
    after = np.clip(np.searchsorted(known_ns, t_ns), 1, max(len(known_ns) - 1, 1))
    if len(known_ns) < 2:
        return np.full((len(t_ns), columns.shape[1]), np.nan)
    before_ns, step_s = known_ns[after - 1], (known_ns[after] - known_ns[after - 1]) * 1e-9
    share = ((t_ns - before_ns) * 1e-9 / step_s)[:, None]
    inside = (t_ns >= known_ns[0]) & (t_ns <= known_ns[-1]) & (step_s <= reach_s)
    between = columns[after - 1] + share * (columns[after] - columns[after - 1])
    return np.where(inside[:, None], between, np.nan)


def thin(most: int, *columns: np.ndarray) -> np.ndarray:
    """(k,) indices, in order, of at most about ``most`` of n points: the extremes of each stretch stay.

    Each stretch of the n keeps the place of its least and greatest value in every one of the ``columns``
    (n,); its NaNs stay where a line breaks there. So no peak is lost, whatever is left out.
    """
    n = len(columns[0])
    if n <= most:
        return np.arange(n)
    stretches = max(1, most // (2 * len(columns) + 1))
    edges = np.linspace(0, n, stretches + 1).astype(int)
    begins = edges[:-1]
    label = np.repeat(np.arange(stretches), np.diff(edges))
    kept = [begins, np.array([n - 1])]
    for column in columns:
        known = np.isfinite(column)
        for sign in (1.0, -1.0):
            y = np.where(known, sign * column, np.inf)
            lowest = np.minimum.reduceat(y, begins)
            hits = np.flatnonzero(known & (y == lowest[label]))
            kept.append(hits[np.unique(label[hits], return_index=True)[1]])
        broken = np.flatnonzero(~known)
        kept.append(broken[np.unique(label[broken], return_index=True)[1]])
    return np.unique(np.concatenate(kept))


def sample(most: int, column: np.ndarray) -> np.ndarray:
    """(k,) indices of about ``most`` of n points: every so many, and among them the extremes of each stretch.

    For dots: the extremes alone would leave the middle of a cloud empty.
    """
    if len(column) <= most:
        return np.arange(len(column))
    return np.union1d(thin(most // 3, column), np.linspace(0, len(column) - 1, 2 * most // 3).astype(int))
