"""The flight's clock: who is refused, who is not, and since when; made-up sources with known lies."""

from collections import defaultdict

import numpy as np
import pytest

from gcs.station.sources.clocks import FlightClock, S

BEGAN_NS = 1_767_225_600 * S
RATES_HZ = {"ins": 50.0, "theo-a": 20.0, "theo-b": 20.0, "radar": 0.25}
DELAY_S, JITTER_S = 0.02, 0.01
MS = S // 1000


def honest(t_s):
    return np.zeros_like(t_s)


def since(begin_s, off_s, end_s=np.inf):
    """A clock that is off between two times."""
    return lambda t_s: np.where((t_s >= begin_s) & (t_s < end_s), off_s, 0.0)


class Played:
    """Sources with their clocks' errors, functions of true time, and a station with its own."""

    def __init__(self, seconds, rates=RATES_HZ, station_s=0.0, speed=1.0, stall=(), held=(), **errors):
        rng = np.random.default_rng(7)
        self.clock = FlightClock(["ins", "theo-a", "theo-b", "radar"], 1.0)
        self.faults, self.at_s, self.told = defaultdict(list), defaultdict(list), []
        self.settled_s = None
        events = []
        for name, rate in rates.items():
            t_s = np.arange(0.0, seconds, 1.0 / rate) + rng.uniform(0.0, 0.5 / rate)
            stamp_s = t_s + errors.get(name.replace("-", "_"), honest)(t_s)
            arrival_s = t_s / speed + DELAY_S + rng.exponential(JITTER_S, len(t_s))
            for begin_s, end_s, by_s in held:
                arrival_s[(arrival_s >= begin_s) & (arrival_s < end_s)] += by_s
            events += zip(arrival_s.tolist(), [name] * len(t_s), stamp_s.tolist(), t_s.tolist(), strict=True)
        turns = defaultdict(list)
        for arrival_s, *event in sorted(events):
            turn_s = next((end for begin, end in stall if begin <= arrival_s < end), arrival_s)
            turns[int(turn_s / 0.01) + 1].append(event)
        waiting = []
        for number, found in sorted(turns.items()):
            now_ns = BEGAN_NS + round((number * 0.01 + station_s) * S)
            for name in RATES_HZ:
                stamps = [BEGAN_NS + round(s * S) for one, s, _ in found if one == name]
                if stamps:
                    self.clock.hear(name, np.array(stamps), now_ns)
                    times = [t for one, _, t in found if one == name]
                    waiting.append((now_ns, name, np.array(stamps), times))
            if self.clock.settle(now_ns):
                self.settled_s = self.settled_s or number * 0.01
                for arrival_ns, name, stamps, times in waiting:
                    self.faults[name] += self.clock.judge(name, stamps, arrival_ns).tolist()
                    self.at_s[name] += times
                waiting.clear()
        self.told = self.clock.told

    def refused(self, name, begin_s=0.0, end_s=np.inf):
        """Share of what a source measured between two times."""
        t_s, fault = np.array(self.at_s[name]), np.array(self.faults[name])
        return float((fault[(t_s >= begin_s) & (t_s < end_s)] > 0).mean())


@pytest.mark.parametrize("station_s", [0.0, 0.4, -0.4, 3600.0, -3600.0, 1e8])
@pytest.mark.parametrize("speed", [1.0, 2.0, 0.5])
@pytest.mark.parametrize("stall", [(), [(3.0, 5.0)], [(1.0, 1.8), (4.0, 14.0)]], ids=str)
def test_honest_sources_are_never_refused(station_s, speed, stall):
    """Whatever the station's own clock says, however fast a recording is played, and whatever stalls."""
    if speed != 1.0 and abs(station_s) < 60.0:
        station_s += 1e6  # a recording is from some other day
    played = Played(30.0, station_s=station_s, speed=speed, stall=stall)
    assert {name: played.refused(name) for name in RATES_HZ} == dict.fromkeys(RATES_HZ, 0.0)
    assert played.settled_s < 2.5
    assert all("taken as the flight's" in text for _, text in played.told)
    assert len(played.told) == (abs(station_s) > 1.0)


@pytest.mark.parametrize("station_s", [0.0, 3600.0])
@pytest.mark.parametrize("speed", [1.0, 2.0, 0.5])
def test_who_is_prompt_again_after_all_were_late_is_not_ahead(station_s, speed):
    """A machine that was busy for two seconds held up everybody alike."""
    station_s += 1e6 if speed != 1.0 else 0.0
    played = Played(20.0, station_s=station_s, speed=speed, held=[(4.0, 6.0, 0.7)])
    assert {name: played.refused(name) for name in RATES_HZ} == dict.fromkeys(RATES_HZ, 0.0)


