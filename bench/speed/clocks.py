"""One source that lies about time, live and in replay: what it costs, and when it is back.

    python -m bench clocks                               the sample flight
    python -m bench clocks FLIGHT.tlog TRUTH.csv.gz      a recorded one, its feeds simulated from the truth

``error``  RMS of the newest position while the source lies, over that of the same flight with it silent then
``after``  the same in the ten seconds after it tells the truth again
``back``   seconds until a value of it is used again; ``events``: what an operator is told, live

Live means ``live.turn`` with made arrivals, 20 ms and an exponential 5 ms after the true instant: the whole
station but its sockets. In a replay nobody knows when a row arrived.
"""

import itertools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from bench.speed import replay as recorded
from bridges import feed, simulated
from gcs.contract import config
from gcs.contract.config import Station
from gcs.contract.messages import VERDICTS, AirData, Event, InsMeasurement
from gcs.station.ledger import NO_TIME
from gcs.station.session import Session, Update
from gcs.station.sources import live, replay
from gcs.station.sources.replay import MeasuredFlight

S = 1_000_000_000
TURN_NS = 10_000_000
DELAY_S, JITTER_S = 0.02, 0.005
AFTER_S = 10.0
Lie = Callable[[np.ndarray], np.ndarray]  # seconds since it began → seconds that the stamp is ahead
LIES: dict[str, Lie] = {
    "+2 s": lambda t: np.full_like(t, 2.0),
    "+10 s": lambda t: np.full_like(t, 10.0),
    "-10 s": lambda t: np.full_like(t, -10.0),
    "+1 h": lambda t: np.full_like(t, 3600.0),
    "-1 h": lambda t: np.full_like(t, -3600.0),
    "+1 year": lambda t: np.full_like(t, 365.25 * 86400.0),
    "-1024 weeks": lambda t: np.full_like(t, -1024 * 7 * 86400.0),
    "drift 1 %": lambda t: 0.01 * t,
    "drift -1 %": lambda t: -0.01 * t,
    "back and forth": lambda t: np.where(np.floor(t / 3.0) % 2 == 0, 2.0, -2.0),
}


class FlownAndSeen(NamedTuple):
    """A flight as measured, and its truth."""

    station: Station
    flight: MeasuredFlight
    true_ns: np.ndarray  # (n,)
    true_m: np.ndarray  # (n, 3) station ENU


class Span(NamedTuple):
    """When who lies, flight time in ns."""

    liar: str
    begin_ns: int
    end_ns: int


class Figures(NamedTuple):
    """What a lie did."""

    error: float
    after: float
    back_s: float
    events: list[str]


class Watch:
    """A sink that keeps the causal track, the events, and when each source was last unused and used."""

    def __init__(self) -> None:
        self.tracks: list[np.ndarray] = []
        self.events: list[str] = []
        self.used: dict[str, list[np.ndarray]] = {}

    def take(self, update: Update) -> None:
        self.tracks.append(update.track)
        self.events += [one.text for one in update.told if isinstance(one, Event)]
        done = update.retired
        good = done[(done["verdict"] <= VERDICTS.index("deweighted")) & (done["t_ns"] != NO_TIME)]
        for index in np.unique(good["sensor"]).tolist():
            name = update.ledger.sensors[index]
            self.used.setdefault(name, []).append(good["t_ns"][good["sensor"] == index])

    def close(self, summary: dict, best: np.ndarray) -> None: ...

    def rms_m(self, flown: FlownAndSeen, begin_ns: int, end_ns: int) -> float:
        track = np.concatenate(self.tracks)
        at = track[(track["t_ns"] >= begin_ns) & (track["t_ns"] < end_ns)]
        true = [np.interp(at["t_ns"], flown.true_ns, column) for column in flown.true_m.T]
        return float(np.sqrt(np.mean(np.sum((at["x"][:, :3] - np.column_stack(true)) ** 2, axis=1))))

    def back_s(self, span: Span) -> float:
        """From the end of the lie to the first value used after it."""
        used = np.concatenate(self.used.get(span.liar, [np.empty(0, np.int64)]))
        later = used[used >= span.end_ns]
        return float((later.min() - span.end_ns) / S) if len(later) else np.inf


