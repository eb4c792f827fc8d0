"""Challengers of an incumbent that win and that lose, and when they are tried."""

import numpy as np
import pytest

from filters.models import state
from filters.models.motion import PSD
from filters.models.rows import AZIMUTH, E
from filters.smoother import bank, proposals, status
from filters.smoother.bank import Bank
from filters.smoother.buffer import Outcome, Rows, outcome, streams
from filters.smoother.hypothesis import Workspace
from filters.smoother.proposals import Prior
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_bank import INS, RADAR, A, B, ambiguous, begun, off


def shifted(flight, sensors, path):
    """The ``flight`` with the target moved aside by ``path``: t_s → (metres (3,), m/s (3,)); in place."""
    for row in flight:
        t_s, c, sensor = row["t_ns"] * 1e-9, int(row["channel"]), sensors[row["sensor"]]
        (p,), (v,) = small.truth(np.array([t_s]))
        aside, speed = path(t_s)
        if sensor.kind == "ins":
            row["value"] += [*aside, *speed][c - E]
        else:
            moved, here = (small.polar(sensor, p + k * aside, v + k * speed)[c] for k in (1, 0))
            row["value"] += moved - here


def later(sensors, *, path=None, spoil=None, seed=1):
    """(bank with an incumbent that has decided a first second, the rows of 1.5 s after that)."""
    model = state.build(sensors)
    flight = small.fly(sensors, 2.5, seed=seed)
    if path is not None:
        shifted(flight, sensors, path)
    rows = small.to_rows(flight, model)
    if spoil:
        spoil(rows)
    first = int(np.searchsorted(rows.t, 1_000_000_000))
    before, after = (Rows(*(c[part] for c in rows)) for part in (slice(0, first), slice(first, None)))
    one = Bank(Workspace(model, PSD), Prior())
    assert one.begin(before)
    one.best.commit(before, first, one.best.settle(before, first), 1.0)
    own = outcome(len(after.t))
    own.weight[:] = 1.0
    one.best.judged(Outcome(*(np.concatenate(both) for both in zip(one.best.own, own, strict=True))))
    return one, after


def jump(size, at_s):
    """All of a sudden ``size`` metres aside."""
    return lambda t_s: ((t_s >= at_s) * size * np.array([0.6, -0.8, 0.0]), np.zeros(3))


def pull(acceleration, at_s):
    """A steady acceleration aside from ``at_s`` on."""
    way = acceleration * np.array([0.0, 0.6, 0.8])
    return lambda t_s: (0.5 * max(0.0, t_s - at_s) ** 2 * way, max(0.0, t_s - at_s) * way)


def test_no_challenge_when_all_is_well():
    one, rows = later([INS, A, B, RADAR])
    incumbent = one.best
    one.redecide(rows, 0)
    assert one.best is incumbent
    assert incumbent.shortfall < bank.SHORTFALL
    assert not ambiguous(one)
    assert not one.spread.any()


@pytest.mark.parametrize(
    ("refused", "asked"), [((), False), ((1, 2), False), ((1, 2, 3), True), (range(4), True)]
)
def test_who_is_not_confirmed_by_two_any_more_is_asked_and_starts_are_tried(refused, asked, monkeypatch):
    one, rows = later([INS, A, B, RADAR])
    one.best.own.weight[np.isin(rows.sensor, refused)] = 0.0
    begun = []
    monkeypatch.setattr(one.best, "settle", lambda *_, **__: None)  # it stays as it is
    monkeypatch.setattr(proposals, "starts", lambda *given: begun.append(given) or [])
    monkeypatch.setattr(proposals, "going_on", lambda *_: False)
    one.best.shortfall = 0.0
    one._challengers(rows, 0, ())
    assert bool(begun) == asked


def test_outliers_are_no_reason_to_begin_again():
    def spoil(rows):
        at = np.random.default_rng(0).permutation(len(rows.t))[:20]
        rows.value[at] += 40 * np.sqrt(rows.stated[at])

    one, rows = later([INS, A, B, RADAR], spoil=spoil)
    anchor = one.best.anchor.t_ns
    one.redecide(rows, 0)
    assert not one.best.young
    assert one.best.anchor.t_ns == anchor
    assert off(one, rows)[1] < 1.0


