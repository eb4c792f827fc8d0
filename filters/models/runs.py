"""Runs of outliers: the error that one keeps, followed row by row while it lasts.

A run goes on as it was, in one of two ways, alike before its first row:

    loose    N(r; level, V + R), a level that each row moves by (SPREAD level)²: a tracker on something else
    smooth   N(r; level, P + R), a level with a rate, both of which each row corrects, and a rate that changes
             by BEND √R in √s (white acceleration: Bar-Shalom et al. 2001, 6.2.2): an offset, a mirror image,
             old values once more, a tracker that slides off

or it is erratic: any gross error. Were all loose, an error of so many metres would be the less likely the
sharper the instrument, and the sharpest would be believed. All paths of the channel's chain share one level
of each (the moments of their mixture, as in GPB1: Bar-Shalom et al. 2001, 11.6.3). Both levels move also with
what the prediction does, by the variance ``fresh``. Nearer than LEAST √R there is no run: errors that are
merely correlated, as an INS's are, make none.

A channel's memory, ``m`` (MEMORY,): the probability of each status of its newest row (3), the loose level,
the probability of an outlier after a good row, the variance of the loose level; P(smooth), then its level,
its rate, their covariance (level, both, rate), and the time of the newest row, ns.
"""

import math

from filters.models.kernel import exact

SPREAD = 0.1  # share of its level by which the errors of a loose run differ
BEND = 100.0  # sigmas of its own noise, a second, by which the rate of a smooth run changes in a second
FRESH = 0.1  # of the variance of a prediction by all others is new from row to row, where it is not known
LEAST = 3.0  # sigmas of its own noise by which the rows of a run are off
ERRATIC = 0.1  # of the rows of a run are anywhere
MEMORY = 13
LEVEL, CHANCE, VARIANCE, SMOOTH, LINE, RATE, SHARP, BOTH, STEEP, TIME = range(3, MEMORY)


@exact
def log_run(m, r, noise, fresh, gross, seconds):
    """(log density of a further row, P(smooth) after it) of the run in ``m``, with residual ``r``.

    ``noise`` is the row's own variance, ``gross`` the log density of a gross error, ``seconds`` since the row
    before.
    """
    far = ERRATIC * math.exp(gross)
    loose = _near(r, noise, m[LEVEL], m[VARIANCE] + fresh + (SPREAD * m[LEVEL]) ** 2)
    smooth = _near(r, noise, m[LINE] + seconds * m[RATE], _ahead(m, noise, fresh, seconds))
    loose = (1.0 - m[SMOOTH]) * (far + (1.0 - ERRATIC) * loose)
    smooth = m[SMOOTH] * (far + (1.0 - ERRATIC) * smooth)
    return math.log(loose + smooth), smooth / (loose + smooth)


@exact
def _near(r, noise, level, variance):
    """Density of a row at ``level``, times the probability that this is far enough off for a run."""
    moved = max(variance, 1e-12 * noise)  # before a first run it is nothing
    u = (r - level) / math.sqrt(noise + moved)
    offset = 0.5 * math.erfc((LEAST * math.sqrt(noise) - abs(level)) / math.sqrt(2.0 * moved))
    return offset * math.exp(-0.5 * u * u) / math.sqrt(2.0 * math.pi * (noise + moved))


@exact
def _ahead(m, noise, fresh, seconds):
    """Variance of a smooth run's level ``seconds`` on."""
    bend = BEND * BEND * noise * seconds * seconds * seconds / 3.0
    return m[SHARP] + seconds * (2.0 * m[BOTH] + seconds * m[STEEP]) + bend + fresh


@exact
def move(m, by):
    """The prediction has moved ``by`` so much, by what other rows said."""
    m[LEVEL] -= by
    m[LINE] -= by


@exact
def follow(m, r, noise, fresh, begun, smooth, seconds):
    """What a row of residual ``r`` says of the run in ``m``, in place.

    ``begun`` is P(the run begins with it), ``smooth`` that of `log_run`.
    """
    on = 1.0 - begun
    m[SMOOTH] = 0.5 * begun + on * smooth
    before = m[VARIANCE] + fresh + (SPREAD * m[LEVEL]) ** 2
    gain = before / (before + noise)
    old = m[LEVEL] + gain * (r - m[LEVEL])
    m[LEVEL] = begun * r + on * old
    m[VARIANCE] = begun * (noise + (r - m[LEVEL]) ** 2) + on * ((1.0 - gain) * before + (old - m[LEVEL]) ** 2)
    _follow_line(m, r, noise, fresh, begun, seconds)


@exact
def _follow_line(m, r, noise, fresh, begun, seconds):
    """The same of the smooth level and its rate; one that begins may be gone within a second, or twice it."""
    on, turn = 1.0 - begun, BEND * BEND * noise * seconds
    sharp = _ahead(m, noise, fresh, seconds)
    both, steep = m[BOTH] + seconds * (m[STEEP] + 0.5 * turn), m[STEEP] + turn
    ahead = m[LINE] + seconds * m[RATE]
    level = ahead + sharp / (sharp + noise) * (r - ahead)
    rate = m[RATE] + both / (sharp + noise) * (r - ahead)
    m[LINE], m[RATE] = begun * r + on * level, on * rate
    a, b, c, d = r - m[LINE], level - m[LINE], -m[RATE], rate - m[RATE]
    m[SHARP] = begun * (noise + a * a) + on * (sharp * noise / (sharp + noise) + b * b)
    m[BOTH] = begun * a * c + on * (both * noise / (sharp + noise) + b * d)
    m[STEEP] = begun * (r * r + c * c) + on * (steep - both * both / (sharp + noise) + d * d)
