"""Whether the lag of one source drifts: lines among lags that are known, and what only looks like one."""

import numpy as np
import pytest

from gcs.station.sources.lags import S, Voter, line

RNG = np.random.default_rng(4)


def known(lag_s, noise_s=0.001):
    """(n, 2) lags twice a second."""
    lag_s = np.asarray(lag_s)
    return np.column_stack([np.arange(len(lag_s)) / 2, lag_s + RNG.normal(scale=noise_s, size=len(lag_s))])


@pytest.mark.parametrize("noise_s", [0.0, 0.001, 0.02])
def test_noise_is_no_line(noise_s):
    for _ in range(200):
        assert line(known(np.zeros(40), noise_s)) == 0.0


def test_a_clock_that_runs_ahead_shows_in_two_to_three_seconds():
    lags = np.concatenate([np.zeros(20), -0.005 * np.arange(1, 8)])
    assert line(known(lags, 0.0003)) == pytest.approx(-0.01, rel=0.2)
    assert line(known(lags[:21], 0.0003)) == 0.0


def test_a_lag_that_grows_may_be_a_link_and_is_looked_at_for_longer():
    lags = np.concatenate([np.zeros(20), 0.005 * np.arange(1, 12)])
    assert line(known(lags[:24], 0.0003)) == 0.0
    assert line(known(lags, 0.0003)) == pytest.approx(0.01, rel=0.2)


def test_a_link_that_empties_itself_again_comes_back_to_where_it_was():
    filled = np.concatenate([np.zeros(20), [0.02, 0.06], 0.06 - 0.005 * np.arange(1, 12)])
    assert all(line(known(filled[:n], 0.0003)) == 0.0 for n in range(len(filled)))


@pytest.mark.parametrize("lags", [[0.0] * 20 + [0.03] * 10, [0.0] * 20 + [-0.03] * 10])
def test_a_step_is_no_line(lags):
    assert all(line(known(lags[:n], 0.0003)) == 0.0 for n in range(len(lags)))


def test_stairs_are_no_line():
    """As the sample's link: the aircraft's messages come 0.1 s later after 15 s, and again after 17."""
    lags = np.repeat([0.0, 0.082, 0.173], [20, 5, 10])
    assert all(line(known(lags[:n], 0.0003)) == 0.0 for n in range(len(lags)))


def test_on_a_link_whose_delays_jump_a_line_has_to_be_longer():
    jumping = np.tile([0.0, 0.0, 0.0, 0.015], 8)
    lags = np.concatenate([jumping, -0.005 * np.arange(1, 8)])
    assert line(known(lags, 0.0003)) == 0.0


def drifted(voter, steps, silent=()):
    """Whether its clock drifts, after each of some steps of half a second; not looked at when ``silent``."""
    out = []
    for k, lag_s in enumerate(np.cumsum(steps)):
        if k not in silent:
            voter.watch(k / 2, lag_s)
        out.append(voter.drift != 0.0)
    return out


def test_a_drift_lasts_until_it_no_longer_goes_on_as_it_began():
    found = drifted(Voter(), [0.0] * 10 + [-0.005] * 30 + [0.15] + [0.0] * 10)
    assert not any(found[:10])
    assert all(found[16:40])
    assert not any(found[42:])
    assert not any(drifted(Voter(), [0.0] * 10 + [-0.005] * 20 + [0.0] * 10)[34:])


def test_a_drift_that_was_found_while_its_lag_still_hung_goes_on():
    """A lag is the least of a whole second: a line begins less steep than it is, as here."""
    steps = [0.0] * 10 + [0.0006, 0.0018, 0.003, 0.0046, 0.0047, 0.0039, 0.0033, 0.0046]
    found = drifted(Voter(), steps + [0.007] * 20)
    assert found[19]
    assert all(found[19:])


def test_a_drift_goes_on_through_silence():
    found = drifted(Voter(), [0.0] * 10 + [0.005] * 50, range(30, 38))
    assert all(found[20:])


def test_a_lag_is_the_second_smallest_of_the_last_second():
    voter = Voter()
    for k, lag_ms in enumerate([30, 25, -900, 40]):
        voter.hear(np.array([lag_ms * S // 1000]), k * S // 10)
    assert voter.least_ns(3 * S // 10, 0.0) == 25 * S // 1000
    assert voter.least_ns(3 * S // 10 + S, 0.5) > 500 * S // 1000
