"""The inbox: bounded by source, nothing pushed out by another, and what is lost is counted."""

import threading

import pytest

from gcs.contract.limits import LARGEST_BYTES
from gcs.contract.wire import inbox
from gcs.contract.wire.inbox import Excess, Inbox, Limits


@pytest.fixture
def clock(monkeypatch):
    """Time that passes when told to."""
    now = [1000.0]
    monkeypatch.setattr(inbox, "now_ns", lambda: round(now[0] * 1e9))
    return now


def put(box: Inbox, source: str, count: int, **how) -> None:
    for number in range(count):
        box.put(f"demo/uav1/raw/{source}", number, 100, **how)


def items(pairs: list, source: str) -> list:
    return [item for key, item in pairs if key.endswith(f"/{source}") and not isinstance(item, Excess)]


def lost(pairs: list, source: str) -> list[tuple[int, str]]:
    return [tuple(item) for key, item in pairs if key.endswith(f"/{source}") and isinstance(item, Excess)]


def all_of(box: Inbox) -> list:
    found = []
    while pairs := box.take(0.0):
        found += pairs
    return found


def test_a_flood_is_cut_to_its_rate_and_nobody_else_loses_anything(clock, caplog):
    box = Inbox(20_000, lambda _key: Limits(100.0, 5.0))
    found = []
    for _ in range(1000):  # ten seconds
        clock[0] += 0.01
        put(box, "wild", 100)
        put(box, "calm", 1)
        found += all_of(box)
    assert len(items(found, "calm")) == 1000
    kept = len(items(found, "wild"))
    assert 500 <= kept <= 520  # the burst, then nothing
    clock[0] += 3.0
    found += all_of(box)
    assert kept + sum(count for count, _ in lost(found, "wild")) == 100_000
    assert {reason for _, reason in lost(found, "wild")} == {"more than 100 a second"}
    assert len(lost(found, "wild")) <= 12  # told once a second
    clock[0] += 3.0
    box.take(0.0)
    assert [record.getMessage() for record in caplog.records if record.levelname == "WARNING"] == [
        "wild: more than 100 a second; the rest is refused and counted"
    ]
    assert box.lost == {"queue_full": 0, "over_limit": 100_000 - kept, "not_taken_in": 0}


def test_the_end_of_a_flood_is_told(clock, caplog):
    caplog.set_level("INFO", "gcs")
    box = Inbox(100, lambda _key: Limits(10.0))
    put(box, "wild", 50)
    box.take(0.0)
    clock[0] += inbox.QUIET_S + 0.1
    box.take(0.0)
    assert caplog.messages[-1] == "wild keeps to its limits again"


def test_what_was_kept_for_a_late_reader_does_not_count(clock):
    box = Inbox(20_000, lambda _key: Limits(10.0))
    put(box, "theo", 2_000, kept=True)
    put(box, "theo", 10)
    assert len(items(box.take(0.0, 300), "theo")) == 2_000  # all of it in one turn
    assert items(box.take(0.0, 300), "theo") == list(range(10))


def test_a_full_inbox_drops_the_oldest_of_who_has_the_most(clock):
    box = Inbox(100)
    put(box, "calm", 10)
    put(box, "wild", 500)
    found = all_of(box)
    assert items(found, "calm") == list(range(10))
    assert items(found, "wild") == list(range(410, 500))
    assert lost(found, "wild") == [(410, "faster than it can be taken in")]
    assert box.lost == {"queue_full": 410, "over_limit": 0, "not_taken_in": 0}


def test_a_turn_is_short_and_the_order_is_that_of_arrival(clock):
    box = Inbox(20_000)
    for number in range(1000):
        box.put(f"demo/uav1/raw/s{number % 3}", number, 100)
    turns = []
    while pairs := box.take(0.0, 300):
        turns.append([item for _, item in pairs])
    assert [len(turn) for turn in turns] == [300, 300, 300, 100]
    assert [item for turn in turns for item in turn] == list(range(1000))


def test_a_message_that_is_too_large_is_not_kept(clock):
    box = Inbox(100)
    box.put("demo/uav1/raw/theo", bytearray(20_000_000), 20_000_000)
    box.put("demo/uav1/raw/theo", "small", LARGEST_BYTES)
    found = box.take(0.0)
    assert items(found, "theo") == ["small"]
    assert lost(found, "theo") == [(1, f"more than {LARGEST_BYTES} bytes")]


def test_a_reader_that_cannot_keep_up_gets_less_of_the_noisiest(clock):
    """Two turns a second, of 300 each, against 1,000 a second of one source and 20 of another."""
    box = Inbox(20_000, lambda _key: Limits(1_000.0))
    calm, ages = [], []
    for _ in range(240):  # two minutes
        clock[0] += 0.5
        put(box, "wild", 500)
        put(box, "calm", 10)
        ages.append(box.age_s)
        calm += items(box.take(0.0, 300), "calm")
    assert max(ages[120:]) < inbox.PATIENCE_S + inbox.BEHIND_S + 1.0
    calm += items(all_of(box), "calm")
    assert len(calm) == 2400  # all of it


