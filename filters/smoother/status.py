"""The hidden status of every measurement: good, an isolated outlier, or within a run of them.

Each channel of each sensor is a Markov chain over GOOD, ISOLATED, RUN; a row's residual r with its variance
s² (d² of the prediction, R of its own noise) is the observation:

    GOOD      N(r; 0, s²)
    ISOLATED  Cauchy(r; WIDTH s): a gross error of no particular size; so is the first row of a run
    RUN       a run goes on as it was: see `runs`

`log_evidence` takes innovations, so it is the likelihood of the rows one after the other. `posterior` is the
forward-backward algorithm (Rabiner 1989, *A tutorial on hidden Markov models*) on deletion residuals; the
weight of a row is its probability of being GOOD. `filtered` is the forward half, for a row at first sight.
On deletion residuals as cavity distributions: Minka 2001 (*Expectation propagation*, the clutter problem).
"""

import math

import numpy as np
from numba import njit

from filters.models import runs
from filters.models.kernel import exact
from filters.models.rows import CHANNELS, DEWEIGHTED, ISOLATED, PATCH, USED

P_OUTLIER = 0.005  # of an outlier after a good row, in a channel that behaves
P_WORST = 0.2  # … and in the worst one: beyond that nobody can tell
P_EXPECTED = 0.03  # … of which a good hypothesis makes no fuss
RUN_SHARE = 0.2  # of the outliers begin a run
GROSS_COST, RUN_COST = 4.0, 2.0  # log likelihood by which an outlier of usual size is below a good row
NEWEST_NS = 250_000_000  # what goes wrong begins in the newest rows
MEMORY_ROWS = 50.0  # over so many rows the share of outliers of a channel is learned
WIDTH = 10.0  # sigmas: half of all gross errors are larger
DOUBT = 0.1  # a row less likely good than this is an outlier
SURE = 0.95  # … and one so likely good is simply used
NEGLIGIBLE = 1e-3  # a smaller probability of being good is none
LONGEST_S = 1e3  # between two rows of a channel: beyond, nothing is known of a run
PATCH_ROWS = 3  # so many consecutive outliers of a channel are called a patch

REASONS = (
    "",
    "innovation",  # too far from what everything else says
    "run",  # one of PATCH_ROWS or more consecutive ones
    "ambiguous",  # no third witness tells which side is right
    "not a number",
    "sensor has no such channel",
    "same time and channel twice",
    "older than the window",
    "no state yet",
)
NONE, INNOVATION, IN_RUN, AMBIGUOUS, NOT_FINITE, NO_CHANNEL, TWICE, TOO_OLD, NO_STATE = range(len(REASONS))


@exact
def log_good(r, s):
    """Log density of a good row's residual ``r`` with 1-sigma ``s``."""
    u = r / s
    return -0.5 * u * u - math.log(s) - 0.9189385332046727


@exact
def log_gross(r, s):
    """Log density of an isolated outlier's residual."""
    width = WIDTH * s
    return math.log(width / math.pi) - math.log(width * width + r * r)


@exact
def _advance(m, r, noise, fresh, good, gross, t_ns):
    """Move a channel's ``m`` (MEMORY,) on by one row of residual ``r``, given its log densities.

    ``fresh`` is the variance by which its prediction has gone wrong since the row before. Returns (log
    likelihood of the row, log density of a run that goes on).
    """
    seconds, m[runs.TIME] = min((t_ns - m[runs.TIME]) * 1e-9, LONGEST_S), t_ns
    run, bending, steady = runs.log_run(m, r, noise, fresh, gross, seconds)
    top = max(good, gross, run)
    settled, stay, p = m[0] + m[1], runs.stay(m), m[runs.CHANCE]
    wrong = settled * p * math.exp(gross - top)
    a = (settled * (1.0 - p) + m[2] * (1.0 - stay)) * math.exp(good - top)
    begun, gone_on = wrong * RUN_SHARE, m[2] * stay * math.exp(run - top)
    c = begun + gone_on
    total = a + wrong - begun + c
    if c > 0.0:
        runs.follow(m, r, noise, fresh, gross, begun / c, bending, steady, seconds)
    m[0], m[1], m[2] = a / total, (wrong - begun) / total, c / total
    return top + math.log(total), run


@exact
def filtered(memory, r, s, noise, t_ns):
    """Move a channel's ``memory`` (MEMORY,), see `runs`, on by one row; (P(good), its log likelihood)."""
    likelihood, _ = _advance(
        memory, r, noise, runs.FRESH * (s * s - noise), log_good(r, s), log_gross(r, s), t_ns
    )
    return memory[0], likelihood


@exact
def expected(s, p):
    """What `filtered` says of the log likelihood on average: mean and variance, for 1-sigma ``s``.

    ``p`` is the probability of an outlier after a good row. A gross error costs its odds and the width of
    their density, each further row of a run about RUN_COST.
    """
    p = min(p, P_EXPECTED)  # a channel much worse than that is worth another look each time
    gross = GROSS_COST - math.log(p)
    run = RUN_SHARE * runs.ROWS * RUN_COST
    return -math.log(s) - 0.9189385332046727 - 0.5 - p * (gross + run), 0.5 + p * gross * gross


def fresh_memory(sensors: int) -> np.ndarray:
    """(s, 13, MEMORY) of channels that have said nothing yet."""
    memory = np.zeros((sensors, len(CHANNELS), runs.MEMORY))
    memory[..., 0], memory[..., runs.CHANCE] = 1.0, P_OUTLIER
    return memory


