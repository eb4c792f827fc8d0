"""Live: measurements come from the bus, through the same session, and the cleaned state goes back onto it."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from gcs.contract import messages
from gcs.contract.messages import ANY, AirData, Bad, Event, InsMeasurement, PolarMeasurement
from gcs.station.session import Session
from gcs.station.sources.clocks import FAULTS, FlightClock

if TYPE_CHECKING:  # a replay of a recording takes the same turns, and needs no zenoh
    from gcs.contract.wire.bus import Bus

SETTLE_S = 1.0  # a restarted station is given what the bridges kept; all of it, before the first row goes in
POLL_S = 0.01  # while a row waits for others: how often its hold can run out
IDLE_S = 0.1  # … and while none does: how often silence is looked at, and a stop
CELL_NS = 100_000_000  # of stamps: in one of them a source has twice what its rate allows, and no more
CELLS = 50  # of a source that are remembered
FIRST = (
    12  # in a cell of a source that has shown nothing yet: the fastest instruments known send 110 a second
)
CROWD = "more at once than its rate allows: refused, so that the others are judged in time"
STRANGERS = 50  # unknown names that are counted apart

Arrived = Sequence[tuple[str, ANY]]  # (source, message) in the order of arrival
Keep = Callable[[int, Arrived], None]


class Crowd:
    """How many measurements of each source there are by time: a burst costs the filter whole seconds.

    A cell takes twice what its source may send, and no more than twice what it has sent in an earlier one.
    """

    def __init__(self) -> None:
        self._taken: dict[str, dict[int, int]] = {}

    def too_many(self, name: str, t_ns: np.ndarray, rate_hz: float) -> np.ndarray:
        """(n,) bool, which of a source's measurements at (n,) ``t_ns`` are beyond what a cell takes."""
        taken, most = self._taken.setdefault(name, {}), max(2, round(2e-9 * rate_hz * CELL_NS))
        found = np.zeros(len(t_ns), bool)
        for k, cell in enumerate((t_ns // CELL_NS).tolist()):
            shown = max((count for other, count in taken.items() if other != cell), default=0)
            found[k] = taken.setdefault(cell, 0) >= min(most, max(FIRST, 2 * shown))
            taken[cell] += not found[k]
            if len(taken) > CELLS:
                del taken[next(iter(taken))]
        return found


class Arrivals:
    """What live turns remember: the flight's clock, what waits for it, and who is not known here."""

    def __init__(self, sensors: list[str], lateness_s: float):
        self.clock, self.crowd = FlightClock(sensors, lateness_s), Crowd()
        self.waiting: list[tuple[int, str, list[ANY]]] = []  # (arrival, source, messages) of past turns
        self.strangers: Counter = Counter()
        self.told: list[tuple[str, str]] = []  # (level, text) since the last turn

    def stranger(self, name: str, messages: int) -> None:
        """Count what a source has sent that the station file does not name; the first is told."""
        if len(self.strangers) >= STRANGERS and name not in self.strangers:
            name = "others"
        if name not in self.strangers:
            text = f"{name}: no sensor of that name in the station file; what it sends is counted, not used"
            self.told.append(("warning", text))
        self.strangers[name] += messages

    def events(self) -> list[Event]:
        """What an operator should know since the last call, at the flight's time."""
        told, self.told = self.told + self.clock.told, []
        self.clock.told = []
        return [Event(t_ns=self.clock.now_ns, level=level, text=text) for level, text in told]


class BusFeeds(Arrivals):
    """The measurements on the bus, and what only the bus knows of their sources."""

    def __init__(self, bus: "Bus", sensors: list[str], lateness_s: float):
        super().__init__(sensors, lateness_s)
        self._bus = bus
        self.incoming = bus.subscribe("raw/*")
        self._settled_s = time.monotonic() + SETTLE_S
        self._others, self._other = bus.claim("state", "smoothed"), set[str]()

    def events(self) -> list[Event]:
        while self.incoming.holders.told:
            self.told.append(self.incoming.holders.told.pop(0))
        for other in set(tuple(self._others)) - self._other:  # Zenoh's thread adds to it
            self._other.add(other)
            who = f"Zenoh id {other} publishes the state on this bus, too"
            self.told.append(("error", f"{who}: another station, or a forgery; end it"))
        return super().events()

    def settle_s(self) -> float:
        """How long to wait still for what was kept."""
        return max(0.0, self._settled_s - time.monotonic())

    def latency_s(self, name: str) -> float:
        return self.clock.latency_s(name)

    def alive(self, name: str) -> bool:
        """Does the source hold its liveliness token?"""
        return name in self._bus.alive()

    def queue_age_s(self) -> float:
        return self.incoming.age_s

    def idle_s(self) -> float:
        return self.incoming.idle_s


def run(
    session: Session, feeds: BusFeeds, stop: threading.Event, keep: Keep = lambda _now_ns, _arrived: None
) -> dict:
    """Serve until ``stop``; returns the summary. ``keep`` is given each turn before anything is decided."""
    stop.wait(feeds.settle_s())
    for arrival_ns, arrived in feeds.incoming.turns(stop, partial(patience_s, session, feeds)):
        keep(arrival_ns, arrived)
        turn(session, feeds, arrived, arrival_ns)
    queue = feeds.incoming
    lost = {"on_the_way": queue.missed, "undecodable": queue.undecodable}
    lost |= {"second_publisher": sum(queue.holders.refused.values())} | queue.lost
    return finish(session, feeds, {"bus": lost})


def patience_s(session: Session, feeds: Arrivals) -> float:
    """How long the next turn may wait for a message."""
    return POLL_S if feeds.waiting or len(session.align.waiting_ids) else IDLE_S


def turn(session: Session, feeds: Arrivals, arrived: Arrived, arrival_ns: int) -> None:
    """One turn: ``(source, message)`` in order of arrival, the last at ``arrival_ns``, through the session.

    A function of its arguments in their order: the same turns give the same results.
    """
    for name, pairs in groupby(sorted(arrived, key=lambda pair: pair[0]), key=lambda pair: pair[0]):
        found = [message for _, message in pairs]
        if name not in session.ledger.sensors and name != "air":
            feeds.stranger(name, len(found))
            continue
        stamps = [m.t_ns for m in found if isinstance(m, _kind(name))]
        if stamps:
            feeds.clock.hear(name, np.array(stamps), arrival_ns)
        feeds.waiting.append((arrival_ns, name, found))
    if feeds.clock.settle(arrival_ns):
        while feeds.clock.drifts:
            session.take_back(*feeds.clock.drifts.pop(0))
        _enter_waiting(session, feeds)
    session.advance(session.align.due_ns(arrival_ns), feeds.events())


def finish(session: Session, feeds: Arrivals, about: dict) -> dict:
    """The end: what still waits for a clock is entered as it is. Returns the summary."""
    _enter_waiting(session, feeds)
    return session.finish({"complete": True} | about | {"unknown_sources": dict(feeds.strangers)})


def _enter_waiting(session: Session, feeds: Arrivals) -> None:
    for arrival_ns, name, found in feeds.waiting:
        good = [message for message in found if isinstance(message, _kind(name))]
        if name == "air":
            samples = messages.to_columns(good, AirData)
            if good:
                session.enter_air(samples[feeds.clock.judge(name, samples["t_ns"], arrival_ns) == 0])
            continue
        bad = [_no_measurement(name, message) for message in found if not isinstance(message, _kind(name))]
        if bad:
            session.enter(session.intake.bad(name, bad), arrival_ns)
            session.align.pass_over(session.ledger.sensors.index(name))
        if good:
            _enter(session, name, messages.to_columns(good, _kind(name)), feeds, arrival_ns)
    feeds.waiting.clear()


def _enter(session: Session, name: str, measured: np.ndarray, feeds: Arrivals, arrival_ns: int) -> None:
    """One source's (n,) measurements into the session; those stamped wrong are complained of."""
    intake = session.intake
    batch = intake.ins(measured) if name == "ins" else intake.polar(name, measured)
    fault = feeds.clock.judge(name, measured["t_ns"], arrival_ns)[batch.entries["measurement"]]
    reasons = np.array([session.ledger.reason(text) for text in FAULTS])
    batch.complaints[fault > 0] = reasons[fault[fault > 0]]
    rates_hz = intake.station.bus.rates_hz
    crowd = feeds.crowd.too_many(name, measured["t_ns"], rates_hz.get(name, rates_hz[""]))
    crowd = crowd[batch.entries["measurement"]]
    batch.complaints[crowd] = session.ledger.reason(CROWD)
    session.enter(batch, arrival_ns)
    if crowd.any():
        session.align.pass_over(session.ledger.sensors.index(name))


def _kind(name: str) -> type[InsMeasurement | AirData | PolarMeasurement]:
    return InsMeasurement if name == "ins" else AirData if name == "air" else PolarMeasurement


def _no_measurement(name: str, message: ANY) -> Bad:
    if isinstance(message, Bad):
        return message
    return Bad(
        source=name, where=f"raw/{name}", reason=f"a {type(message).__name__} is no measurement of {name}"
    )