def sample() -> FlownAndSeen:
    """The flight that comes with the package."""
    feeds = {name: recorded.SAMPLE / f"{name}.csv" for name in recorded.NAMES}
    station = config.load(recorded.SAMPLE / "station.toml")
    flight = replay.load(recorded.SAMPLE / "flight.tlog", station, feeds)
    return _flown(station, flight, simulated.read_truth(recorded.SAMPLE / "truth.csv"))


def from_log(log: Path, truth: Path) -> FlownAndSeen:
    """A recorded flight with feeds simulated from its truth, outliers and all."""
    station = config.load(recorded.SAMPLE / "station.toml", [recorded.vehicle_of(log)])
    with tempfile.TemporaryDirectory() as folder:
        flight = replay.load(log, station, recorded.make_feeds(log, truth, Path(folder), clean=False))
    return _flown(station, flight, simulated.read_truth(truth, simulated.boot_to_utc_ns(log)))


def _flown(station: Station, flight: MeasuredFlight, truth: np.ndarray) -> FlownAndSeen:
    true_m = flight.frame.to_enu(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    return FlownAndSeen(replay.heard(station, flight.feeds), flight, truth["t_ns"], true_m)


def cut(flown: FlownAndSeen, begin_s: float, seconds: float) -> FlownAndSeen:
    """Some seconds of a flight, from ``begin_s`` after its start."""
    flight = flown.flight
    begin_ns = flight.start_ns + round(begin_s * S)
    end_ns = begin_ns + round(seconds * S)

    def within(rows: np.ndarray) -> np.ndarray:
        return rows[(rows["t_ns"] >= begin_ns) & (rows["t_ns"] < end_ns)]

    feeds = {name: (within(rows), []) for name, (rows, _) in flight.feeds.items()}
    own = within(flight.ins), within(flight.air)
    return flown._replace(flight=flight._replace(
        ins=own[0], air=own[1], feeds=feeds, start_ns=begin_ns, end_ns=end_ns
    ))  # fmt: skip


def without(flown: FlownAndSeen, span: Span) -> FlownAndSeen:
    """The same flight with this source silent while it would lie."""
    flight = flown.flight

    def silent(rows: np.ndarray) -> np.ndarray:
        return rows[(rows["t_ns"] < span.begin_ns) | (rows["t_ns"] >= span.end_ns)]

    if span.liar == "ins":
        return flown._replace(flight=flight._replace(ins=silent(flight.ins), air=silent(flight.air)))
    feeds = flight.feeds | {span.liar: (silent(flight.feeds[span.liar][0]), [])}
    return flown._replace(flight=flight._replace(feeds=feeds))


def lying(flown: FlownAndSeen, span: Span, lie: Lie) -> FlownAndSeen:
    """The flight with the stamps of one source off, as it would have been recorded."""
    flight = flown.flight

    def off(rows: np.ndarray) -> np.ndarray:
        rows = rows.copy()
        now = (rows["t_ns"] >= span.begin_ns) & (rows["t_ns"] < span.end_ns)
        ahead_s = lie((rows["t_ns"][now] - span.begin_ns) / S)
        rows["t_ns"][now] += np.rint(ahead_s * S).astype(np.int64)
        return rows

    if span.liar == "ins":
        return flown._replace(flight=flight._replace(ins=off(flight.ins), air=off(flight.air)))
    rows, bads = flight.feeds[span.liar]
    return flown._replace(flight=flight._replace(feeds=flight.feeds | {span.liar: (off(rows), bads)}))


def run_replay(flown: FlownAndSeen) -> Watch:
    """All of it through a session, as after a flight."""
    watch = Watch()
    session = Session(flown.station, flown.flight.frame, [watch])
    whole, events = replay.batch_and_events(flown.flight, session.intake)
    session.enter(whole)
    session.enter_air(flown.flight.air)
    session.advance(flown.flight.end_ns, events)
    session.finish({})
    return watch


def run_live(flown: FlownAndSeen, true: FlownAndSeen, station_s: float = 0.0) -> Watch:
    """Turn by turn, each measurement when its true instant has passed; the station's clock off by some s."""
    watch = Watch()
    session = Session(flown.station, flown.flight.frame, [watch])
    feeds = live.Arrivals(session.ledger.sensors, flown.station.filter.lateness_s)
    due, seed = [], np.random.default_rng(3)
    for name, rows, when in _sources(flown, true):
        late_s = DELAY_S + seed.exponential(JITTER_S, len(rows))
        arrival = np.maximum.accumulate(when["t_ns"] + np.rint(late_s * S).astype(np.int64))
        due += [(t, name, m) for t, m in zip(arrival.tolist(), _messages(name, rows), strict=True)]
    due.sort(key=lambda item: item[0])
    turns = np.arange(due[0][0], due[-1][0] + 2 * S, TURN_NS)
    ends = np.searchsorted([item[0] for item in due], turns, side="right")
    for begin, end, now_ns in zip([0, *ends], ends, turns.tolist(), strict=False):
        live.turn(session, feeds, [item[1:] for item in due[begin:end]], now_ns + round(station_s * S))
    live.finish(session, feeds, {})
    return watch


def _sources(flown: FlownAndSeen, true: FlownAndSeen) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """(name, rows as stamped, the same as they truly were) of each source that speaks."""
    if len(flown.flight.ins):
        yield "ins", flown.flight.ins, true.flight.ins
        yield "air", flown.flight.air, true.flight.air
    for name, (rows, _) in flown.flight.feeds.items():
        yield name, rows, true.flight.feeds[name][0]


def _messages(name: str, rows: np.ndarray) -> Iterator[msgspec.Struct]:
    kind = {"ins": InsMeasurement, "air": AirData}.get(name)
    if kind is None:
        yield from feed.measurements(rows)
        return
    flags = {"dead_reckoned", "coordinated"}
    for row in rows.tolist():
        named = zip(rows.dtype.names or (), row, strict=True)
        yield kind(**{n: bool(v) if n in flags else v for n, v in named if v == v})


def tell(flown: FlownAndSeen, span: Span, ours: Watch, theirs: Watch) -> Figures:
    """One lie, one way: its figures, beside ``theirs``, the same without the liar."""
    later = span.end_ns, min(span.end_ns + round(AFTER_S * S), flown.flight.end_ns)
    ratios = [
        ours.rms_m(flown, *when) / theirs.rms_m(flown, *when) if when[1] > when[0] + S else np.nan
        for when in ((span.begin_ns, span.end_ns), later)
    ]
    return Figures(*ratios, ours.back_s(span), ours.events)


def run(log: Path | None, truth: Path | None, liars: Sequence[str], seconds: float) -> None:
    """The table: every lie of every liar, live and in replay, for a third of the time; then to the end."""
    flown = from_log(log, truth) if log and truth else sample()
    flown = cut(flown, 30.0, seconds)
    begin_ns, end_ns = flown.flight.start_ns, flown.flight.end_ns
    third = (end_ns - begin_ns) // 3
    spans = {"a while": (begin_ns + third, begin_ns + 2 * third), "all along": (begin_ns, end_ns)}
    print(f"{'liar':<12}{'lie':<16}{'how long':<12}{'':<8}{'error':>7}{'after':>7}{'back s':>8}  events")
    for liar in liars or ("ins", *flown.flight.feeds):
        for (long, when), way in itertools.product(spans.items(), ("live", "replay")):
            span = Span(liar, *when)
            silent = without(flown, span)
            theirs = run_live(silent, silent) if way == "live" else run_replay(silent)
            for name, lie in LIES.items():
                lied = lying(flown, span, lie)
                ours = run_live(lied, flown) if way == "live" else run_replay(lied)
                got = tell(flown, span, ours, theirs)
                said = sum(text.startswith(liar) for text in got.events)
                figures = f"{got.error:7.2f}{got.after:7.2f}{got.back_s:8.2f}  {said}"
                print(f"{liar:<12}{name:<16}{long:<12}{way:<8}{figures}", flush=True)
