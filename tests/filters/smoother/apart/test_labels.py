"""What was done with a row is named by its weight and by those around it."""

import numpy as np
import pytest

from filters.models.rows import AZIMUTH, DEWEIGHTED, ISOLATED, PATCH, RANGE, USED
from filters.smoother import status
from tests.filters.smoother.test_status import case

pytestmark = pytest.mark.decision


def labelled(weight, *, length=None, alone=False, channels=None):
    rows, *_ = case(channels or [RANGE] * len(weight), 0)
    length = np.zeros((1, 13), np.int64) if length is None else length
    verdict, reason = np.zeros((2, len(weight)), "i1")
    status.label(rows, np.array(weight, "f4"), length, np.array([alone]), verdict, reason)
    return verdict.tolist(), reason.tolist(), length


def test_names_by_weight():
    verdict, reason, _ = labelled([1.0, 0.96, 0.94, status.DOUBT, 0.9 * status.DOUBT, 0.0])
    assert verdict == [USED, USED, DEWEIGHTED, DEWEIGHTED, ISOLATED, ISOLATED]
    assert reason == [status.NONE] * 2 + [status.INNOVATION] * 4


def test_a_run_is_named_a_patch_from_its_first_row_on():
    verdict, reason, length = labelled([1, 0, 0, 0, 0, 1, 0, 0, 1])
    assert verdict == [USED, PATCH, PATCH, PATCH, PATCH, USED, ISOLATED, ISOLATED, USED]
    assert reason[1:5] == [status.IN_RUN] * 4
    assert length[0, RANGE] == 0


def test_rows_of_other_channels_do_not_break_a_run():
    verdict, _, _ = labelled([0, 1, 0, 1, 0, 1], channels=[RANGE, AZIMUTH] * 3)
    assert verdict == [PATCH, USED] * 3


def test_a_run_goes_on_from_the_call_before():
    length = np.zeros((1, 13), np.int64)
    assert labelled([1, 0, 0], length=length)[0] == [USED, ISOLATED, ISOLATED]
    assert length[0, RANGE] == 2
    verdict, *_ = labelled([0, 1, 0], length=length)
    assert verdict == [PATCH, USED, ISOLATED]


def test_a_run_that_nobody_else_contradicts_is_ambiguous():
    verdict, reason, _ = labelled([0, 0, 0, 1], alone=True)
    assert verdict == [PATCH] * 3 + [USED]
    assert reason[:3] == [status.AMBIGUOUS] * 3
