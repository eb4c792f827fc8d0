"""What a radar sees: all that a theodolite does, and the range rate."""

import math

from filters.models.kernel import kernel


@kernel
def range_rate(p, v):
    """p·v / |p|, m/s, positive when going away; ``p`` (3,) m, ``v`` (3,) m/s in sensor ENU."""
    return (p[0] * v[0] + p[1] * v[1] + p[2] * v[2]) / math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
