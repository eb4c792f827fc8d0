"""The hidden status of every measurement: good, an isolated outlier, or within a run of them.

Each channel of each sensor is a Markov chain over GOOD, ISOLATED, RUN; a row's residual r with its variance
s² (d² of the prediction, R of its own noise) is the observation:

    GOOD      N(r; 0, s²)
    ISOLATED  Cauchy(r; WIDTH s): a gross error of no particular size; so is the first row of a run
    RUN       N(r; level, V + R), or erratic: the same Cauchy. A run goes on at its level, a random walk that
              is followed with its variance V row by row, all paths of the chain merged (as in GPB1:
              Bar-Shalom et al. 2001, 11.6.3). It moves by FRESH d² + (SPREAD level)²: rows of a channel that
              is not used share most of the prediction's error. Nearer than LEAST √R it is no run: errors
              that are merely correlated, as an INS's are, make none

`log_evidence` takes innovations, so it is the likelihood of the rows one after the other. `posterior` is the
forward-backward algorithm (Rabiner 1989, *A tutorial on hidden Markov models*) on deletion residuals; the
weight of a row is its probability of being GOOD. `filtered` is the forward half, for a row at first sight.
On deletion residuals as cavity distributions: Minka 2001 (*Expectation propagation*, the clutter problem).
"""

import math

import numpy as np
from numba import njit

from filters.models.kernel import exact
from filters.models.rows import CHANNELS, DEWEIGHTED, ISOLATED, PATCH, USED

P_OUTLIER = 0.005  # of an outlier after a good row, in a channel that behaves
P_WORST = 0.2  # … and in the worst one: beyond that nobody can tell
P_EXPECTED = 0.03  # … of which a good hypothesis makes no fuss
RUN_SHARE = 0.2  # of the outliers begin a run
RUN_ROWS = 10.0  # mean length of a run
GROSS_COST, RUN_COST = 4.0, 2.0  # log likelihood by which an outlier of usual size is below a good row
NEWEST_NS = 250_000_000  # what goes wrong begins in the newest rows
MEMORY_ROWS = 50.0  # over so many rows the share of outliers of a channel is learned
WIDTH = 10.0  # sigmas: half of all gross errors are larger
SPREAD = 0.1  # share of its level by which the errors of a run differ
FRESH = 0.1  # of the variance of the prediction by all others is new from row to row
LEAST = 3.0  # sigmas of its own noise by which the rows of a run are off
ERRATIC = 0.1  # of the rows of a run are anywhere
DOUBT = 0.1  # a row less likely good than this is an outlier
SURE = 0.95  # … and one so likely good is simply used
NEGLIGIBLE = 1e-3  # a smaller probability of being good is none
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
def log_run(r, s, noise, level, variance):
    """Log density of a further row, of own variance ``noise``, of a run at ``level`` ± √``variance``."""
    moved = max(variance + _wander(s, noise, level), 1e-12 * noise)  # before a first run it is nothing
    gross, near = math.exp(log_gross(r, s)), math.exp(log_good(r - level, math.sqrt(noise + moved)))
    offset = 0.5 * math.erfc((LEAST * math.sqrt(noise) - abs(level)) / math.sqrt(2.0 * moved))
    return math.log(ERRATIC * gross + (1.0 - ERRATIC) * offset * near)


@exact
def _wander(s, noise, level):
    """Variance by which a run's level moves from row to row."""
    return FRESH * (s * s - noise) + (SPREAD * level) ** 2


@exact
def _advance(m, r, s, noise, good, gross, run):
    """Move a channel's ``m`` (6,) on by one row of residual ``r`` and 1-sigma ``s``, given its log densities.

    Returns the log likelihood of the row.
    """
    top = max(good, gross, run)
    settled, stay, p = m[0] + m[1], 1.0 - 1.0 / RUN_ROWS, m[4]
    wrong = settled * p * math.exp(gross - top)
    a = (settled * (1.0 - p) + m[2] * (1.0 - stay)) * math.exp(good - top)
    begun, gone_on = wrong * RUN_SHARE, m[2] * stay * math.exp(run - top)
    c = begun + gone_on
    total = a + wrong - begun + c
    if c > 0.0:
        _follow_level(m, r, s, noise, begun / c)
    m[0], m[1], m[2] = a / total, (wrong - begun) / total, c / total
    return top + math.log(total)


@exact
def _follow_level(m, r, s, noise, fresh):
    """The level of a run, and its variance, after residual ``r``; ``fresh`` P(the run begins here)."""
    before = m[5] + _wander(s, noise, m[3])
    gain = before / (before + noise)
    old, new = m[3] + gain * (r - m[3]), r
    m[3] = fresh * new + (1.0 - fresh) * old
    m[5] = fresh * (noise + (new - m[3]) ** 2) + (1.0 - fresh) * ((1.0 - gain) * before + (old - m[3]) ** 2)


