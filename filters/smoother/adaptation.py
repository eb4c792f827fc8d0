"""Densities of the motion and noise of every channel, followed by their likelihood under a prior.

The smoother gives the slope and the expected information of the log likelihood by the logarithm θ of each
density (`passes.Scores`), the residuals of decided rows those of each noise (`noise_scores`), so that a step
towards the most probable value is slope / information, with the prior as one more observation (scoring:
Fahrmeir & Tutz 2001, *Multivariate Statistical Modelling*, 8.3). Both go up and down, and back to their prior
where the data cannot see them.

motion  the window decides, under a log-normal prior around what was usual lately: a manoeuvre begins at once.
noise   all decided rows of a channel decide, older ones the less; the prior is what the sensor states.
slow    how large an instrument's slow errors are: what the state says of them decides, as in `follow_slow`.
ins     how large an INS's errors are, each by itself: all decided rows decide, older ones the less.
"""

import numpy as np

from filters.models import motion, theodolite
from filters.models.rows import AE, CHANNELS, VE
from filters.models.state import Model
from filters.smoother.buffer import Outcome, Rows
from filters.smoother.passes import Scores

MOTION_SIGMA = 1.5  # of log density about the usual one: 95 % within a factor of twenty
MOTION_MEMORY_S = 10.0  # a flight that manoeuvres will do so again
USUAL_SIGMA = 3.0  # of log density before anything was seen: 95 % within a factor of 400
WILDER = 30.0  # factor of the densities in a manoeuvre
MOTION_STEP = 1.2  # largest change of log density in one pass
NOISE_SIGMA = 0.5  # of the prior of log variance: stated sigmas are right within a factor of 1.6
INS_NOISE_SIGMA = 3.0  # velocities and accelerations of an INS: vibration, which nobody states
NOISE_MEMORY_S = 10.0
CLIPPED = 3.0  # sigmas that a refused value counts for in its channel's noise
LOWEST, HIGHEST = np.log(0.25), np.log(1e3)  # of the variance over the stated one
SLOW_SIGMA = 2.0  # of the prior of log variance of slow errors: 95 % within a factor of seven of the noise
SLOW_MEMORY_S = 300.0
INS_MEMORY_S = 30.0  # GPS faults last for 5 to 60 s
SLOW_RANGE = np.log(1e-3), np.log(1e3)


def densities(now: np.ndarray, prior: np.ndarray, scores: Scores) -> np.ndarray:
    """(4,) after one step from ``now`` (4,); ``prior`` (4,) is the middle of their prior. Zero stays zero."""
    moves = prior > 0.0
    slope, information = (scores.kept[0] + scores.rest)[:, moves]
    weight = 1.0 / MOTION_SIGMA**2
    step = (slope + weight * np.log(prior[moves] / now[moves])) / (information + weight)
    step = np.clip(0.5 * step, -MOTION_STEP, MOTION_STEP)  # half of it: densities pull at the same data
    out = now.copy()
    out[moves] = np.clip(now[moves] * np.exp(step), motion.LOWEST[moves], motion.HIGHEST[moves])
    return out


