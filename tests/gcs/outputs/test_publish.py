"""What goes out: ages as of the state itself, smoothed to the end of the flight, a failure that says so."""

import numpy as np

from filters.models.rows import TRACK
from gcs.contract.frames import Frame
from gcs.contract.messages import CHANNELS, VERDICTS, State
from gcs.outputs.publish import FAILED, Publisher
from gcs.station.health import Files, Monitor
from gcs.station.ledger import ENTRY, Ledger
from gcs.station.session import Update

S = 10**9
FRAME = Frame(-35.36, 149.16, 584.0)


class Sent:
    """A target that keeps what it is given."""

    def __init__(self):
        self.messages = []

    def __call__(self, subject, message, source):
        self.messages.append((subject, message))

    def states(self, subject: str) -> list[State]:
        return [message for name, message in self.messages if name == subject]


def track(*t_s: float) -> np.ndarray:
    rows = np.zeros(len(t_s), TRACK)
    rows["t_ns"], rows["quality"] = [round(t * 1e9) for t in t_s], 90
    rows["P"] = np.eye(9)
    return rows


def update(*t_s: float, smoothed=(), failed=False) -> Update:
    judged = np.zeros(len(t_s), ENTRY)
    judged["t_ns"], judged["measurement"] = track(*t_s)["t_ns"], np.arange(len(t_s)) + 100 * round(sum(t_s))
    judged["channel"], judged["verdict"], judged["count"] = CHANNELS.index("range"), VERDICTS.index("used"), 1
    ledger = Ledger(["radar"], ("",))
    return Update(track(*t_s), track(*smoothed), judged, judged[:0], ledger, failed=failed)


def publisher() -> tuple[Publisher, Sent]:
    sent = Sent()
    return Publisher(FRAME, Monitor(["radar"], Files()), [sent]), sent


def test_ages_are_as_of_the_state():
    sink, sent = publisher()
    sink.take(update(1.0))
    sink.take(update(2.0, 3.0))
    assert [state.age_s for state in sent.states("state")] == [{"radar": 0.0}] * 3


def test_smoothed_goes_on_to_the_end_of_the_flight():
    sink, sent = publisher()
    sink.take(update(1.0, 2.0, 3.0, smoothed=(1.0,)))
    sink.close({}, track(1.0, 2.0, 3.0))
    smoothed = sent.states("smoothed")
    assert [(state.seq, state.t_ns) for state in smoothed] == [(0, S), (1, 2 * S), (2, 3 * S)]
    assert sent.messages[-1][1].text == "end of data"


def test_a_failure_is_the_last_state_with_quality_minus_one():
    sink, sent = publisher()
    sink.take(update(1.0))
    sink.take(update(failed=True))
    sink.take(update(3.0))
    states = sent.states("state")
    assert [(s.seq, s.t_ns, s.quality) for s in states] == [(0, S, 90), (1, S, FAILED), (2, 3 * S, 90)]
    assert any("no state" in message.text for subject, message in sent.messages if subject == "event")


def test_a_failure_before_any_state_sends_none():
    sink, sent = publisher()
    sink.take(update(failed=True))
    assert sent.states("state") == []
