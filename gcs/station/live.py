"""Live: measurements come from the bus, through the same session, and the cleaned state goes back onto it."""

import statistics
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from gcs.contract import messages
from gcs.contract.messages import ANY, AirData, Bad, InsMeasurement, PolarMeasurement
from gcs.station.session import Session

if TYPE_CHECKING:  # a replay of a recording takes the same turns, and needs no zenoh
    from gcs.contract.bus import Bus

SETTLE_S = 1.0  # a restarted station is given what the bridges kept; all of it, before the first row goes in
POLL_S = 0.01  # how long one turn waits for the first measurement; also how often a hold can run out
ASTRAY_NS = 5_000_000_000  # a stamp this far from the flight's clock is a fault of a clock, no delay of ours
RECORDED_NS = 60_000_000_000  # stamps older than this on arrival come from a recording, not over a slow link
MEMORY = 101  # arrivals of which the median is a source's usual lag: some seconds, and odd

Arrived = Sequence[tuple[str, ANY]]  # (source, message) in the order of arrival
Keep = Callable[[int, Arrived], None]


class Arrivals:
    """What live turns remember. The flight's clock is the INS's, else that of the first source."""

    def __init__(self) -> None:
        self.strangers: Counter = Counter()  # messages of sources that the station file does not name
        self.history = True  # what comes first was kept for us, and may be as old as it likes
        self._lags_ns: dict[str, deque] = {}

    def astray(self, name: str, t_ns: np.ndarray, arrival_ns: int) -> np.ndarray:
        """Take in (n,) stamps that arrived now; returns (n,) bool, true where a stamp cannot be right."""
        lags = arrival_ns - t_ns
        if self.history:
            return lags < -ASTRAY_NS
        self._lags_ns.setdefault(name, deque(maxlen=MEMORY)).extend(lags[-MEMORY:].tolist())
        reference = "ins" if "ins" in self._lags_ns else next(iter(self._lags_ns))
        return np.abs(lags - statistics.median(self._lags_ns[reference])) > ASTRAY_NS

    def latency_s(self, name: str) -> float:
        """Median of arrival minus validity. A flight from a recording is as late as its fastest source: 0."""
        usual = {source: statistics.median(lags) for source, lags in self._lags_ns.items()}
        least = min(usual.values(), default=0)
        recorded = least if abs(least) > RECORDED_NS else 0
        return (usual.get(name, recorded) - recorded) / 1e9


class BusFeeds(Arrivals):
    """The measurements on the bus, and what only the bus knows of their sources."""

    def __init__(self, bus: "Bus"):
        super().__init__()
        self._bus = bus
        self.incoming = bus.subscribe("raw/*")

    def alive(self, name: str) -> bool:
        """Does the source hold its liveliness token?"""
        return name in self._bus.alive()

    def queue_age_s(self) -> float:
        return self.incoming.age_s


def run(
    session: Session, feeds: BusFeeds, stop: threading.Event, keep: Keep = lambda _now_ns, _arrived: None
) -> dict:
    """Serve until ``stop``; returns the summary. ``keep`` is given each turn before anything is decided."""
    stop.wait(SETTLE_S)
    while not stop.is_set():
        arrived, arrival_ns = feeds.incoming.drain(POLL_S), time.time_ns()
        keep(arrival_ns, arrived)
        turn(session, feeds, arrived, arrival_ns)
    queue = feeds.incoming
    lost = {"queue_full": queue.dropped, "on_the_way": queue.missed, "undecodable": queue.undecodable}
    return finish(session, feeds, {"complete": True, "bus": lost})


def turn(session: Session, feeds: Arrivals, arrived: Arrived, arrival_ns: int) -> None:
    """One turn: what arrived by then goes in. The same turns, as of a recording, give the same results."""
    for name, pairs in groupby(sorted(arrived, key=lambda pair: pair[0]), key=lambda pair: pair[0]):
        found = [message for _, message in pairs]
        if name in session.ledger.sensors:
            _enter(session, name, found, feeds, arrival_ns)
        elif name == "air":
            _enter_air(session, found, feeds, arrival_ns)
        else:
            feeds.strangers[name] += len(found)
    session.advance(session.align.due_ns(arrival_ns))
    feeds.history = False


def finish(session: Session, feeds: Arrivals, about: dict) -> dict:
    """The end of the turns; returns the summary."""
    return session.finish(about | {"unknown_sources": dict(feeds.strangers)})


def _enter(session: Session, name: str, found: list, feeds: Arrivals, now_ns: int) -> None:
    """One source's messages into the session; no measurement of its kind, or astray: complained of."""
    intake = session.intake
    kind = InsMeasurement if name == "ins" else PolarMeasurement
    good = [message for message in found if isinstance(message, kind)]
    bad = [_no_measurement(name, message) for message in found if not isinstance(message, kind)]
    if bad:
        session.enter(intake.bad(name, bad), now_ns)
    if good:
        measured = messages.to_columns(good, kind)
        batch = intake.ins(measured) if name == "ins" else intake.polar(name, measured)
        astray = feeds.astray(name, measured["t_ns"], now_ns)[batch.entries["measurement"]]
        batch.complaints[astray] = session.ledger.reason("stamped seconds away from the flight's clock")
        session.enter(batch, now_ns)


def _enter_air(session: Session, found: list, feeds: Arrivals, now_ns: int) -> None:
    samples = messages.to_columns([m for m in found if isinstance(m, AirData)], AirData)
    session.enter_air(samples[~feeds.astray("air", samples["t_ns"], now_ns)])


def _no_measurement(name: str, message) -> Bad:
    if isinstance(message, Bad):
        return message
    return Bad(
        source=name, where=f"raw/{name}", reason=f"a {type(message).__name__} is no measurement of {name}"
    )
