"""Runs of outliers: the error that one keeps, followed row by row while it lasts.

A run goes on as it was, in one of three ways, alike before its first row:

    loose    N(r; level, V + R), a level that each row moves by (SPREAD level)²: a tracker on something else
    bending  N(r; level, P + R), a level with a rate, both of which each row corrects, and a rate that changes
             by BEND √R in √s (white acceleration: Bar-Shalom et al. 2001, 6.2.2): a mirror image, old values
             once more
    steady   the same with the much smaller DRIFT for BEND: an offset, a tracker that slides off

or it is erratic: any gross error. Were all loose, an error of so many metres would be the less likely the
sharper the instrument, and the sharpest would be believed. All paths of the channel's chain share one level
of each (the moments of their mixture, as in GPB1: Bar-Shalom et al. 2001, 11.6.3). The levels move also with
what the prediction does, by the variance ``fresh``. Nearer than LEAST √R there is no run: errors that are
merely correlated, as an INS's are, make none, unless other channels say that the sensor is `status.astray`.

A channel's memory, ``m`` (MEMORY,): the probability of each status of its newest row (3), the loose level,
the probability of an outlier after a good row, the variance of the loose level, the time of the newest row,
ns, for how many rows the run has lasted, the probability that it has begun with the newest row, and that it
may be near; of the bending and of the steady line: its probability, level, rate, and their covariance (level,
both, rate).
"""

import math

from filters.models.kernel import exact

SPREAD = 0.1  # share of its level by which the errors of a loose run differ
BEND = 100.0  # sigmas of its own noise, a second, by which the rate of a bending run changes in a second
DRIFT = 3.0  # … of a steady one
FRESH = 0.1  # of the variance of a prediction by all others is new from row to row, where it is not known
LEAST = 3.0  # sigmas of its own noise by which the rows of a run are off
ROWS = 10.0  # a run of one row ends with odds of one to so many, less one
LEVEL, CHANCE, VARIANCE, TIME, AGE, BEGUN, NEAR = range(3, 10)
BENDING, STEADY, MEMORY = 10, 16, 22  # where a line begins in the memory, and its end
P, LINE, RATE, SHARP, BOTH, STEEP = range(6)  # of a line


@exact
def log_run(m, r, noise, fresh, gross, seconds):
    """(log density of one more row, P(bending), P(steady) after it) of the run in ``m``, with residual ``r``.

    ``noise`` is the row's own variance, ``gross`` the log density of a gross error, ``seconds`` since the row
    before.
    """
    on = stay(m)
    far = (1.0 - on) * math.exp(gross)
    loose = _density(m, r, noise, m[LEVEL], m[VARIANCE] + fresh + (SPREAD * m[LEVEL]) ** 2)
    loose = (1.0 - m[BENDING + P] - m[STEADY + P]) * (far + on * loose)
    bending = m[BENDING + P] * (far + on * _on_line(m, BENDING, r, noise, fresh, seconds))
    steady = m[STEADY + P] * (far + on * _on_line(m, STEADY, r, noise, fresh, seconds))
    total = loose + bending + steady
    return math.log(total), bending / total, steady / total


@exact
def _density(m, r, noise, level, variance):
    """That of a row at ``level``, times the probability that this is far enough off or may be near."""
    moved = max(variance, 1e-12 * noise)  # before a first run it is nothing
    u = (r - level) / math.sqrt(noise + moved)
    offset = 0.5 * math.erfc((LEAST * math.sqrt(noise) - abs(level)) / math.sqrt(2.0 * moved))
    return (
        (m[NEAR] + (1.0 - m[NEAR]) * offset)
        * math.exp(-0.5 * u * u)
        / math.sqrt(2.0 * math.pi * (noise + moved))
    )


@exact
def _on_line(m, line, r, noise, fresh, seconds):
    """`_density` of the ``line`` that begins there in ``m``, ``seconds`` on."""
    return _density(
        m, r, noise, m[line + LINE] + seconds * m[line + RATE], _ahead(m, line, noise, fresh, seconds)
    )


@exact
def _turn(line, noise):
    """Density of the white acceleration of a ``line``."""
    return (BEND * BEND if line == BENDING else DRIFT * DRIFT) * noise


@exact
def _ahead(m, line, noise, fresh, seconds):
    """Variance of a ``line``'s level ``seconds`` on."""
    bend = _turn(line, noise) * seconds * seconds * seconds / 3.0
    known = m[line + SHARP] + seconds * (2.0 * m[line + BOTH] + seconds * m[line + STEEP])
    return known + bend + fresh


@exact
def stay(m):
    """Probability that the run in ``m`` goes on.

    The longer it has lasted the longer it will: a glitch and a broken instrument are the same at first. Their
    lengths have a Pareto distribution then (Lomax 1954), half of them are below ROWS.
    """
    return 1.0 - 1.0 / (ROWS + m[AGE])


@exact
def move(m, by):
    """The prediction has moved ``by`` so much, by what other rows said."""
    m[LEVEL] -= by
    m[BENDING + LINE] -= by
    m[STEADY + LINE] -= by


@exact
def follow(m, r, noise, fresh, gross, begun, bending, steady, seconds):
    """What a row of residual ``r`` says of the run in ``m``, in place.

    ``begun`` is P(the run begins with it), ``bending`` and ``steady`` those of `log_run`, ``gross`` as there.
    """
    on, far = 1.0 - begun, (1.0 / stay(m) - 1.0) * math.exp(gross)
    m[AGE] = on * (m[AGE] + 1.0)
    before = m[VARIANCE] + fresh + (SPREAD * m[LEVEL]) ** 2
    gain = before / (before + noise)
    old = m[LEVEL] + gain * (r - m[LEVEL])
    m[LEVEL] = begun * r + on * old
    m[VARIANCE] = begun * (noise + (r - m[LEVEL]) ** 2) + on * ((1.0 - gain) * before + (old - m[LEVEL]) ** 2)
    _follow_line(m, BENDING, r, noise, fresh, far, begun, bending, seconds)
    _follow_line(m, STEADY, r, noise, fresh, far, begun, steady, seconds)


@exact
def _follow_line(m, line, r, noise, fresh, far, begun, likely, seconds):
    """The same of one ``line`` and its rate; one that begins may be gone within a second, or twice it.

    So does one from which this row is a gross error, of density ``far``: it goes on from there.
    """
    m[line + P] = begun / 3.0 + (1.0 - begun) * likely
    near = _on_line(m, line, r, noise, fresh, seconds)
    begun += (1.0 - begun) * far / (far + near)
    on, turn = 1.0 - begun, _turn(line, noise) * seconds
    sharp = _ahead(m, line, noise, fresh, seconds)
    both, steep = m[line + BOTH] + seconds * (m[line + STEEP] + 0.5 * turn), m[line + STEEP] + turn
    ahead, slope = m[line + LINE] + seconds * m[line + RATE], m[line + RATE]
    level = ahead + sharp / (sharp + noise) * (r - ahead)
    rate = slope + both / (sharp + noise) * (r - ahead)
    m[line + LINE], m[line + RATE] = begun * r + on * level, on * rate
    a, b, c, d = r - m[line + LINE], level - m[line + LINE], -m[line + RATE], rate - m[line + RATE]
    m[line + SHARP] = begun * (noise + a * a) + on * (sharp * noise / (sharp + noise) + b * b)
    m[line + BOTH] = begun * a * c + on * (both * noise / (sharp + noise) + b * d)
    m[line + STEEP] = begun * (r * r + c * c) + on * (steep - both * both / (sharp + noise) + d * d)
