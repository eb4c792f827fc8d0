"""The reduced update against the textbook's full one, filterpy's, and finite differences."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from filters.baselines.baselines import columns
from filters.models import motion, state
from filters.models.rows import AZIMUTH, CHANNELS, ELEVATION, RANGE, RANGE_RATE, ROW
from filters.models.update import update
from filters.smoother import buffer, passes
from tests.filters import full_ukf
from tests.filters.scenes import scene, sensors

pytestmark = pytest.mark.decision
JERK = np.array([10.0, 10.0, 0.0, 0.0])  # the textbook's motion knows no gusts
HIGH = np.array([0, 0, 150, 0, 0, 0, 0, 0, 0])  # m above the instruments


def spread_state(rng, sigma=(20.0, 5.0, 2.0)):
    root = rng.normal(size=(9, 9)) * np.repeat(sigma, 3)[:, None]
    return rng.normal(size=9) * [100, 100, 50, 20, 20, 5, 3, 3, 3] + HIGH, root @ root.T


def reduced(built, channel, x, P, measured):
    row = np.zeros(1, ROW)
    row["channel"], row["value"] = channel, measured
    out = passes.trace(1, len(x), 1)
    v, variance = state.predict_row(built, columns(built, row), 0, x, P, JERK, out, 0, state.scratch(len(x)))
    return v, variance, out.m[0], out.index[0, : out.count[0]], out.gain[0, : out.count[0]]


@pytest.mark.parametrize("channel", [RANGE, AZIMUTH, ELEVATION, RANGE_RATE], ids=CHANNELS[:4])
def test_reduced_points_equal_the_full_nineteen(channel):
    """Of a position that is not too wide for sigma points around it, see `unscented.WIDE`."""
    radar = sensors(["radar"], slow=0.0)
    built = state.build(radar)
    rng = np.random.default_rng(7)
    for _ in range(20):
        x, P = spread_state(rng, (2.0, 5.0, 2.0))
        measured = full_ukf.value(radar[0], channel, x) + 0.01
        v, variance, m, *_ = reduced(built, channel, x, P, measured)
        S = variance + radar[0].sigma[channel] ** 2
        full_x, full_P, full_v, full_S = full_ukf.update(x, P, radar[0], channel, measured)
        mine_x, mine_P = x.copy(), P.copy()
        update(mine_x, mine_P, m, v, S)
        assert v == pytest.approx(full_v, rel=1e-12, abs=1e-12)
        assert pytest.approx(full_S, rel=1e-11) == S
        assert np.allclose(mine_x, full_x, rtol=1e-11, atol=1e-11)
        assert np.allclose(mine_P, full_P, rtol=1e-11, atol=1e-11 * np.abs(P).max())


def test_gradient_is_the_derivative_where_the_state_is_sharp():
    radar = sensors(["radar"], estimate=("bias", "clock"))
    built = state.build(radar)
    rng = np.random.default_rng(3)
    n = len(built.prior)
    x = np.concatenate([spread_state(rng)[0], 0.01 * rng.normal(size=n - 9)])
    P = 1e-10 * np.eye(n)
    for channel in (RANGE, AZIMUTH, ELEVATION, RANGE_RATE):
        _, _, _, index, gain = reduced(built, channel, x, P, 1.0)
        for i in range(n):
            h = 1e-4
            up, down = (reduced(built, channel, x + d * h * np.eye(n)[i], P, 1.0)[0] for d in (1, -1))
            assert gain[index == i].sum() == pytest.approx((down - up) / (2 * h), rel=1e-6, abs=1e-7)


@pytest.mark.slow
def test_a_whole_flight_equals_filterpy():
    _, used, rows, _ = scene(11, seconds=20.0, names=("theo-a", "theo-b", "radar"))
    used = [one._replace(slow=0.0) for one in used]  # as the textbook's
    built = state.build(used)
    x0 = np.array([0, 0, 120.0, 0, 0, 0, 0, 0, 0])
    P0 = np.diag(np.repeat([400.0, 400.0, 25.0], 3))

    class RedrawingUkf(UnscentedKalmanFilter):
        """filterpy keeps sigma points between sequential updates; the textbook draws them again."""

        def update(self, *args, **kwargs):
            self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)
            super().update(*args, **kwargs)

    points = MerweScaledSigmaPoints(9, 1.0, 0.0, -6.0)
    theirs = RedrawingUkf(9, 1, 1.0, hx=None, fx=lambda x, dt: full_ukf.transition(dt)[0] @ x, points=points)
    theirs.x, theirs.P = x0.copy(), P0.copy()
    out, own = passes.trace(len(rows), 9, len(rows)), buffer.outcome(len(rows))
    x, P, given = x0.copy(), P0.copy(), columns(built, rows)
    own.weight[:], own.noise[:] = 1.0, given.stated
    passes.forward(built, given, own, JERK[None], x, P, given.t[0], 0, out, state.scratch(9))
    now = rows["t_ns"][0]
    for row in rows:
        if row["t_ns"] != now:
            theirs.Q = 10.0 * full_ukf.transition((row["t_ns"] - now) * 1e-9)[1]
            theirs.predict(dt=(row["t_ns"] - now) * 1e-9)
            now = row["t_ns"]
        sensor, channel = used[row["sensor"]], int(row["channel"])
        turn = channel in (AZIMUTH, ELEVATION)
        centre = full_ukf.value(sensor, channel, theirs.x)
        near = (
            (lambda a, c=centre, turn=turn: (a - c + np.pi) % (2 * np.pi) - np.pi) if turn else (lambda a: a)
        )
        theirs.update(
            near(np.array([row["value"]])),
            R=np.array([[sensor.sigma[channel] ** 2]]),
            hx=lambda y, s=sensor, c=channel, near=near: near(np.array([full_ukf.value(s, c, y)])),
        )
    assert np.allclose(x, theirs.x, rtol=1e-9, atol=5e-8)
    assert np.allclose(P, theirs.P, rtol=1e-9, atol=1e-7)


def test_motion_equals_van_loan():
    rng = np.random.default_rng(0)
    x, P = spread_state(rng)
    F, Q = full_ukf.transition(0.3)
    mine_x, mine_P = x.copy(), P.copy()
    motion.predict(mine_x, mine_P, 0.3, JERK, np.zeros(9), np.zeros(9))
    assert np.allclose(mine_x, F @ x, rtol=1e-13)
    assert np.allclose(mine_P, F @ P @ F.T + 10.0 * Q, rtol=1e-12)