LIES_S = [2.0, -2.0, 10.0, -10.0, 3600.0, -3600.0, 365.25 * 86400.0, -1024 * 7 * 86400.0]


@pytest.mark.parametrize("off_s", LIES_S)
@pytest.mark.parametrize("liar", ["ins", "theo-a"])
@pytest.mark.parametrize("station_s", [0.0, -3600.0, 1e8])
def test_one_clock_that_jumps_is_refused_while_it_lies_and_the_others_are_not(off_s, liar, station_s):
    played = Played(20.0, station_s=station_s, **{liar.replace("-", "_"): since(5.0, off_s, 12.0)})
    for name in RATES_HZ.keys() - {liar}:
        assert played.refused(name) == 0.0
    assert played.refused(liar, 0.0, 5.0) == played.refused(liar, 12.0) == 0.0
    assert played.refused(liar, 6.0, 12.0) == 1.0
    if off_s > 0.0 or off_s < -60.0:  # what is a little behind is late at first, as after a stall
        assert played.refused(liar, 5.0, 6.0) == 1.0
    said = [text for _, text in played.told if text.startswith(f"{liar} is")]
    assert len(said) == 2
    assert "refused" in said[0]
    assert ("ahead of" if off_s > 0 else "behind") in said[0]
    assert "right again" in said[1]


@pytest.mark.parametrize("off_s", [0.5, 0.9, 5.0, 3600.0])
def test_who_speaks_first_with_a_clock_ahead_is_no_reference(off_s):
    played = Played(20.0, rates={"theo-a": 20.0}, theo_a=since(0.0, off_s, 4.0))
    others = Played(20.0, theo_a=since(0.0, off_s))
    assert others.refused("theo-a") == 1.0
    assert others.refused("ins") == others.refused("theo-b") == 0.0
    assert played.refused("theo-a", 4.0) == 0.0


def test_a_source_alone_and_apart_waits_for_others_and_is_then_taken():
    played = Played(20.0, rates={"theo-a": 20.0}, theo_a=since(0.0, 3600.0))
    assert 9.9 < played.settled_s < 10.2
    assert played.refused("theo-a") == 0.0
    assert len(played.at_s["theo-a"]) == 400  # what waited is taken, too
    assert "taken as the flight's, alone" in played.told[0][1]


def test_of_two_that_disagree_the_station_decides():
    two = {"theo-a": 20.0, "theo-b": 20.0}
    played = Played(20.0, rates=two, theo_a=since(0.0, 10.0))
    assert (played.refused("theo-a"), played.refused("theo-b")) == (1.0, 0.0)
    apart = Played(20.0, rates=two, station_s=500.0, theo_a=since(0.0, 10.0))
    assert (apart.refused("theo-a"), apart.refused("theo-b")) == (0.0, 1.0)  # nearer to it by 10 s
    assert "of sources that all differ the nearest" in apart.told[0][1]


@pytest.mark.parametrize("rate", [0.01, -0.01])
@pytest.mark.parametrize("station_s", [0.0, 3600.0])
def test_a_clock_that_drifts_is_refused_after_some_seconds_and_back_within_two(rate, station_s):
    drift = lambda t_s: np.where((t_s >= 10.0) & (t_s < 30.0), rate * (t_s - 10.0), 0.0)  # noqa: E731
    played = Played(45.0, station_s=station_s, theo_a=drift)
    assert played.refused("theo-a", 0.0, 10.0) == 0.0
    assert played.refused("theo-a", 15.0, 30.0) == 1.0  # less than 0.05 s is not told
    assert played.refused("theo-a", 32.0) == 0.0
    assert all(played.refused(name) == 0.0 for name in ("ins", "theo-b", "radar"))
    assert any("and drifts: refused" in text for _, text in played.told)


@pytest.mark.parametrize("left_s", [0.0, 0.1])
def test_of_a_clock_that_drifts_it_is_told_when_it_was_right_and_how_far_it_is_at_the_end(left_s):
    def drift(t_s):
        lies = (t_s >= 12.0) & (t_s < 32.0)
        return np.where(lies, -0.01 * (t_s - 12.0), np.where(t_s < 12.0, 0.0, left_s))

    played = Played(45.0, theo_a=drift)
    was, now = played.clock.drifts
    assert was.name == now.name == "theo-a"
    assert BEGAN_NS < was.before_ns == now.before_ns < BEGAN_NS + 12 * S
    assert was.before_ns < was.newest_ns < BEGAN_NS + 17.5 * S
    assert was.moved_s == 0.0
    assert now.moved_s == pytest.approx(left_s, abs=0.01)


