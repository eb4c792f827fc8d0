"""INS rows: the target's own state a latency ago, with slow errors; derivatives by differences."""

import numpy as np
import pytest

from filters.models import ins
from filters.models.rows import AE, AU, CHANNELS, VE, E
from tests.filters.smoother.kit.differences import derivatives

pytestmark = pytest.mark.decision

BIAS, CLOCK = 9, 10
ROWS = range(E, AU + 1)


def observe(channel, x, bias_at=BIAS, clock_at=CLOCK):
    index, gain = np.zeros((1, 11), np.int64), np.zeros((1, 11))
    value, count = ins.observe(channel, x, bias_at, clock_at, index, gain, 0)
    out = np.zeros(len(x))
    np.add.at(out, index[0, :count], gain[0, :count])
    return value, out


def some_x():
    return np.concatenate([np.random.default_rng(0).normal(scale=20.0, size=10), [0.3]])


@pytest.mark.parametrize("channel", ROWS, ids=CHANNELS[E:])
@pytest.mark.parametrize(("bias", "clock"), [(BIAS, CLOCK), (-1, CLOCK), (BIAS, -1), (-1, -1)])
def test_gradient_is_the_derivative(channel, bias, clock):
    x = some_x()
    _, gradient = observe(channel, x, bias, clock)
    found = derivatives(lambda y: observe(channel, y, bias, clock)[0], x, 1e-4)
    assert np.allclose(gradient, found, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("axis", range(3))
def test_a_value_is_the_state_as_it_was(axis):
    x = some_x()
    late = x[CLOCK]
    p, v, a = x[axis], x[axis + 3], x[axis + 6]
    assert observe(E + axis, x)[0] == pytest.approx(p - late * v + 0.5 * late**2 * a + x[BIAS])
    assert observe(VE + axis, x)[0] == pytest.approx(v - late * a + x[BIAS])
    assert observe(AE + axis, x)[0] == a
