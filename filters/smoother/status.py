"""The hidden status of every measurement: good, an isolated outlier, or within a run of them.

Each channel of each sensor is a Markov chain over GOOD, ISOLATED, RUN; a row's residual r, with the deletion
variance s² = d² + R (d² of the prediction by all others, R of its own noise), is the observation:

    GOOD      N(r; 0, s²)
    ISOLATED  Cauchy(r; WIDTH s): a gross error of no particular size
    RUN       half the same, half N(r; r of the row before, 2 s² + (SPREAD r)²): a run goes on as it was.
              Rows of a channel share the error d of the prediction, so a sequence of them proves less than
              so many independent ones: the likelihood ratio to the better of the two others counts with
              the power R / s².

`posterior` is the forward-backward algorithm (Rabiner 1989, *A tutorial on hidden Markov models*); the weight
of a row is its probability of being GOOD. `filtered` is its forward half, for a row at first sight.
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
HANDICAP = 1.0  # log likelihood by which a run is worse at a row that fits
SPREAD = 0.2  # share by which the errors of a run differ
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
def log_run(r, s, noise, before):
    """Log density of a row within a run; ``noise`` is its own variance, ``before`` the residual before it."""
    spread = math.sqrt(2.0 * s * s + (SPREAD * before) ** 2)
    run = math.log(0.5 * math.exp(log_gross(r, s)) + 0.5 * math.exp(log_good(r - before, spread)))
    power = min(1.0, noise / (s * s))
    alone = max(log_good(r, s) - HANDICAP, log_gross(r, s))  # a row that fits speaks against the run
    return power * run + (1.0 - power) * alone


@exact
def emission(r, s, noise, before):
    """Likelihoods of a row's residual if it is good, isolated or within a run, up to a common factor."""
    good, gross, run = log_good(r, s), log_gross(r, s), log_run(r, s, noise, before)
    top = max(good, gross, run)
    return math.exp(good - top), math.exp(gross - top), math.exp(run - top)


@exact
def _predicted(chance, p):
    """Status probabilities one row on, before that row is seen; ``p`` of an outlier after a good row."""
    settled = chance[0] + chance[1]
    stay = 1.0 - 1.0 / RUN_ROWS
    return (
        settled * (1.0 - p) + chance[2] * (1.0 - stay),
        settled * p * (1.0 - RUN_SHARE),
        settled * p * RUN_SHARE + chance[2] * stay,
    )


@exact
def _forward(chance, p, like):
    """Status probabilities one row on: transition, likelihood, normalised. Tuples of three."""
    a, b, c = _predicted(chance, p)
    total = a * like[0] + b * like[1] + c * like[2]
    return a * like[0] / total, b * like[1] / total, c * like[2] / total


@exact
def filtered(memory, r, s, noise):
    """Move a channel's ``memory`` (5,) on by one row at first sight; returns (P(good), log likelihood).

    ``memory`` is the probability of each status, and the residual, of its newest row, and the probability of
    an outlier after a good row, learned by `advance`.
    """
    good, gross, run = log_good(r, s), log_gross(r, s), log_run(r, s, noise, memory[3])
    top = max(good, gross, run)
    a, b, c = _predicted((memory[0], memory[1], memory[2]), memory[4])
    a, b, c = a * math.exp(good - top), b * math.exp(gross - top), c * math.exp(run - top)
    total = a + b + c
    memory[0], memory[1], memory[2], memory[3] = a / total, b / total, c / total, r
    return a / total, top + math.log(total)


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
    """(s, 13, 5) of channels that have said nothing yet."""
    memory = np.zeros((sensors, len(CHANNELS), 5))
    memory[..., 0], memory[..., 4] = 1.0, P_OUTLIER
    return memory


