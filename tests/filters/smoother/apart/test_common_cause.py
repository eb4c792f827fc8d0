"""A common cause: channels of a sensor that go wrong together, and the one that shows it least."""

import numpy as np
import pytest

from filters.models import runs
from filters.models.rows import AZIMUTH, ELEVATION, RANGE, RANGE_RATE, VE, E, N, U
from filters.smoother import status
from tests.filters.smoother.test_status import GOOD, RUN, STEP_NS, case, open_

pytestmark = pytest.mark.decision


def test_a_run_begins_in_the_channels_of_a_sensor_together():
    """A row that may be anything, when a run begins in another channel, and later."""
    memory = status.fresh_memory(1)
    status.filtered(memory[0, RANGE], 1e3, 1.0, 0.5, 7)
    begun = memory[0, RANGE, runs.BEGUN]
    assert begun == pytest.approx(status.RUN_SHARE, abs=1e-3)
    assert status.common_cause(memory, 0, AZIMUTH, 7) == begun
    assert status.common_cause(memory, 0, RANGE, 7) == 0.0
    assert status.common_cause(memory, 0, AZIMUTH, 8) == 0.0
    alone, together = memory[0, AZIMUTH].copy(), memory[0, AZIMUTH]
    status.filtered(alone, 4.0, 1.0, 0.5, 7)
    status.filtered(together, 4.0, 1.0, 0.5, 7, begun)
    odds = [m[RUN] / m[GOOD] for m in (alone, together)]
    p = status.P_OUTLIER
    gain = (begun * status.TOGETHER + (1 - begun) * p * status.RUN_SHARE) / (p * status.RUN_SHARE)
    assert odds[1] / odds[0] == pytest.approx(gain, rel=0.15)  # and the good are the rarer


def test_by_itself_a_channel_errs_as_often_as_it_does():
    assert status.outlier_chances(0.1, 0.0) == pytest.approx((0.08, 0.02))
    assert status.outlier_chances(0.1, 1.0) == pytest.approx((0.0, status.TOGETHER))


@pytest.mark.parametrize(
    ("channels", "c", "expected"),
    [
        ({RANGE: 0.9, AZIMUTH: 0.8}, ELEVATION, 0.72),
        ({RANGE: 0.9, AZIMUTH: 0.8}, RANGE_RATE, 0.72),
        ({RANGE: 0.9, AZIMUTH: 0.8, ELEVATION: 0.5}, RANGE_RATE, 0.72),
        ({RANGE: 0.9, ELEVATION: 0.8}, RANGE, 0.0),
        ({RANGE: 0.9, RANGE_RATE: 1.0}, AZIMUTH, 0.0),
        ({E: 0.9, U: 0.8}, N, 0.72),
        ({E: 0.9, U: 0.8}, VE, 0.72),
    ],
)
def test_a_sensor_is_astray_where_two_other_coordinates_are_in_runs(channels, c, expected):
    memory = status.fresh_memory(2)
    for j, p in channels.items():
        memory[1, j, RUN] = p
    assert status.astray(memory[..., RUN], 1, c) == pytest.approx(expected)
    assert (
        status.common_cause(memory, 1, c, 7)
        == memory[1, c, runs.NEAR]
        == status.astray(memory[..., RUN], 1, c)
    )
    assert status.astray(memory[..., RUN], 0, c) == 0.0


@pytest.mark.parametrize("sigma", [1.0, 10.0])
def test_the_third_coordinate_is_not_believed_while_two_are_in_runs(sigma):
    """However sharply others see it, for it may lead them; until then it is, and soon after."""
    channels = [RANGE, AZIMUTH, ELEVATION] * 14
    rows, own, memory = case(channels, 0)
    memory[:] = status.fresh_memory(1)
    rows = rows._replace(t=STEP_NS * (np.arange(42) // 3))
    own.residual[:], own.sigma[:], own.noise[:] = 0.1, 1.0, 0.9
    own.sigma[rows.channel == ELEVATION] = sigma
    wrong = (rows.t >= 3 * STEP_NS) & (rows.t < 9 * STEP_NS)
    own.residual[wrong & (rows.channel != ELEVATION)] = 30.0
    status.posterior(rows, own, memory, open_(rows), False)
    third = own.weight[rows.channel == ELEVATION]
    assert (own.weight[wrong] < status.DOUBT).all()
    assert (own.weight[~wrong & (rows.channel != ELEVATION)] > 0.9).all()
    assert (third[:3] > 0.9).all()
    assert third[-1] > 0.5