def test_who_drifts_from_the_first_row_on_was_never_right():
    played = Played(30.0, theo_a=lambda t_s: np.where(t_s < 20.0, 0.01 * t_s, 0.0))
    assert [now.moved_s for now in played.clock.drifts] == [0.0, np.inf]


def test_who_is_late_from_the_first_row_is_refused_from_the_first_row():
    """Heard once, it may have a stall behind it, but not from before the flight's first turn."""
    played = Played(5.0, theo_a=since(0.0, -10.0))
    assert sum(fault == 0 for fault in played.faults["theo-a"]) <= 1  # of the first turn: kept by a bridge
    assert all(played.refused(name) == 0.0 for name in ("ins", "theo-b", "radar"))


@pytest.mark.parametrize("off_s", [0.2, -0.2, -0.7])
def test_a_small_offset_or_a_delay_is_the_estimators(off_s):
    played = Played(20.0, theo_a=since(5.0, off_s))
    assert all(played.refused(name) == 0.0 for name in RATES_HZ)
    assert played.told == []


@pytest.mark.parametrize("off_s", [4.5, 1e9, -1e9])
def test_one_wild_stamp_costs_itself_alone(off_s):
    played = Played(20.0, theo_a=since(7.0, off_s, 7.05))
    assert played.refused("theo-a", 7.0, 7.05) == 1.0
    assert sum(map(bool, played.faults["theo-a"])) == 1
    assert all(played.refused(name) == 0.0 for name in ("ins", "theo-b", "radar"))
    assert len(played.told) == 2


def test_a_clock_that_is_never_the_same_twice_is_refused_where_it_lies():
    jumps = lambda t_s: np.where(np.floor(t_s * 20.0) % 2 == 0, 10.0, 0.0)  # noqa: E731
    played = Played(20.0, theo_a=jumps)
    t_s, fault = np.array(played.at_s["theo-a"]), np.array(played.faults["theo-a"])
    np.testing.assert_array_equal(fault > 0, jumps(t_s) > 0)
    assert played.refused("ins") == played.refused("theo-b") == 0.0


def test_the_clock_moves_when_most_say_so_for_a_second_and_one_event_names_them():
    off = since(8.0, 3600.0)
    played = Played(20.0, ins=off, theo_a=off, theo_b=off)
    assert played.refused("ins", 8.0, 9.0) > 0.9
    assert played.refused("ins", 9.7) == 0.0
    moved = [text for level, text in played.told if level == "error"]
    assert len(moved) == 1
    assert all(name in moved[0] for name in ("ins", "theo-a", "theo-b"))


def test_all_late_together_is_a_slow_link_and_no_other_clock():
    late = lambda t_s: np.interp(t_s, [5.0, 8.0, 12.0, 12.1], [0.0, -6.0, -6.0, 0.0])  # noqa: E731
    played = Played(
        20.0, rates={"ins": 50.0, "theo-a": 20.0, "theo-b": 20.0}, ins=late, theo_a=late, theo_b=late
    )
    assert all(played.refused(name) == 0.0 for name in ("ins", "theo-a", "theo-b"))
    assert played.told == []


def test_what_was_kept_for_a_station_that_restarts_may_be_as_old_as_it_likes():
    clock = FlightClock(["ins", "theo-a"], 1.0)
    kept = BEGAN_NS - np.arange(100, 0, -1) * S
    ahead = np.array([BEGAN_NS + 3600 * S])
    for name in ("ins", "theo-a"):
        clock.hear(name, kept, BEGAN_NS)
    for turn in range(1, 200):
        now_ns = BEGAN_NS + turn * 10 * MS
        clock.hear("ins", np.array([now_ns]), now_ns)
        clock.settle(now_ns)
    assert not clock.judge("ins", kept, BEGAN_NS).any()
    assert not clock.judge("theo-a", kept, BEGAN_NS).any()
    assert clock.judge("theo-a", ahead, BEGAN_NS).all()


def test_latency_is_the_delay_and_in_a_recording_that_beyond_the_promptest():
    live = Played(10.0).clock
    assert DELAY_S < live.latency_s("theo-a") < DELAY_S + 5 * JITTER_S
    late = Played(10.0, station_s=1e6, theo_b=since(0.0, -0.3)).clock
    assert 0.25 < late.latency_s("theo-b") < 0.35
    assert abs(late.latency_s("theo-a")) < 0.05
    assert late.latency_s("nobody") == 0.0