def wilder(now: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """(4,) of a manoeuvre that begins."""
    wild = np.clip(WILDER * np.maximum(now, prior), motion.LOWEST, motion.HIGHEST)
    return np.where(prior > 0.0, wild, 0.0)


def log_prior(psd: np.ndarray, usual: np.ndarray) -> float:
    """Log density of ``psd`` (4,) under its prior, up to a constant."""
    moves = usual > 0.0
    return -0.5 * float(((np.log(psd[moves] / usual[moves]) / MOTION_SIGMA) ** 2).sum())


def motion_prior(psd: np.ndarray) -> np.ndarray:
    """(2, 4) logarithm of each density, and its information, as before the first row."""
    return np.stack([np.log(np.where(psd > 0.0, psd, 1.0)), np.full(len(psd), USUAL_SIGMA**-2)])


def follow_motion(
    known: np.ndarray, prior: np.ndarray, psd: np.ndarray, scores: Scores, seconds: float
) -> np.ndarray:
    """(2, 4) as `motion_prior` after ``seconds`` more of decided rows, scored at ``psd`` (2, 4)."""
    moves, out = psd[0] > 0.0, known.copy()
    keep = np.exp(-seconds / MOTION_MEMORY_S)
    (mean, information), (middle, least) = known[:, moves], prior[:, moves]
    slope, more = scores.kept[:, 0, moves], scores.kept[:, 1, moves]
    before = keep * (information - least)
    information = least + before + more.sum(axis=0)
    seen = (more * np.log(psd[:, moves]) + slope).sum(axis=0)
    mean = (least * middle + before * mean + seen) / information
    out[0, moves] = np.clip(mean, np.log(motion.LOWEST[moves]), np.log(motion.HIGHEST[moves]))
    out[1, moves] = information
    return out


def slow_prior(sensors: int) -> np.ndarray:
    """(2, s) log factor of the variance of each instrument's slow errors, and its information, beforehand."""
    return np.stack([np.zeros(sensors), np.full(sensors, SLOW_SIGMA**-2)])


def slow_factors(known: np.ndarray, model: Model) -> np.ndarray:
    """(n − 9,) factor of each systematic error's variance; 1 where none is estimated."""
    return np.where(model.slow_of >= 0, np.exp(known[0])[model.slow_of], 1.0)


def follow_slow(
    known: np.ndarray, model: Model, x: np.ndarray, variance: np.ndarray, seconds: float
) -> np.ndarray:
    """(2, s) as `slow_prior` after ``seconds`` more, by what the state ``x``, ``variance`` (n,) says of them.

    An error that is known well is a sample of its process, one in two correlation times; of one that the rows
    do not show nothing is learned. One step by slope and expected information of the samples' expected log
    likelihood, given all rows so far (as the maximisation of Shumway & Stoffer 1982).
    """
    at = motion.CORE + np.flatnonzero(model.slow_of >= 0)
    owner = model.slow_of[at - motion.CORE]
    stationary = model.prior[at] * np.exp(known[0, owner])
    samples = seconds / (2.0 * theodolite.SLOW_TAU_S)
    seen = np.maximum(1.0 - variance[at] / stationary, 0.0)
    slope, more = np.zeros((2, known.shape[1]))
    np.add.at(slope, owner, 0.5 * samples * ((x[at] ** 2 + variance[at]) / stationary - 1.0))
    np.add.at(more, owner, 0.5 * samples * seen**2)
    least, keep = SLOW_SIGMA**-2, np.exp(-seconds / SLOW_MEMORY_S)
    before = least + keep * (known[1] - least)
    information = before + more
    mean = keep * known[1] * known[0] / before  # the prior's own mean is 0
    step = np.clip(slope / information, -MOTION_STEP, MOTION_STEP)
    return np.stack([np.clip(mean + step, *SLOW_RANGE), information])


def ins_prior(n: int) -> np.ndarray:
    """(2, n − 9) log factor of the variance of each of an INS's errors, and its information, beforehand."""
    return np.stack([np.zeros(n - motion.CORE), np.full(n - motion.CORE, SLOW_SIGMA**-2)])


def follow_ins(known: np.ndarray, model: Model, scores: Scores, seconds: float) -> np.ndarray:
    """(2, n − 9) as `ins_prior` after ``seconds`` more of decided rows, by their ``scores``.

    Up only: that an INS is well tells nothing of how wrong it will be without its GPS.
    """
    out = ins_prior(len(model.prior))
    at = model.bias_at[model.is_ins]
    of = at[at >= 0] - motion.CORE
    (slope, more), (mean, information), least = scores.errors[:, of], known[:, of], SLOW_SIGMA**-2
    before = least + np.exp(-seconds / INS_MEMORY_S) * (information - least)
    mean = (before - least) / before * mean  # the prior's own mean is 0
    step = np.clip(slope / (before + more), -MOTION_STEP, MOTION_STEP)
    out[:, of] = np.clip(mean + step, 0.0, SLOW_RANGE[1]), before + more
    return out


def noise_prior(is_ins: np.ndarray) -> np.ndarray:
    """(2, s, 13) log scale of each channel's variance, and its information, as before the first row."""
    sigma = np.full((len(is_ins), len(CHANNELS)), NOISE_SIGMA)
    sigma[is_ins, VE : AE + 3] = INS_NOISE_SIGMA
    return np.stack([np.zeros_like(sigma), 1.0 / sigma**2])


def missing(p: np.ndarray) -> np.ndarray:
    """By how much the mean u² of good rows is below 1, each weighted by its probability of being good.

    u is the residual in its sigmas, ``p`` the probability of an outlier. The large ones of the good rows are
    taken for outliers. Were there as many small outliers as the Cauchy of `status` has, they would make up
    for it; an outlier that is there is a large one. Within 1 % of the integral for ``p`` from 0.005 to 0.2.
    """
    return 0.285 * p**0.76


def noise_scores(rows: Rows, own: Outcome, chance: np.ndarray, is_ins: np.ndarray) -> np.ndarray:
    """(2, s, 13) slope and expected information of the log likelihood by each channel's log variance.

    ``rows`` have been judged: each counts by its probability of being good, which its own residual has told,
    so that none counts for more than a few sigmas. ``chance`` (s, 13) of an outlier in a channel.
    """
    where, square = (rows.sensor, rows.channel), (own.residual / own.sigma) ** 2
    share = own.noise / own.sigma**2  # of the residual's variance
    slope = 0.5 * own.weight * share * (square - 1.0 + missing(chance[where]))
    information = 0.5 * own.weight * share**2
    # Vibration is noise that nobody stated: what is refused for it tells how large it is.
    shaken = (own.weight == 0.0) & is_ins[rows.sensor] & (rows.channel >= VE)
    slope[shaken] = 0.5 * (np.minimum(square[shaken], CLIPPED**2) - 1.0)
    information[shaken] = 0.5
    out = np.zeros((2, *chance.shape))
    np.add.at(out[0], where, slope)
    np.add.at(out[1], where, information)
    return out


def follow_noise(known: np.ndarray, prior: np.ndarray, seen: np.ndarray, seconds: float) -> np.ndarray:
    """(2, s, 13) as `noise_prior` after ``seconds`` more of decided rows, scored in ``seen`` (2, s, 13)."""
    keep = np.exp(-seconds / NOISE_MEMORY_S)
    slope, more = seen
    before = prior[1] + keep * (known[1] - prior[1])
    information = before + more
    mean = keep * known[1] * known[0] / before + slope / information  # the prior's own mean is 0
    return np.stack([np.clip(mean, LOWEST, HIGHEST), information])
