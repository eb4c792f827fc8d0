"""Live turns without sockets: one source that lies about time costs nothing but itself."""

import numpy as np
import pytest

from bench.speed import clocks
from gcs.contract.messages import Bad, PolarMeasurement
from gcs.station.session import Session
from gcs.station.sources import live
from gcs.station.sources.clocks import S

SECONDS = 9.0


@pytest.fixture(scope="module")
def flown():
    """Some seconds aloft of the sample flight."""
    return clocks.cut(clocks.sample(), 60.0, SECONDS)


@pytest.fixture(scope="module")
def silent(flown):
    """What comes of it when theo-north is silent in the middle."""
    alone = clocks.without(flown, span(flown))
    return clocks.run_live(alone, alone)


def span(flown):
    third = (flown.flight.end_ns - flown.flight.start_ns) // 3
    return clocks.Span("theo-north", flown.flight.start_ns + third, flown.flight.start_ns + 2 * third)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["+2 s", "+10 s", "+1 h", "-1 h", "+1 year"])
def test_live_one_that_lies_for_a_while_is_as_if_it_were_silent(flown, silent, name):
    ours = clocks.run_live(clocks.lying(flown, span(flown), clocks.LIES[name]), flown)
    got = clocks.tell(flown, span(flown), ours, silent)
    assert got.error < 1.1
    assert got.after < 1.1
    assert got.back_s < 0.2
    assert [text.split(" is ")[0] for text in got.events] == ["theo-north", "theo-north"]


@pytest.mark.slow
@pytest.mark.parametrize("station_s", [3600.0, -3600.0])
def test_live_a_station_with_a_wrong_clock_gives_the_same_track(flown, silent, station_s):
    alone = clocks.without(flown, span(flown))
    ours = clocks.run_live(alone, alone, station_s)
    ours_m, theirs_m = (w.rms_m(flown, flown.flight.start_ns, flown.flight.end_ns) for w in (ours, silent))
    assert ours_m == pytest.approx(theirs_m, rel=0.02)
    assert len(ours.events) == 1
    assert "the station's clock" in ours.events[0]


class Nothing:
    """A sink that keeps the events and the verdicts."""

    def __init__(self):
        self.told, self.reasons = [], []

    def take(self, update):
        self.told += [one.text for one in update.told]
        self.reasons += update.ledger.reason_texts(update.retired)

    def close(self, summary, best): ...


@pytest.fixture
def station_side(flown):
    sink = Nothing()
    session = Session(flown.station, flown.flight.frame, [sink])
    return sink, session, live.Arrivals(session.ledger.sensors, 1.0)


def shots(t_ns, n=1):
    return [PolarMeasurement(t_ns=t_ns + k, arrival_ns=0, range_m=900.0) for k in range(n)]


def test_unknown_sources_are_counted_and_told_once(station_side):
    sink, session, feeds = station_side
    for turn in range(5):
        now_ns = 1_767_225_600 * S + turn * 10_000_000
        live.turn(session, feeds, [("theo-sputh", m) for m in shots(now_ns, 3)], now_ns)
    summary = live.finish(session, feeds, {})
    assert summary["unknown_sources"] == {"theo-sputh": 15}
    assert [text.split(":")[0] for text in sink.told] == ["theo-sputh"]


def test_many_unknown_names_are_bounded(station_side):
    _, session, feeds = station_side
    live.turn(session, feeds, [(f"x{k}", m) for k in range(1000) for m in shots(S)], S)
    assert len(feeds.strangers) <= live.STRANGERS + 1
    assert sum(feeds.strangers.values()) == 1000


def test_what_waits_for_a_clock_at_the_end_has_a_verdict(station_side):
    _, session, feeds = station_side
    now_ns = 1_767_225_600 * S
    torn = Bad(source="theo-north", where="udp #1", reason="torn")
    arrived = [("theo-north", m) for m in shots(now_ns - 86_400 * S, 2)] + [("theo-north", torn)]
    live.turn(session, feeds, arrived, now_ns)
    assert len(feeds.waiting) == 1
    summary = live.finish(session, feeds, {})
    assert feeds.waiting == []
    counts = summary["verdicts"]["theo-north"]
    assert sum(counts["range"].values()) == 2
    assert counts["line"] == {"invalid": 1}


def test_a_burst_beyond_the_rate_is_refused_and_spread_out_it_is_not(station_side):
    """At most twice what it has sent within a tenth of a second of stamps before, whenever they arrive."""
    sink, session, feeds = station_side
    now_ns = 1_767_225_600 * S
    spread = [m for k in range(100) for m in shots(now_ns + k * S // 100)]
    live.turn(session, feeds, [("theo-north", m) for m in spread], now_ns + S)
    live.turn(session, feeds, [("theo-north", m) for m in shots(now_ns + S, 100)], now_ns + S)
    live.finish(session, feeds, {})
    assert sink.reasons.count(live.CROWD) == 80


def test_the_crowd_forgets_old_cells():
    crowd = live.Crowd()
    t_ns = 1_767_225_600 * S + np.arange(1000) * live.CELL_NS
    assert not crowd.too_many("theo", t_ns, 200.0).any()
    assert len(crowd._taken["theo"]) <= live.CELLS
    assert crowd.too_many("theo", np.full(20, t_ns[-1]), 200.0).sum() == 20 + 1 - live.FIRST  # one was before


def test_a_source_shows_how_fast_it_is_before_a_burst_of_it_is_taken():
    """200 a second are 20 in a cell: all that is missed is of the first; what comes at once is twice that."""
    crowd = live.Crowd()
    begin_ns = 1_767_225_600 * S
    at = begin_ns + np.arange(200) * S // 200
    assert crowd.too_many("ins", at, 200.0).sum() == 20 - live.FIRST
    flood = begin_ns + S + np.arange(3000) * S // 10_000
    taken = ~live.Crowd().too_many("radar", flood, 200.0)
    assert [taken[k : k + 1000].sum() for k in (0, 1000, 2000)] == [live.FIRST, 2 * live.FIRST, 40]


def test_the_same_turns_give_the_same_bits(flown):
    alone = clocks.cut(flown, 0.0, 3.0)
    first, second = (clocks.run_live(alone, alone) for _ in range(2))
    for a, b in zip(first.tracks, second.tracks, strict=True):
        np.testing.assert_array_equal(a["x"], b["x"])
