"""The measurement buffer: order, twins, growth, what changes and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from filters.models.rows import AZIMUTH, DUPLICATE, INVALID, ISOLATED, LATE, RANGE, ROW, USED
from filters.smoother import status
from filters.smoother.buffer import BLOCK, MeasurementBuffer, epochs, faults, outcome, refusals

pytestmark = pytest.mark.decision

VARIANCE = np.full((3, 13), np.nan)
VARIANCE[:, :3] = [4.0, 1e-8, 1e-6]


def rows(*said):
    """ROW of (id, t, sensor, channel, value[, sigma])."""
    return np.array([(*one, 0.0)[:6] for one in said], ROW)


def put(buffer, new):
    return buffer.insert(new, np.full((len(new), 3), np.nan))


def judge(buffer, verdicts, begin=0):
    own = outcome(len(verdicts))
    own.weight[:] = [v == USED for v in verdicts]
    own.residual[:], own.sigma[:] = 0.5, 2.0
    buffer.judge(begin, own, np.array(verdicts, "i1"), np.zeros(len(verdicts), "i1"))


def test_rows_are_sorted_by_time_sensor_channel():
    buffer = MeasurementBuffer(VARIANCE)
    put(
        buffer,
        rows((0, 20, 1, RANGE, 1.0), (1, 10, 2, AZIMUTH, 2.0), (2, 10, 2, RANGE, 3.0), (3, 10, 0, RANGE, 4)),
    )
    put(buffer, rows((4, 15, 0, RANGE, 5.0)))
    view = buffer.view(0, buffer.size)
    assert view.t.tolist() == [10, 10, 10, 15, 20]
    assert view.value.tolist() == [4.0, 3.0, 2.0, 5.0, 1.0]


def test_stated_noise_is_the_rows_own_or_its_sensors():
    buffer = MeasurementBuffer(VARIANCE)
    put(buffer, rows((0, 1, 0, RANGE, 1.0), (1, 2, 0, RANGE, 1.0, 3.0), (2, 3, 0, RANGE, 1.0, np.nan)))
    assert buffer.view(0, 3).stated.tolist() == [4.0, 9.0, 4.0]


def test_a_twin_is_handed_back_and_the_first_stays():
    buffer = MeasurementBuffer(VARIANCE)
    twice = put(buffer, rows((0, 1, 0, RANGE, 1.0), (1, 1, 0, RANGE, 9.0), (2, 1, 1, RANGE, 2.0)))
    assert twice["id"].tolist() == [1]
    again = put(buffer, rows((3, 1, 1, RANGE, 7.0), (4, 1, 1, AZIMUTH, 3.0)))
    assert again["id"].tolist() == [3]
    assert buffer.view(0, buffer.size).value.tolist() == [1.0, 2.0, 3.0]


def test_it_grows_and_keeps_everything():
    buffer, count = MeasurementBuffer(VARIANCE), 20_000
    new = np.zeros(count, ROW)
    new["id"], new["t_ns"], new["value"] = np.arange(count), np.arange(count) * 10, np.arange(count)
    for part in np.array_split(new, 7):
        put(buffer, part)
    assert buffer.size == count
    assert np.array_equal(buffer.view(0, count).value, np.arange(count))
    put(buffer, rows((count, 5, 0, RANGE, -1.0)))
    assert buffer.view(0, 3).value.tolist() == [0.0, -1.0, 1.0]


def test_rows_that_are_done_are_not_moved():
    buffer = MeasurementBuffer(VARIANCE)
    put(buffer, rows((0, 10, 0, RANGE, 1.0), (1, 20, 0, RANGE, 2.0)))
    buffer.done = 2
    put(buffer, rows((2, 15, 0, RANGE, 3.0), (3, 12, 0, RANGE, 4.0)))
    assert buffer.view(0, 4).value.tolist() == [1.0, 2.0, 4.0, 3.0]


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 2), st.integers(0, 2)), unique=True, max_size=25),
    st.data(),
)
def test_the_order_of_arrival_does_not_matter(keys, data):
    new = rows(*((k, *key, float(k)) for k, key in enumerate(keys)))
    shuffled = new[data.draw(st.permutations(range(len(new))))] if len(new) else new
    cut = data.draw(st.integers(0, len(new)))
    one, two = MeasurementBuffer(VARIANCE), MeasurementBuffer(VARIANCE)
    put(one, new)
    for part in (shuffled[:cut], shuffled[cut:]):
        put(two, part)
    assert one.size == two.size
    for a, b in zip(one.view(0, one.size), two.view(0, two.size), strict=True):
        assert np.array_equal(a, b, equal_nan=True)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 1), st.integers(0, 1)), max_size=20),
    st.integers(0, 20),
)
def test_every_row_is_entered_or_handed_back(keys, cut):
    new = rows(*((k, *key, 0.0) for k, key in enumerate(keys)))
    buffer = MeasurementBuffer(VARIANCE)
    twice = np.concatenate([put(buffer, new[:cut]), put(buffer, new[cut:])])
    kept = buffer._id[: buffer.size]
    assert sorted([*kept, *twice["id"]]) == list(range(len(keys)))
    assert buffer.size == len(set(keys))


# ---- what goes out


def filled(count=4):
    buffer = MeasurementBuffer(VARIANCE)
    put(buffer, rows(*((100 + k, k, 0, RANGE, float(k)) for k in range(count))))
    buffer.done = count
    return buffer


def test_a_verdict_goes_out_when_new_changed_or_final_and_only_then():
    buffer = filled()
    judge(buffer, [USED, USED, ISOLATED, USED])
    first = buffer.changes()
    assert first["id"].tolist() == [100, 101, 102, 103]
    assert not first["final"].any()
    assert len(buffer.changes()) == 0
    judge(buffer, [USED, ISOLATED, ISOLATED, USED])
    assert buffer.changes()["id"].tolist() == [101]
    buffer.final = 2
    final = buffer.changes()
    assert final["id"].tolist() == [100, 101]
    assert final["final"].all()
    assert len(buffer.changes()) == 0


def test_a_verdict_says_what_was_predicted():
    buffer = filled()
    judge(buffer, [USED] * 4)
    found = buffer.changes()
    assert found["predicted"].tolist() == [-0.5, 0.5, 1.5, 2.5]
    assert (found["sigma"] == 2.0).all()
    assert (found["weight"] == 1.0).all()


def test_rows_of_our_own_have_no_verdict():
    buffer = MeasurementBuffer(VARIANCE)
    put(buffer, rows((-1, 1, 0, RANGE, 0.0), (7, 2, 0, RANGE, 0.0)))
    buffer.done = 2
    judge(buffer, [USED, USED])
    assert buffer.changes()["id"].tolist() == [7]


def test_rows_before_there_was_a_state_are_invalid():
    buffer = filled()
    judge(buffer, [USED] * 4)
    buffer.void(0, 2)
    found = buffer.changes()
    assert found["verdict"].tolist() == [INVALID, INVALID, USED, USED]
    assert found["reason"].tolist()[:2] == [status.NO_STATE] * 2
    assert found["weight"].tolist() == [0.0, 0.0, 1.0, 1.0]


def test_epochs_begin_where_the_time_changes():
    assert epochs(np.array([5, 5, 7, 7, 7, 9])).tolist() == [0, 2, 5]
    assert epochs(np.array([0, 1])).tolist() == [0, 1]
    assert epochs(np.array([], "i8")).tolist() == []


def test_faults_in_order_of_weight():
    new = rows(
        (0, 100, 0, RANGE, 1.0),
        (1, 99, 0, RANGE, 1.0),
        (2, 100, 0, RANGE, np.nan),
        (3, 100, 0, RANGE, np.inf),
        (4, 100, 0, 5, 1.0),
        (5, 100, 3, RANGE, 1.0),
        (6, 100, -1, RANGE, 1.0),
        (7, 99, 0, RANGE, np.nan),
        (8, 99, 9, RANGE, np.nan),
    )
    assert faults(new, VARIANCE, 100).tolist() == [
        status.NONE, status.TOO_OLD, status.NOT_FINITE, status.NOT_FINITE, status.NO_CHANNEL,
        status.NO_CHANNEL, status.NO_CHANNEL, status.NOT_FINITE, status.NO_CHANNEL,
    ]  # fmt: skip


@pytest.mark.parametrize("channel", [13, 100, -1, -14])
def test_a_channel_that_there_is_not_is_a_fault(channel):
    new = rows((0, 100, 0, RANGE, 1.0), (1, 100, 0, channel, 1.0))
    assert faults(new, np.ones((1, 13)), 0).tolist() == [status.NONE, status.NO_CHANNEL]


def test_refusals_are_final_with_their_reason():
    new = rows(*((k, k, 0, RANGE, 1.0) for k in range(4)))
    reason = np.array([status.TOO_OLD, status.NOT_FINITE, status.NO_CHANNEL, status.TWICE])
    found = refusals(new, reason)
    assert found["verdict"].tolist() == [LATE, INVALID, INVALID, DUPLICATE]
    assert found["reason"].tolist() == reason.tolist()
    assert found["id"].tolist() == [0, 1, 2, 3]
    assert found["final"].all()
    assert np.isnan(found["predicted"]).all()


def test_of_final_rows_of_long_ago_the_smoother_gets_what_was_made_of_them():
    """The rows that still count keep their numbers, and memory does not grow."""
    buffer, count = MeasurementBuffer(VARIANCE), 9 * BLOCK
    new = np.zeros(count, ROW)
    new["id"], new["t_ns"], new["value"] = np.arange(count), np.arange(count) * 10, np.arange(count) / 7
    for part in np.array_split(new, 27):
        put(buffer, part)
        own = outcome(len(part))
        own.weight[:], own.regime[:] = part["id"] % 3 / 2, part["id"]
        own.residual[:] = part["id"]
        buffer.judge(buffer.done, own, np.full(len(part), USED, "i1"), np.zeros(len(part), "i1"))
        buffer.done = buffer.decided = buffer.size
        buffer.final = max(0, buffer.done - 1000)
        changed = buffer.changes()
        assert np.array_equal(changed["predicted"], changed["id"] / 7 - changed["id"])
    assert len(buffer._id) <= 4 * BLOCK
    for begin, end in ((0, 5), (BLOCK - 3, BLOCK + 3), (100, count), (count - 5, count), (7, 7)):
        found, own = buffer.recall(begin, end)
        assert np.array_equal(found.t, 10 * np.arange(begin, end))
        assert np.array_equal(found.value, np.arange(begin, end) / 7)
        assert np.array_equal(own.weight, (np.arange(begin, end) % 3 / 2).astype("f4"))
        assert np.array_equal(own.regime, np.arange(begin, end))
    assert buffer.view(count - 2, count).t.tolist() == [10 * (count - 2), 10 * (count - 1)]
    assert buffer.count_before(10 * (count - 4)) == count - 4
    put(buffer, rows((count, 10 * count, 0, RANGE, 1.0)))
    assert buffer.view(count, count + 1).value == 1.0