def test_who_is_beyond_its_limits_is_not_waited_for(clock):
    """A reader of 50 a second, against 10,000 a second of one source and 20 of another."""
    box = Inbox(20_000, lambda _key: Limits(100.0, 5.0))
    calm, ages = [], []
    for _ in range(3_000):  # a minute
        clock[0] += 0.02
        put(box, "wild", 200)
        put(box, "calm", 1 if len(ages) % 3 == 0 else 0)
        ages.append(box.age_s)
        calm += items(box.take(0.0, 1), "calm")
    assert max(ages[500:]) < 1.0
    calm += items(all_of(box), "calm")
    assert len(calm) == 1_000  # all of it


def test_a_hiccup_costs_nobody_anything(clock):
    box = Inbox(20_000, lambda _key: Limits(100.0, 5.0))
    put(box, "theo", 40)
    clock[0] += 2.0  # the reader was away
    put(box, "theo", 40)
    found = all_of(box)
    assert len(items(found, "theo")) == 80
    assert lost(found, "theo") == []


def test_a_reader_that_was_away_and_catches_up_loses_nobody_anything(clock):
    """A minute at 90 a second waits; the reader then takes 300 a second while 90 go on coming."""
    box, found = Inbox(20_000, lambda _key: Limits(200.0)), []
    for _ in range(60):
        clock[0] += 1.0
        put(box, "ins", 50)
        put(box, "theo", 40)
    for _ in range(400):
        clock[0] += 0.1
        put(box, "ins", 5)
        put(box, "theo", 4)
        found += box.take(0.0, 30)
    assert box.age_s == 0.0
    assert len(items(found, "ins")) == 60 * 50 + 400 * 5
    assert not lost(found, "ins")


def test_what_was_taken_has_its_time_of_arrival_not_of_reading(clock):
    box = Inbox(100)
    put(box, "theo", 2)
    clock[0] += 60.0
    put(box, "theo", 1)
    clock[0] += 5.0
    box.take(0.0, 2)
    assert box.arrived_ns == 1000 * inbox.S
    box.take(0.0, 2)
    assert box.arrived_ns == 1060 * inbox.S
    box.take(0.0)
    assert box.arrived_ns == 1065 * inbox.S


def test_what_waits_can_be_seen_without_being_taken(clock):
    box = Inbox(100)
    put(box, "theo", 1)
    clock[0] += 1.0
    put(box, "radar", 1)
    key = "demo/uav1/raw/"
    assert box.waiting(0) == [(1000 * inbox.S, f"{key}theo", 0), (1001 * inbox.S, f"{key}radar", 0)]
    assert [source for _, source, _ in box.waiting(1000 * inbox.S)] == [f"{key}radar"]
    assert len(box.take(0.0)) == 2
    assert not box.waiting(0)


def test_invented_names_cost_no_memory(clock):
    box = Inbox(1_000)
    for number in range(5_000):
        box.put(f"demo/uav1/raw/{number}", number, 100)
        box.take(0.0)
    assert len(box._queues) <= inbox.SOURCES + 1


def test_a_source_above_its_rate_is_cut_to_it(clock):
    """1.5 times its rate is too much, twice its burst within a second would be wild."""
    box, found = Inbox(20_000, lambda _key: Limits(100.0, 1.0)), []
    for turn in range(1000):
        clock[0] += 0.01
        put(box, "theo", 1 + turn % 2)
        found += all_of(box)
    assert 1090 < len(items(found, "theo")) <= 1100


def test_a_wild_source_gets_its_rate_again_once_it_keeps_to_it(clock):
    box = Inbox(20_000, lambda _key: Limits(100.0, 1.0))
    put(box, "theo", 90)
    put(box, "theo", 1000)
    assert items(all_of(box), "theo") == []  # what waited of it is dropped, too
    assert box.lost["over_limit"] == 1090
    assert box.lost["queue_full"] == 0  # no reader was too slow for it
    for _ in range(3):
        clock[0] += 1.0
        put(box, "theo", 50)
        all_of(box)
    clock[0] += 1.0
    put(box, "theo", 50)
    assert len(items(all_of(box), "theo")) == 50


def test_what_waits_at_the_end_is_counted(clock):
    box = Inbox(1_000, lambda _key: Limits(100.0, 1.0))
    put(box, "theo", 130)
    left = box.leave()
    assert sorted(lost(left, "theo")) == [
        (30, "more than 100 a second"),
        (100, "the station was stopped before"),
    ]
    assert box.lost == {"queue_full": 0, "over_limit": 30, "not_taken_in": 100}
    assert box.take(0.0) == []


def test_a_reader_is_woken_by_the_first_item():
    box = Inbox(10)
    threading.Timer(0.05, put, (box, "theo", 1)).start()
    assert items(box.take(10.0), "theo") == [0]
    assert box.idle_s < 5.0
    assert box.age_s == 0.0
