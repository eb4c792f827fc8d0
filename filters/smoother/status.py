"""The hidden status of every measurement: good, an isolated outlier, or within a run of them.

Each channel of each sensor is a Markov chain over GOOD, ISOLATED, RUN; a row's residual r with its variance
s² (d² of the prediction, R of its own noise) is the observation:

    GOOD      N(r; 0, s²)
    ISOLATED  Cauchy(r; WIDTH s): a gross error of no particular size; so is the first row of a run
    RUN       a run goes on as it was: see `runs`

Channels of a sensor err by themselves, or it is astray: a tracker on something else, or a wrong fix, errs in
all of them. So where a run begins in one it is likely to begin in the others (TOGETHER); and where two
coordinates are in runs the third is not believed and soon in one, however near it may be: it may lead the
state that it agrees with.

`log_evidence` takes innovations, so it is the likelihood of the rows one after the other. `posterior` is the
forward-backward algorithm (Rabiner 1989, *A tutorial on hidden Markov models*) on deletion residuals; the
weight of a row is its probability of being GOOD, of a sensor that is not astray. `filtered` is the forward
half, for a row at first sight. On deletion residuals as cavity distributions: Minka 2001 (*Expectation
propagation*, the clutter problem).
"""

import math

import numpy as np
from numba import njit

from filters.models import runs
from filters.models.kernel import exact
from filters.models.rows import CHANNELS, DEWEIGHTED, ISOLATED, PATCH, RANGE, USED, E

P_OUTLIER = 0.005  # of an outlier after a good row, in a channel that behaves
P_WORST = 0.2  # … and in the worst one: beyond that nobody can tell
P_EXPECTED = 0.03  # … of which a good hypothesis makes no fuss
RUN_SHARE = 0.2  # of the outliers begin a run
TOGETHER = 0.5  # of the causes that put a channel into a run do so with the next row
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
def astray(in_run, s, c):
    """P(sensor ``s`` is on something else), whatever ``c`` says: two other coordinates are in runs.

    ``in_run`` (s, 13) has P(run) of each channel. Two that go wrong by themselves within a run's length are a
    hundred times rarer (P_OUTLIER RUN_SHARE ROWS).
    """
    first, both, most = RANGE if c < E else E, 0.0, 0.0
    for j in range(first, first + 3):
        if j != c:
            both, most = max(both, most * in_run[s, j]), max(most, in_run[s, j])
    return both


@exact
def common_cause(memory, s, c, t_ns):
    """P(there is a cause that puts ``c`` of sensor ``s`` into a run, too), by its ``memory`` (s, 13, MEMORY).

    A run begins in another channel at ``t_ns``; or the sensor is astray: then its run may be near.
    """
    most = memory[s, c, runs.NEAR] = astray(memory[:, :, 2], s, c)
    for j in range(memory.shape[1]):
        if j != c and memory[s, j, runs.TIME] == t_ns:
            most = max(most, memory[s, j, runs.BEGUN])
    return most


@exact
def outlier_chances(p, common):
    """P(isolated), P(begin of a run) of a row after a good one.

    ``p`` is that of any outlier of its channel by itself, ``common`` as of `common_cause`.
    """
    alone = (1.0 - common) * p
    return alone * (1.0 - RUN_SHARE), alone * RUN_SHARE + common * TOGETHER


@exact
def _advance(m, r, noise, fresh, good, gross, t_ns, common):
    """Move a channel's ``m`` (MEMORY,) on by one row of residual ``r``, given its log densities.

    ``fresh`` is the variance by which its prediction has gone wrong since the row before, ``common`` as of
    `common_cause`. Returns (log likelihood of the row, log density of a run that goes on).
    """
    seconds, m[runs.TIME] = min((t_ns - m[runs.TIME]) * 1e-9, LONGEST_S), t_ns
    run, bending, steady = runs.log_run(m, r, noise, fresh, gross, seconds)
    top = max(good, gross, run)
    settled, stay = m[0] + m[1], runs.stay(m)
    isolated, begins = outlier_chances(m[runs.CHANCE], common)
    wrong = settled * math.exp(gross - top)
    a = (settled * (1.0 - isolated - begins) + m[2] * (1.0 - stay)) * math.exp(good - top)
    b, begun, gone_on = wrong * isolated, wrong * begins, m[2] * stay * math.exp(run - top)
    c = begun + gone_on
    total = a + b + c
    if c > 0.0:
        runs.follow(m, r, noise, fresh, gross, begun / c, bending, steady, seconds)
    m[0], m[1], m[2], m[runs.BEGUN] = a / total, b / total, c / total, begun / total
    return top + math.log(total), run


