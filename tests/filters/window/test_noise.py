"""Noise levels: vibration is seen, motion, patches and outliers are not."""

import numpy as np
import pytest

from filters.models.rows import AU, RANGE
from filters.window import noise
from filters.window import passes as window


def given(channel, value):
    n = len(value)
    ones = np.ones(n)
    return window.Given(np.arange(n), np.zeros(n, int), np.full(n, channel), value, ones.copy(), ones, ones)


@pytest.mark.parametrize("true", [1.0, 12.0])
def test_vibration_is_measured_through_motion_and_outliers(true):
    rng = np.random.default_rng(0)
    value = 3.0 * np.sin(np.linspace(0, 6, 200)) + true * rng.normal(size=200)
    value[::15] += 100.0
    rows, scale = given(AU, value), np.ones((1, 13))
    noise.shake(rows, 0, 200, 0, np.ones((1, 13)), scale)
    assert scale[0, AU] == pytest.approx(true, rel=0.6)
    assert (rows.noise == 1.0).all() == (true == 1.0)


@pytest.mark.parametrize(
    ("true", "offset", "doubt"), [(1.0, 0.0, False), (1.0, 30.0, False), (10.0, 0.0, True)]
)
def test_an_instrument_is_believed_until_it_is_noisier_for_long(true, offset, doubt):
    rng = np.random.default_rng(1)
    rows = given(RANGE, np.zeros(2000))
    off = offset + true * rng.normal(size=2000)
    last, scale, variance = np.zeros((1, 13)), np.ones((1, 13)), np.ones((1, 13))
    noise.follow(np.array([False]), rows.sensor, rows.channel, off, variance, 0, 2000, last, scale)
    assert (noise.effective(variance, scale)[0, RANGE] > 1.0) == doubt
