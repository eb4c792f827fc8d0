"""What the autopilot says: position with a slow error, velocity, acceleration, all a little late.

Its position is itself the output of a filter, so its error is slow: a Gauss-Markov bias per axis plus white
noise. The row stamped t is valid at t − latency; the latency is a state where it is to be estimated.
"""

from filters.models.kernel import kernel
from filters.models.rows import AE, VE, E

BIAS_SIGMA_M = 2.5  # stationary 1-sigma of the position error per axis: an ordinary single-frequency receiver
BIAS_TAU_S = 90.0  # its correlation time
LATENCY_SIGMA_S = 0.15  # prior of the latency left after the known part: autopilots show 0 to 0.3 s


@kernel
def observe(channel, x, bias_at, clock_at, index, gain, k):
    """Predicted value of one INS channel; its gradient goes to row ``k`` of ``index``, ``gain``.

    Returns (value, count of non-zero derivatives).
    """
    if channel >= AE:
        axis = channel - AE + 6
        index[k, 0], gain[k, 0] = axis, 1.0
        return x[axis], 1
    order = 1 if channel >= VE else 0
    axis = channel - (VE if order == 1 else E) + 3 * order
    index[k, 0], gain[k, 0] = axis, 1.0
    value, count = x[axis], 1
    if bias_at >= 0:
        index[k, count], gain[k, count] = bias_at, 1.0
        value += x[bias_at]
        count += 1
    if clock_at >= 0:
        late = x[clock_at]
        index[k, count], gain[k, count] = axis + 3, -late
        index[k, count + 1], gain[k, count + 1] = clock_at, -x[axis + 3]
        value -= late * x[axis + 3]
        count += 2
        if order == 0:
            index[k, count], gain[k, count] = axis + 6, 0.5 * late * late
            gain[k, count - 1] += late * x[axis + 6]
            value += 0.5 * late * late * x[axis + 6]
            count += 1
    return value, count
