"""Screening of one raw channel: the paper's table on a generated channel with the paper's statistics.

The record: a civil aircraft at 200 m/s seen by a phased-array radar, 33,058 ranges at 20 Hz from 17.8 to
124 km, 1.73 % of the points lost in short dropouts, 4.12 % outliers, 63.2 % of them isolated, the rest in
runs of 3 to 25. The paper does not say how large its outliers are, how its runs look, nor its noise. Assumed:
noise of 3 m near to 12 m far; outliers of ``SIZE`` σ, log-uniform, either sign; in an *irregular* run every
value has an error of its own, in a *regular* one all have the same within 20 %.
"""

from typing import NamedTuple

import numpy as np

from bench.accuracy import FIRST_SEED
from filters.screening import screening
from filters.simulation import simulate

POINTS, RATE_HZ, SPEED_MPS = 33_058, 20.0, 200.0
LOST, OUTLIERS, ISOLATED = 0.0173, 0.0412, 0.632
RUN = (3, 25)
SIZE = (20.0, 200.0)  # σ
SMALLER = (6.0, 100.0)  # σ; the sizes of the other benches
NEAR_M, IN_M, OUT_M = (
    16_300.0,
    122_350.0,
    110_000.0,
)  # over ground: abeam; from there, where it comes in, turns
HEIGHT_M = 7_200.0
NOISE_M = (3.0, 12.0)  # at the nearest and the farthest range
TURN_RADPS = np.radians(1.5)
PAPER = {
    "alpha-beta-fixed": (42, 563, 1.0, 0.417),
    "linear-fixed": (34, 279, 1.0, 0.482),
    "alpha-beta-adaptive": (1, 21, 1.0, 0.693),
    "linear-adaptive": (2, 5, 1.0, 0.856),
}
OURS, OURS_OF = "long-line-adaptive", "linear-adaptive"  # and the paper's method that it comes from
SETTINGS = {OURS: {"threshold": 4.5}}  # σ of a residual; chosen on seeds below 160


class RadarRecord(NamedTuple):
    """One channel and what is wrong with it."""

    t_s: np.ndarray  # (n,)
    values: np.ndarray  # (n,) m, NaN where lost
    label: np.ndarray  # (n,) index into simulate.LABELS
    sigma: np.ndarray  # (n,) m, true noise


class Score(NamedTuple):
    """How a method did on one record."""

    restarts: int
    false_alarms: int
    isolated: float  # share not let through
    in_runs: float


def flight_ranges() -> tuple[np.ndarray, np.ndarray]:
    """(n,) seconds and (n,) metres."""
    x, y = flight_path()
    return np.arange(POINTS) / RATE_HZ, np.sqrt(x**2 + y**2 + HEIGHT_M**2)


def flight_path() -> tuple[np.ndarray, np.ndarray]:
    """(n,) and (n,) metres over ground from the radar: past it, a half turn, and back."""
    t_s = np.arange(POINTS) / RATE_HZ
    begin_s = (IN_M + OUT_M) / SPEED_MPS
    heading = np.clip((t_s - begin_s) * TURN_RADPS, 0.0, np.pi)
    x = -IN_M + np.cumsum(np.cos(heading)) * SPEED_MPS / RATE_HZ
    y = NEAR_M + np.cumsum(np.sin(heading)) * SPEED_MPS / RATE_HZ
    return x, y


def record(seed: int, size: tuple[float, float] = SIZE, *, regular: bool = False) -> RadarRecord:
    """A seeded record with the paper's shares."""
    rng = np.random.default_rng(seed)
    t_s, range_m = flight_ranges()
    near, far = range_m.min(), range_m.max()
    sigma = NOISE_M[0] + (NOISE_M[1] - NOISE_M[0]) * (range_m - near) / (far - near)
    # in units of the noise, so that an outlier of 20 σ is one everywhere
    values = rng.normal(size=(POINTS, 1))
    values[simulate.gaps(t_s, LOST, (0.05, 0.5), rng)] = np.nan
    seen = simulate.Observation(t_s, np.zeros(1, int), values, values, np.zeros(values.shape, np.int8))
    share = OUTLIERS / (1.0 - LOST)
    seen = simulate.contaminate(seen, np.ones(1), rng, share, ISOLATED, RUN, size)
    values, label = seen.values[:, 0].copy(), seen.labels[:, 0]
    if not regular:
        hit = label == simulate.PATCH
        error = np.exp(rng.uniform(*np.log(size), hit.sum())) * rng.choice([-1.0, 1.0], hit.sum())
        values[hit] = rng.normal(size=hit.sum()) + error
    return RadarRecord(t_s, range_m + sigma * values, label, sigma)


def score(made: RadarRecord, method: str, **settings: float) -> Score:
    """How a method does on a record."""
    found = screened(made, method, **settings)
    through = found.flag == screening.GOOD  # what waits for a start is not let through either
    share = [1.0 - through[made.label == kind].mean() for kind in (simulate.ISOLATED, simulate.PATCH)]
    false = np.count_nonzero((found.flag == screening.OUTLIER) & (made.label == simulate.NONE))
    return Score(found.restarts, false, *share)


def screened(made: RadarRecord, method: str, **settings: float) -> screening.Screened:
    """A record screened. The fixed threshold has the mean noise; the adaptive one starts there."""
    chosen = SETTINGS.get(method, {}) | settings
    return screening.screen(
        made.t_s, made.values, screening.Thresholds(sigma=float(made.sigma.mean()), **chosen), method
    )


def table(seeds: int, size: tuple[float, float] = SIZE, *, regular: bool = False, **settings: float) -> dict:
    """{method: Score of means over the seeds}."""
    records = [record(seed, size, regular=regular) for seed in range(FIRST_SEED, FIRST_SEED + seeds)]
    return {
        method: Score(*np.mean([score(made, method, **settings) for made in records], axis=0))
        for method in (*PAPER, OURS)
    }
