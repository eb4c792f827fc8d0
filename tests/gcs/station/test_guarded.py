"""A live flight goes on where a sink or the estimator fails, and no value is left without a verdict."""

from functools import partial

import numpy as np
import pytest

from filters import methods
from filters.models.rows import TRACK
from filters.smoother.estimator import FixedLagSmoother
from gcs.contract import supervision
from gcs.contract.config import Position, RangeSection, SensorSection, Station
from gcs.contract.frames import Frame
from gcs.contract.messages import POLAR, VERDICTS
from gcs.station.guarded import GuardedSink, Relay
from gcs.station.session import Session, Update

ORIGIN = Position(lat_deg=-35.36, lon_deg=149.16, alt_m=584.0)
STATION = Station(
    range=RangeSection(origin=ORIGIN),
    sensor=[SensorSection(name="theo", kind="theodolite", position=ORIGIN)],
)
FRAME = Frame(ORIGIN.lat_deg, ORIGIN.lon_deg, ORIGIN.alt_m)
T0_NS = 1_767_225_600 * 10**9


class Remembering:
    """A sink that fails in the turns it is told to."""

    def __init__(self, failing=()):
        self.turn, self.taken, self.best, self._failing = 0, [], None, failing

    def take(self, update):
        self.turn += 1
        if self.turn in self._failing:
            raise OSError("no space left on device")
        self.taken.append(update)

    def close(self, summary, best):
        if "close" in self._failing:
            raise OSError("no space left on device")
        self.best = best


def update(states: int) -> Update:
    track = np.zeros(states, TRACK)
    return Update(track, track[:0], track[:0], track[:0], None)


def test_a_sink_that_fails_is_set_aside_and_tried_again(monkeypatch, caplog):
    monkeypatch.setattr(supervision, "WAITS_S", (0.0, 1e9))
    sink = Remembering(failing=(1, 3))
    guarded = GuardedSink(sink)
    running = []
    for states in (1, 2, 3, 4):
        guarded.take(update(states))
        running.append(guarded.health().running)
    assert running == [False, True, False, False]
    assert [len(each.track) for each in sink.taken] == [2]
    assert (guarded.health().failures, guarded.missed) == (2, 1 + 3 + 4)
    assert caplog.records[0].getMessage().startswith("remembering failed: OSError: no space left on device")
    assert "remembering works again; it missed 1 states" in caplog.text


def test_a_sink_that_cannot_be_ended_is_not_whole(caplog):
    guarded = GuardedSink(Remembering(failing=("close",)))
    guarded.close({}, np.zeros(0, TRACK))
    assert not guarded.health().running
    assert "remembering could not be ended: OSError" in caplog.text


def test_a_sink_that_was_set_aside_is_whole_again_once_it_is_ended(monkeypatch):
    guarded = GuardedSink(Remembering(failing=(1,)))
    guarded.take(update(1))
    guarded.close({}, np.zeros(0, TRACK))
    assert guarded.health().running


class Failing:
    """An estimator that raises at its nth step; for the rest the real one."""

    def __init__(self, make, steps: list[int]):
        self._real, self._steps = make(), steps

    def step(self, rows):
        self._steps[0] -= 1
        if self._steps[0] == 0:
            raise np.linalg.LinAlgError("not positive definite")
        return self._real.step(rows)

    def __getattr__(self, name):
        return getattr(self._real, name)


def shots(seconds: float) -> np.ndarray:
    """POLAR of a target that passes by, 20 a second."""
    t_s = np.arange(0.0, seconds, 0.05)
    rows = np.zeros(len(t_s), POLAR)
    for name in POLAR.names[2:]:
        rows[name] = np.nan
    rows["t_ns"] = rows["arrival_ns"] = T0_NS + np.round(t_s * 1e9).astype(np.int64)
    rows["range_m"], rows["azimuth_deg"], rows["elevation_deg"] = 900.0 + 10.0 * t_s, 30.0 + t_s, 12.0
    return rows


def fly(session: Session) -> dict:
    measured = shots(12.0)
    for k in range(0, len(measured), 5):
        part = measured[k : k + 5]
        session.enter(session.intake.polar("theo", part))
        session.advance(int(part["t_ns"][-1]))
    return session.finish({})


def failing_session(sink, steps: int, *, supervised: bool) -> Session:
    session = Session(STATION, FRAME, [sink])
    make = partial(methods.make, "default", session.sensors)
    session.estimator = Relay(partial(Failing, make, [steps]))
    if supervised:
        session.supervise()
    return session


def test_an_estimator_that_fails_begins_anew_and_every_value_has_a_verdict():
    sink = Remembering()
    summary = fly(failing_session(sink, 24, supervised=True))
    counts = summary["verdicts"]["theo"]
    assert {channel: sum(c.values()) for channel, c in counts.items()} == dict.fromkeys(counts, 240)
    assert summary["estimator"]["failures"] == 1
    retired = np.concatenate([each.retired for each in sink.taken])
    texts = {
        text
        for each in sink.taken
        for text, verdict in zip(each.ledger.reason_texts(each.retired), each.retired["verdict"], strict=True)
        if verdict == VERDICTS.index("invalid")
    }
    assert "the estimator failed here and began anew" in texts
    assert retired["final"].all()
    track = np.concatenate([each.track for each in sink.taken])
    assert set(track["reset_counter"].tolist()) == {0, 1}
    assert (np.diff(track["t_ns"]) > 0).all()
    assert set(sink.best["reset_counter"].tolist()) == {0, 1}  # before and after it
    assert (np.diff(sink.best["t_ns"]) > 0).all()


@pytest.mark.parametrize("forgiving", [True, False])
def test_what_fails_at_rest_is_a_failure_of_the_next_step(monkeypatch, forgiving):
    session = Session(STATION, FRAME, [Remembering()])
    rest, calls = FixedLagSmoother.rest, []

    def failing(self, upto_ns):
        calls.append(upto_ns)
        if len(calls) == 24:
            raise np.linalg.LinAlgError("not positive definite")
        rest(self, upto_ns)

    monkeypatch.setattr(FixedLagSmoother, "rest", failing)
    session.estimator.forgiving = forgiving
    if forgiving:
        summary = fly(session)
        assert summary["estimator"]["failures"] == 1
        counts = summary["verdicts"]["theo"]
        assert {channel: sum(c.values()) for channel, c in counts.items()} == dict.fromkeys(counts, 240)
    else:
        with pytest.raises(np.linalg.LinAlgError):
            fly(session)


def test_a_replay_ends_at_the_failure():
    with pytest.raises(np.linalg.LinAlgError):
        fly(failing_session(Remembering(), 24, supervised=False))


class Blind(Failing):
    """An estimator that from its nth step on has no state."""

    def step(self, rows):
        self._steps[0] -= 1
        step = self._real.step(rows)
        return step if self._steps[0] > 0 else step._replace(track=step.track[:0])


def test_measurements_without_a_state_are_a_failure_told_once():
    sink = Remembering()
    session = Session(STATION, FRAME, [sink])
    make = partial(methods.make, "default", session.sensors)
    session.estimator = Relay(partial(Blind, make, [24]))
    fly(session)
    failed = [each for each in sink.taken if each.failed]
    last_ns = max(int(each.track["t_ns"].max(initial=0)) for each in sink.taken)
    [at_ns] = [int(each.judged["t_ns"].max()) for each in failed]
    assert 1.0 <= (at_ns - last_ns) / 1e9 < 1.5
