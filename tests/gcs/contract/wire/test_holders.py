"""One publisher a key: who is kept, who is refused, and when the next one is taken."""

import time

import pytest

from gcs.contract.messages import Bad, PolarMeasurement
from gcs.contract.wire.bus import Bus
from gcs.contract.wire.holders import AGAIN_S, OTHER, QUIET_S, Holders
from tests.gcs.contract.ends import client, collect, plain_zenoh, state, until

KEY = "demo/uav1/raw/theo-north"


def test_the_first_is_kept_while_it_speaks_and_the_other_is_told_once():
    holders = Holders()
    for k in range(200):
        assert holders.admit(KEY, "one", 0.1 * k)
        assert not holders.admit(KEY, "two", 0.1 * k + 0.05)
    assert holders.refused[KEY] == 200
    assert [level for level, _ in holders.told] == ["error"]
    assert "theo-north: two publishers" in holders.told[0][1]
    holders.admit(KEY, "one", AGAIN_S)
    holders.admit(KEY, "two", AGAIN_S + 1.0)
    assert len(holders.told) == 2


def test_a_slow_radar_keeps_its_key_between_scans():
    holders = Holders()
    for k in range(10):
        assert holders.admit(KEY, "radar", 4.0 * k)
        assert not holders.admit(KEY, "forger", 4.0 * k + 3.9)


def test_whose_token_is_gone_gives_way_at_once():
    holders = Holders()
    holders.admit(KEY, "one", 0.0)
    holders.left(KEY, "another")
    assert not holders.admit(KEY, "two", 0.1)
    holders.left(KEY, "one")
    assert holders.admit(KEY, "two", 0.2)
    assert not holders.admit(KEY, "one", 0.3)


def test_who_is_silent_without_a_token_gives_way_after_some_seconds():
    holders = Holders()
    holders.admit(KEY, None, 0.0)
    assert not holders.admit(KEY, "two", QUIET_S - 0.1)
    assert holders.admit(KEY, "two", QUIET_S + 0.1)
    assert "the other is taken" in holders.told[-1][1]


def test_keys_are_apart():
    holders = Holders()
    assert holders.admit(KEY, "one", 0.0)
    assert holders.admit("demo/uav1/raw/ins", "two", 0.0)


def shot_at(number):
    return PolarMeasurement(t_ns=number, arrival_ns=0, range_m=1.0)


@pytest.mark.network
def test_a_bridge_started_twice_is_not_mixed_in_and_one_started_again_is_taken(station, endpoint):
    subscription = station.subscribe("raw/*")
    with client(endpoint) as first, client(endpoint) as second:
        first.publish("raw", shot_at(1), "theo-north")
        assert collect(subscription, 1)[0][1].t_ns == 1
        second.publish("raw", shot_at(2), "theo-north")
        (source, refused), *_ = collect(subscription, 1)
        assert (source, type(refused), refused.reason) == ("theo-north", Bad, OTHER)
    with client(endpoint) as again:
        assert until(lambda: not subscription.holders._held)
        began = time.monotonic()
        again.publish("raw", shot_at(3), "theo-north")
        assert collect(subscription, 1)[0][1].t_ns == 3
        assert time.monotonic() - began < 2.0


@pytest.mark.network
def test_who_else_publishes_a_state_is_counted_and_the_station_itself_is_not(station, endpoint):
    others = station.claim("state")
    station.publish("state", state(0))
    with client(endpoint) as forger, plain_zenoh(endpoint) as plain:
        forger.publish("state", state(1))
        plain.put("demo/uav1/state", b"anything")
        assert until(lambda: len(others) == 2)
        assert isinstance(forger, Bus)
    assert sorted(others.values()) == [1, 1]
    assert "unknown" in others