@exact
def filtered(memory, r, s, noise):
    """Move a channel's ``memory`` (6,) on by one row at first sight; returns (P(good), log likelihood).

    ``memory`` is the probability of each status of its newest row, the level of its run, the probability of
    an outlier after a good row, learned by `advance`, and the variance of the level.
    """
    good, gross, run = log_good(r, s), log_gross(r, s), log_run(r, s, noise, memory[3], memory[5])
    likelihood = _advance(memory, r, s, noise, good, gross, run)
    return memory[0], likelihood


@exact
def expected(s, p):
    """What `filtered` says of the log likelihood on average: mean and variance, for 1-sigma ``s``.

    ``p`` is the probability of an outlier after a good row. A gross error costs its odds and the width of
    their density, each further row of a run about RUN_COST.
    """
    p = min(p, P_EXPECTED)  # a channel much worse than that is worth another look each time
    gross = GROSS_COST - math.log(p)
    run = RUN_SHARE * RUN_ROWS * RUN_COST
    return -math.log(s) - 0.9189385332046727 - 0.5 - p * (gross + run), 0.5 + p * gross * gross


def fresh_memory(sensors: int) -> np.ndarray:
    """(s, 13, 6) of channels that have said nothing yet."""
    memory = np.zeros((sensors, len(CHANNELS), 6))
    memory[..., 0], memory[..., 4] = 1.0, P_OUTLIER
    return memory


@njit(cache=True)
def advance(rows, own, memory):
    """Move ``memory`` (s, 13, 6) past all rows by their residuals, in place, and learn from their weights."""
    for k in range(len(rows.t)):
        m = memory[rows.sensor[k], rows.channel[k]]
        good = m[0]
        filtered(m, own.residual[k], own.sigma[k], own.noise[k])
        if good > DOUBT:
            m[4] += ((1.0 if own.weight[k] < 0.5 else 0.0) - m[4]) / MEMORY_ROWS
            m[4] = min(max(m[4], P_OUTLIER), P_WORST)


@njit(cache=True)
def posterior(rows, own, memory, closed):
    """P(good) of each of the k rows into ``own.weight`` (k,), all rows of its channel considered.

    ``own`` is a `buffer.Outcome` with deletion residuals and their 1-sigma. ``memory`` (s, 13, 6) as before
    the first row; moved on in place to what it is after the last one. Rows that are ``closed`` (k,) get no
    weight. Returns the largest change of a weight.
    """
    count, stay = len(rows.t), 1.0 - 1.0 / RUN_ROWS
    like, chance = np.empty((count, 3)), np.empty((count, 3))
    for k in range(count):
        m = memory[rows.sensor[k], rows.channel[k]]
        r, s, noise = own.residual[k], own.sigma[k], own.noise[k]
        good, gross, run = log_good(r, s), log_gross(r, s), log_run(r, s, noise, m[3], m[5])
        top = max(good, gross, run)
        like[k, 0], like[k, 1], like[k, 2] = math.exp(good - top), math.exp(gross - top), math.exp(run - top)
        _advance(m, r, s, noise, good, gross, run)
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
        p = memory[rows.sensor[k], rows.channel[k], 4]
        fits, wrong, goes_on = like[k, 0] * b[0], like[k, 1], like[k, 2] * b[2]
        settled = (1.0 - p) * fits + p * wrong * ((1.0 - RUN_SHARE) * b[1] + RUN_SHARE * b[2])
        b[0], b[1], b[2] = settled, settled, (1.0 - stay) * fits + stay * goes_on
        b /= b.sum()
    return change


@njit(cache=True)
def log_evidence(rows, own, v, S, memory, excluded):
    """Log likelihood of k rows under their statuses, and what a model that is right would expect of it.

    Forward algorithm per channel, every row by its innovation ``v`` (k,) of variance ``S`` (k,). ``memory``
    (s, 13, 6) as before the first row; moved on in place. All rows count, whatever a hypothesis leaves out,
    so that hypotheses compare. Returns (log evidence, shortfall):
    what a right model would expect more, in its standard deviations, of all rows or of the newest.
    """
    total = due = spread = 0.0
    newest = 0.0, 0.0, 0.0
    since = rows.t[len(rows.t) - 1] - NEWEST_NS if len(rows.t) else 0
    for k in range(len(rows.t)):
        if rows.t[k] <= since:
            newest = total, due, spread
        m = memory[rows.sensor[k], rows.channel[k]]
        w, noise, sigma = own.weight[k], own.noise[k], math.sqrt(S[k])
        good = -1e3
        if rows.sensor[k] != excluded:
            good = log_good(v[k], math.sqrt(S[k] + (noise / w - noise if w > 0.0 else 0.0)))
        gross, run = log_gross(v[k], sigma), log_run(v[k], sigma, noise, m[3], m[5])
        likelihood = _advance(m, v[k], sigma, noise, good, gross, run)
        total += likelihood
        if rows.sensor[k] == excluded:  # nothing is expected of them
            due += likelihood
        else:
            mean, variance = expected(sigma, m[4])
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