@exact
def filtered(memory, r, s, noise, t_ns, common=0.0):
    """Move a channel's ``memory`` (MEMORY,), see `runs`, on by one row; (P(good), its log likelihood).

    ``common`` as of `common_cause`.
    """
    likelihood, _ = _advance(
        memory, r, noise, runs.FRESH * (s * s - noise), log_good(r, s), log_gross(r, s), t_ns, common
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
        s, c = rows.sensor[k], rows.channel[k]
        m, common = memory[s, c], common_cause(memory, s, c, rows.t[k])
        good = m[0]
        filtered(m, own.residual[k], own.sigma[k], own.noise[k], rows.t[k], common)
        if good > DOUBT:
            m[runs.CHANCE] += ((1.0 if own.weight[k] < 0.5 else 0.0) - m[runs.CHANCE]) / MEMORY_ROWS
            m[runs.CHANCE] = min(max(m[runs.CHANCE], P_OUTLIER), P_WORST)


@njit(cache=True)
def posterior(rows, own, memory, closed, young):
    """P(good) of each of the k rows into ``own.weight`` (k,), all rows of its sensor considered.

    ``own`` is a `buffer.Outcome` with deletion residuals and their 1-sigma. ``memory`` (s, 13, MEMORY) as
    before the first row; moved on in place to what it is after the last one. Rows that are ``closed`` (k,)
    get no weight, nor do those of a sensor that is astray, but for ``young``: who begins must first find out
    who is. Returns the largest change of a weight.
    """
    count, in_run = len(rows.t), memory[:, :, 2].copy()
    like, chance, stay, common = np.empty((count, 3)), np.empty((count, 3)), np.empty(count), np.empty(count)
    for k in range(count):
        s, c = rows.sensor[k], rows.channel[k]
        m, r, sigma, noise = memory[s, c], own.residual[k], own.sigma[k], own.noise[k]
        good, gross, fresh = log_good(r, sigma), log_gross(r, sigma), runs.FRESH * (sigma * sigma - noise)
        stay[k], common[k] = runs.stay(m), common_cause(memory, s, c, rows.t[k])
        _, run = _advance(m, r, noise, fresh, good, gross, rows.t[k], common[k])
        top = max(good, gross, run)
        like[k, 0], like[k, 1], like[k, 2] = math.exp(good - top), math.exp(gross - top), math.exp(run - top)
        chance[k] = m[:3]
    later = np.ones((memory.shape[0], memory.shape[1], 3))
    for k in range(count - 1, -1, -1):
        s, c = rows.sensor[k], rows.channel[k]
        b = later[s, c]
        chance[k] *= b
        chance[k] /= chance[k].sum()
        isolated, begins = outlier_chances(memory[s, c, runs.CHANCE], common[k])
        fits, wrong, goes_on = like[k, 0] * b[0], like[k, 1], like[k, 2] * b[2]
        settled = (1.0 - isolated - begins) * fits + wrong * (isolated * b[1] + begins * b[2])
        b[0], b[1], b[2] = settled, settled, (1.0 - stay[k]) * fits + stay[k] * goes_on
        b /= b.sum()
    change, begin = 0.0, 0
    while begin < count:  # epoch by epoch: what a sensor's other channels say at the same instant
        end = begin
        while end < count and rows.t[end] == rows.t[begin]:
            in_run[rows.sensor[end], rows.channel[end]] = chance[end, 2]
            end += 1
        for k in range(begin, end):
            good = chance[k, 0]
            if not young:
                good *= 1.0 - astray(in_run, rows.sensor[k], rows.channel[k])
            if good < NEGLIGIBLE or closed[k]:
                good = 0.0
            change = max(change, abs(good - own.weight[k]))
            own.weight[k] = good
        begin = end
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
        s, c = rows.sensor[k], rows.channel[k]
        if s == excluded:
            continue
        m, common = memory[s, c], common_cause(memory, s, c, rows.t[k])
        w, noise, v, S = own.weight[k], own.noise[k], out.v[k], out.S[k]
        sigma = math.sqrt(S)
        good = log_good(v, math.sqrt(S + (noise / w - noise if w > 0.0 else 0.0)))
        runs.move(m, out.moved[k])
        likelihood, _ = _advance(m, v, noise, out.fresh[k], good, log_gross(v, sigma), rows.t[k], common)
        total += likelihood
        mean, variance = expected(sigma, m[runs.CHANCE])
        due += mean
        spread += variance
    whole = (due - total) / math.sqrt(max(spread, 1.0))
    last = (due - newest[1] - total + newest[0]) / math.sqrt(max(spread - newest[2], 1.0))
    return total, max(whole, last)


@exact
def alone(rows, weight, found):
    """Into ``found`` (s,): whether of a sensor's k rows fewer than two others say if they are right.

    By their ``weight`` (k,).
    """
    found[:] = False
    for k in range(len(weight)):
        found[rows.sensor[k]] |= weight[k] > 0.0
    used = found.sum()
    for s in range(len(found)):
        found[s] = used - found[s] < 2


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
