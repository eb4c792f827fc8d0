"""What the compiled loops promise: numpy's arithmetic, exact order where asked, the same as without numba."""

import math

import numpy as np
import pytest

from filters.models.kernel import exact, kernel

pytestmark = pytest.mark.decision


@kernel
def divide(a, b):
    return a / b


@exact
def drift(a, b, c):
    return (a + b) + c


@kernel
def unknown(value):
    return value != value


@exact
def unknown_exactly(value):
    return value != value


@pytest.mark.compiled  # plain Python raises
def test_a_number_divided_by_zero_is_infinite():
    assert divide(1.0, 0.0) == math.inf
    assert divide(-1.0, 0.0) == -math.inf


@exact
def total(values):
    out = 0.0
    for k in range(values.size):
        out += values[k]
    return out


@kernel
def total_by_a_kernel(values):
    return total(values)


def test_exact_stays_exact_where_a_kernel_is_the_first_to_call_it():
    values = np.random.default_rng(0).normal(size=1000) * 10.0 ** np.arange(1000) ** 0.3
    in_order = 0.0
    for value in values:
        in_order += float(value)
    assert total_by_a_kernel(values) == in_order
    assert total(values) == in_order


def test_exact_keeps_the_order_of_sums():
    assert drift(1e16, -1e16, 1.0) == 1.0
    assert drift(1.0, 1e16, -1e16) == 0.0


def test_exact_knows_what_is_not_a_number():
    assert unknown_exactly(math.nan)
    assert not unknown_exactly(np.inf)


def test_a_kernel_knows_what_is_not_a_number():
    assert unknown(math.nan)
    assert not unknown(1.0)