def test_who_explains_too_little_is_challenged_at_once_and_then_after_twice_the_time():
    one, _, _ = begun([A, B])
    one.best.shortfall = bank.SHORTFALL
    asked = [t_ns for t_ns in range(100, 1000, 50) if one._is_due(t_ns, 0)]
    assert asked == [100, 150, 200, 300, 500, 900]
    assert not one._is_due(950, 99)
    assert one._is_due(950, 100)  # the first of the rows in doubt is about to be decided


def test_who_explains_less_than_when_it_was_challenged_is_so_at_once():
    one, _, _ = begun([A, B])
    assert not one._is_due(0, -1)
    for t_ns, shortfall, asks in [(0, 2.5, True), (50, 2.4, True), (60, 2.3, False), (61, 3.3, False),
                                  (62, 3.5, True), (63, 1.9, False), (64, 2.1, True)]:  # fmt: skip
        one.best.shortfall = shortfall
        assert one._is_due(t_ns, -1) == asks


def test_a_run_that_has_begun_is_a_reason_but_none_to_ask_before_each_decision():
    one, _, _ = begun([A, B])
    one.best.shortfall = 0.0
    asked = [t_ns for t_ns in range(100, 1000, 50) if one._is_due(t_ns, t_ns - 50, doubted=True)]
    assert asked == [100, 150, 200, 300, 500, 900]
    assert not one._is_due(1000, 0)
    assert one._is_due(1050, 0, doubted=True)


def test_a_run_goes_on_that_began_in_the_window_and_has_not_ended():
    one, rows = later([INS, A])
    own, azimuth = one.best.own, np.flatnonzero((rows.sensor == 1) & (rows.channel == AZIMUTH))
    for first, last, goes_on in (
        (0, None, False),
        (5, None, True),
        (5, -1, False),
        (-3, None, True),
        (-2, None, False),
    ):
        own.weight[:] = 1.0
        own.weight[azimuth[first:last]] = 0.0
        assert proposals.going_on(one.best, rows) == goes_on


@pytest.mark.parametrize("seconds", [0.1, 1.0])
def test_so_few_rows_that_they_say_little_are_always_asked(seconds, monkeypatch):
    one, rows, _ = begun([RADAR])
    few = Rows(*(column[: round(30 * seconds)] for column in rows))
    one.best.judged(Outcome(*(column[: len(few.t)] for column in one.best.own)))
    tried, manoeuvre = [], proposals.manoeuvre
    monkeypatch.setattr(proposals, "manoeuvre", lambda *given: tried.append(given) or manoeuvre(*given))
    monkeypatch.setattr(bank, "FEW_ROWS", 10)
    one.redecide(few, 0)
    assert one.best.shortfall < bank.SHORTFALL
    assert len(tried) == (len(few.t) < 10)


def test_challengers_that_lost_are_not_tried_on_the_same_rows_again(monkeypatch):
    def spoil(rows):
        at = np.random.default_rng(0).permutation(len(rows.t))[:60]
        rows.value[at] += 40 * np.sqrt(rows.stated[at])

    one, rows = later([INS, A, B, RADAR], spoil=spoil)
    incumbent, tried = one.best, []
    manoeuvre = proposals.manoeuvre
    monkeypatch.setattr(proposals, "manoeuvre", lambda *given: tried.append(given) or manoeuvre(*given))
    one._challenge = bank.Challenge(int(rows.t[0]), int(rows.t[-1]) - 1, np.inf)
    one.redecide(rows, 0)
    assert not tried
    one._challenge = None
    one.redecide(rows, 0)
    assert len(tried) == 1
    assert one.best is incumbent
    assert one._challenge == (rows.t[-1], rows.t[-1], incumbent.shortfall)


def test_starts_are_tried_of_those_that_are_refused():
    """Of the others all is used already. Where so much is wrong that neither may be right, of all."""

    def spoil(rows):
        rows.value[(rows.sensor == 1) & (rows.channel == AZIMUTH)] += 0.05

    one, rows = later([INS, A, B, RADAR], spoil=spoil)
    one.best.settle(rows, 0)
    of = [start.own.weight[rows.sensor == 1].any() for start in one._starts(rows, only_refused=True)]
    assert len(of) == 1
    assert len(one._starts(rows)) == 4


