"""The wind's arrow points where the air goes."""

import numpy as np

from web.scene.wind import arrow


def test_the_tip_is_ahead_and_the_barbs_behind_it():
    shaft, *barbs = arrow(np.array([0.0, 0, 50]), np.array([20.0, 0, 0]))
    np.testing.assert_allclose(shaft, [(-10, 0, 50), (10, 0, 50)])
    for barb in barbs:
        np.testing.assert_allclose(barb[0], (10, 0, 50))
        assert barb[1][0] < 10
    np.testing.assert_allclose(barbs[0][1][1], -barbs[1][1][1])