@njit(cache=True)
def advance(rows, own, memory):
    """Move ``memory`` (s, 13, 5) past all rows by their residuals, in place, and learn from their weights."""
    for k in range(len(rows.t)):
        m = memory[rows.sensor[k], rows.channel[k]]
        good = m[0]
        filtered(m, own.residual[k], own.sigma[k], own.noise[k])
        if good > DOUBT:
            m[4] += ((1.0 if own.weight[k] < 0.5 else 0.0) - m[4]) / MEMORY_ROWS
            m[4] = min(max(m[4], P_OUTLIER), P_WORST)


@njit(cache=True)
def posterior(rows, own, memory, excluded):
    """P(good) of each of the k rows into ``own.weight`` (k,), all rows of its channel considered.

    ``own`` is a `buffer.Outcome` with deletion residuals and their 1-sigma. ``memory`` (s, 13, 5) as before
    the first row; moved on in place to what it is after the last one. Rows of sensor ``excluded`` get no
    weight. Returns the largest change of a weight.
    """
    count, stay = len(rows.t), 1.0 - 1.0 / RUN_ROWS
    like, chance = np.empty((count, 3)), np.empty((count, 3))
    for k in range(count):
        m = memory[rows.sensor[k], rows.channel[k]]
        like[k] = emission(own.residual[k], own.sigma[k], own.noise[k], m[3])
        chance[k] = _forward((m[0], m[1], m[2]), m[4], (like[k, 0], like[k, 1], like[k, 2]))
        m[0], m[1], m[2], m[3] = chance[k, 0], chance[k, 1], chance[k, 2], own.residual[k]
    later = np.ones((memory.shape[0], memory.shape[1], 3))
    change = 0.0
    for k in range(count - 1, -1, -1):
        b = later[rows.sensor[k], rows.channel[k]]
        both = chance[k] * b
        good = both[0] / both.sum()
        if good < NEGLIGIBLE or rows.sensor[k] == excluded:
            good = 0.0
        change = max(change, abs(good - own.weight[k]))
        own.weight[k] = good
        ahead, p = like[k] * b, memory[rows.sensor[k], rows.channel[k], 4]
        settled = (1.0 - p) * ahead[0] + p * ((1.0 - RUN_SHARE) * ahead[1] + RUN_SHARE * ahead[2])
        b[0], b[1], b[2] = settled, settled, (1.0 - stay) * ahead[0] + stay * ahead[2]
        b /= b.sum()
    return change


@njit(cache=True)
def log_evidence(rows, own, v, S, memory, excluded):
    """Log likelihood of k rows under their statuses, and what a model that is right would expect of it.

    Forward algorithm per channel: a good row by its innovation ``v`` (k,) of variance ``S`` (k,), an outlier
    by its deletion residual. ``memory`` (s, 13, 5) as before the first row; moved on in place. All rows
    count, whatever a hypothesis leaves out, so that hypotheses compare. Returns (log evidence, shortfall):
    what a right model would expect more, in its standard deviations, of all rows or of the newest.
    """
    total = due = spread = 0.0
    newest = 0.0, 0.0, 0.0
    since = rows.t[len(rows.t) - 1] - NEWEST_NS if len(rows.t) else 0
    for k in range(len(rows.t)):
        if rows.t[k] <= since:
            newest = total, due, spread
        m = memory[rows.sensor[k], rows.channel[k]]
        w, r, noise = own.weight[k], own.residual[k], own.noise[k]
        s = math.sqrt(S[k] + (noise / w - noise if w > 0.0 else 0.0))
        good = -1e3 if rows.sensor[k] == excluded else log_good(v[k], s)
        gross, run = log_gross(r, own.sigma[k]), log_run(r, own.sigma[k], noise, m[3])
        top = max(good, gross, run)
        a, b, c = _predicted((m[0], m[1], m[2]), m[4])
        a, b, c = a * math.exp(good - top), b * math.exp(gross - top), c * math.exp(run - top)
        p = a + b + c
        m[0], m[1], m[2], m[3] = a / p, b / p, c / p, r
        total += top + math.log(p)
        if rows.sensor[k] == excluded:  # nothing is expected of them
            due += top + math.log(p)
        else:
            mean, variance = expected(math.sqrt(S[k]), m[4])
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