def test_a_patch_begins_once_in_a_channel_and_needs_three_in_a_row():
    one, rows = later([INS, A])
    own, azimuth = one.best.own, np.flatnonzero((rows.sensor == 1) & (rows.channel == AZIMUTH))
    own.weight[azimuth[[1, 3, 4, 6]]] = 0.0
    assert not proposals.patches(one.best, rows).any()
    own.weight[azimuth[[5, 8, 9, 10]]] = 0.0
    assert np.flatnonzero(proposals.patches(one.best, rows)).tolist() == [azimuth[3]]
    one.best.excluded = 1
    assert not proposals.patches(one.best, rows).any()


def test_what_goes_wrong_is_a_channel_or_a_whole_sensor_from_its_first_patch_on():
    one, rows = later([INS, A])
    own, mine = one.best.own, np.flatnonzero(rows.sensor == 1)
    azimuth = mine[rows.channel[mine] == AZIMUTH]
    assert not proposals.going_wrong(one.best, rows, rows.sensor)
    own.weight[azimuth[3:6]] = 0.0
    [channel] = proposals.going_wrong(one.best, rows, streams(rows))
    [sensor] = proposals.going_wrong(one.best, rows, rows.sensor)
    assert np.flatnonzero(channel).tolist() == azimuth[3:].tolist()
    assert np.flatnonzero(sensor).tolist() == mine[mine >= azimuth[3]].tolist()
    own.weight[azimuth[3:]] = 0.0
    assert not proposals.going_wrong(one.best, rows, streams(rows))  # all of it is closed already


def test_closed_rows_stay_closed_in_the_one_and_are_opened_in_the_other():
    one, rows = later([INS, A, B, RADAR])
    closed = rows.sensor == 1
    shut, opened = proposals.closing(one.best, rows, closed)
    assert not shut.own.weight[closed].any()
    assert (opened.own.weight[closed] > 0.5).mean() > 0.95


@pytest.mark.parametrize("liar", range(3))
def test_the_bank_finds_one_of_three_that_is_wrong_throughout(liar):
    def spoil(rows):
        at = np.flatnonzero(rows.sensor == liar)
        rows.value[at] += 40.0 * np.sqrt(rows.stated[at])

    model = state.build(equal := [A, B, small.theodolite("c", (-500.0, 700.0, 0.0))])
    one, rows = later(equal)
    spoil(rows)
    small.places(rows, model.offset, model.rotation, model.is_ins, np.nan, 0)
    for _ in range(2):
        one.redecide(rows, 0)
    assert off(one, rows)[1] < 2.0
    assert (one.best.own.weight[rows.sensor == liar] < status.DOUBT).mean() > 0.9
    assert (one.best.own.weight[rows.sensor != liar] > status.DOUBT).mean() > 0.9


@pytest.mark.parametrize(
    ("size", "at_s"), [(10.0, 1.0), (50.0, 1.3), (50.0, 1.0), (500.0, 1.0), (5000.0, 1.0)]
)
def test_after_a_jump_of_everything_the_state_is_where_all_say(size, at_s):
    """Within the window, where only another start explains its end, or before its first row."""
    path = jump(size, at_s)
    one, rows = later([INS, A, B, RADAR], path=path)
    for _ in range(2):
        one.redecide(rows, 0)
    p, _ = small.truth(rows.t[-1:] * 1e-9)
    assert np.linalg.norm(one.best.head.x[:3] - p[0] - path(2.5)[0]) < 3.0
    after = rows.t >= at_s * 1e9 + 100_000_000
    assert (one.best.own.weight[after & (rows.sensor > 0)] > status.DOUBT).mean() > 0.9


@pytest.mark.parametrize("acceleration", [30.0, 100.0, 300.0])
def test_a_manoeuvre_is_followed_and_nobody_refused_for_it(acceleration):
    path = pull(acceleration, 1.7)
    one, rows = later([INS, A, B, RADAR], path=path)
    for _ in range(3):
        one.redecide(rows, 0)
    t_s = rows.t[-1] * 1e-9
    p, v = small.truth(np.array([t_s]))
    assert np.linalg.norm(one.best.head.x[:3] - p[0] - path(t_s)[0]) < 3.0
    assert np.linalg.norm(one.best.head.x[3:6] - v[0] - path(t_s)[1]) < 0.1 * acceleration
    assert (one.best.own.weight[rows.sensor > 0] > status.DOUBT).mean() > 0.95