@njit(cache=True)
def advance(rows, own, memory):
    """Move ``memory`` (s, 13, MEMORY) past all rows by their residuals, in place, and learn from weights."""
    for k in range(len(rows.t)):
        m = memory[rows.sensor[k], rows.channel[k]]
        good = m[0]
        filtered(m, own.residual[k], own.sigma[k], own.noise[k], rows.t[k])
        if good > DOUBT:
            m[runs.CHANCE] += ((1.0 if own.weight[k] < 0.5 else 0.0) - m[runs.CHANCE]) / MEMORY_ROWS
            m[runs.CHANCE] = min(max(m[runs.CHANCE], P_OUTLIER), P_WORST)


@njit(cache=True)
def posterior(rows, own, memory, closed):
    """P(good) of each of the k rows into ``own.weight`` (k,), all rows of its channel considered.

    ``own`` is a `buffer.Outcome` with deletion residuals and their 1-sigma. ``memory`` (s, 13, MEMORY) as
    before the first row; moved on in place to what it is after the last one. Rows that are ``closed`` (k,)
    get no weight. Returns the largest change of a weight.
    """
    count = len(rows.t)
    like, chance, stay = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    for k in range(count):
        m = memory[rows.sensor[k], rows.channel[k]]
        r, s, noise = own.residual[k], own.sigma[k], own.noise[k]
        good, gross, stay[k] = log_good(r, s), log_gross(r, s), runs.stay(m)
        _, run = _advance(m, r, noise, runs.FRESH * (s * s - noise), good, gross, rows.t[k])
        top = max(good, gross, run)
        like[k, 0], like[k, 1], like[k, 2] = math.exp(good - top), math.exp(gross - top), math.exp(run - top)
        chance[k] = m[:3]
    later = np.ones((memory.shape[0], memory.shape[1], 3))
    change = 0.0
    for k in range(count - 1, -1, -1):
        b = later[rows.sensor[k], rows.channel[k]]
        both = chance[k] * b
        good = both[0] / both.sum()
        if good < NEGLIGIBLE or closed[k]:
            good = 0.0
        change = max(change, abs(good - own.weight[k]))
        own.weight[k] = good
        p = memory[rows.sensor[k], rows.channel[k], runs.CHANCE]
        fits, wrong, goes_on = like[k, 0] * b[0], like[k, 1], like[k, 2] * b[2]
        settled = (1.0 - p) * fits + p * wrong * ((1.0 - RUN_SHARE) * b[1] + RUN_SHARE * b[2])
        b[0], b[1], b[2] = settled, settled, (1.0 - stay[k]) * fits + stay[k] * goes_on
        b /= b.sum()
    return change


@njit(cache=True)
def log_evidence(rows, own, out, memory, excluded):
    """Log likelihood of k rows under their statuses, and what a model that is right would expect of it.

    Forward algorithm per channel, every row by its innovation. ``out`` is the `passes.Trace` of the pass
    forward: what that has learned since a channel's row before moves the level of the channel's run.
    ``memory`` (s, 13, MEMORY) as before the first row; moved on in place. Rows of the sensor ``excluded`` are
    not looked at: were they outliers, a state that contradicts them would be the likelier one. Returns (log
    evidence, shortfall): what a right model would expect more, in its standard deviations, of all rows or of
    the newest.
    """
    total = due = spread = 0.0
    newest = 0.0, 0.0, 0.0
    since = rows.t[len(rows.t) - 1] - NEWEST_NS if len(rows.t) else 0
    for k in range(len(rows.t)):
        if rows.t[k] <= since:
            newest = total, due, spread
        if rows.sensor[k] == excluded:
            continue
        m = memory[rows.sensor[k], rows.channel[k]]
        w, noise, v, S = own.weight[k], own.noise[k], out.v[k], out.S[k]
        sigma = math.sqrt(S)
        good = log_good(v, math.sqrt(S + (noise / w - noise if w > 0.0 else 0.0)))
        runs.move(m, out.moved[k])
        likelihood, _ = _advance(m, v, noise, out.fresh[k], good, log_gross(v, sigma), rows.t[k])
        total += likelihood
        mean, variance = expected(sigma, m[runs.CHANCE])
        due += mean
        spread += variance
    whole = (due - total) / math.sqrt(max(spread, 1.0))
    last = (due - newest[1] - total + newest[0]) / math.sqrt(max(spread - newest[2], 1.0))
    return total, max(whole, last)


@njit(cache=True)
def label(rows, weight, length, alone, verdict, reason):
    """Name what was done with k rows by their ``weight`` (k,); fills ``verdict`` and ``reason`` (k,).

    ``length`` (s, 13) counts each channel's consecutive outliers before the first row; moved on in place.
    ``alone`` (s,) says which sensors had fewer than two others to contradict them.
    """
    for k in range(len(weight)):
        s, c = rows.sensor[k], rows.channel[k]
        if weight[k] >= DOUBT:
            length[s, c] = 0
            verdict[k] = USED if weight[k] >= SURE else DEWEIGHTED
            reason[k] = NONE if weight[k] >= SURE else INNOVATION
            continue
        length[s, c] += 1
        verdict[k], reason[k] = ISOLATED, INNOVATION
        if length[s, c] < PATCH_ROWS:
            continue
        left, j = length[s, c], k
        while left > 0 and j >= 0:
            if rows.sensor[j] == s and rows.channel[j] == c:
                left = 0 if verdict[j] == PATCH else left - 1
                verdict[j], reason[j] = PATCH, AMBIGUOUS if alone[s] else IN_RUN
            j -= 1
