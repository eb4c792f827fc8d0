"""The first seconds of the sample flight as a station takes them live: turns of what has arrived."""

from pathlib import Path

import numpy as np

from gcs.contract import config
from gcs.contract.frames import Frame, origin_frame
from gcs.contract.messages import AIR, INS, POLAR, AirData, Bad, InsMeasurement, PolarMeasurement
from gcs.station.sources import live, replay

SAMPLE = Path(__file__).resolve().parents[3] / "logs" / "sample"
FEEDS = {name: SAMPLE / f"{name}.csv" for name in ("theo-north", "theo-east", "radar-1")}
TURN_NS, DELAY_NS = 10_000_000, 30_000_000
ABOUT = {"software": "gcs", "version": "1", "method": "default", "correction": "off"}

Turns = list[tuple[int, list[tuple[str, object]]]]


def station() -> tuple[config.Station, Frame]:
    loaded = config.load(SAMPLE / "station.toml")
    return loaded, origin_frame(loaded)


def turns(seconds: float, begin_s: float = 20.0) -> Turns:
    """(now, what arrived) of each turn; a damaged line, a stranger and a repeated message are among them."""
    flight = replay.load(SAMPLE / "flight.tlog", config.load(SAMPLE / "station.toml"), FEEDS)
    begin_ns = flight.start_ns + round(begin_s * 1e9)
    end_ns = begin_ns + round(seconds * 1e9)
    sources = {"ins": (flight.ins, INS, InsMeasurement), "air": (flight.air, AIR, AirData)}
    sources |= {name: (rows, POLAR, PolarMeasurement) for name, (rows, _) in flight.feeds.items()}
    due: list[tuple[int, str, object]] = []
    for late_ms, (name, (rows, dtype, kind)) in enumerate(sources.items()):
        for row in rows[(rows["t_ns"] >= begin_ns) & (rows["t_ns"] < end_ns)].tolist():
            fields = {key: value for key, value in zip(dtype.names, row, strict=True) if value == value}
            fields |= {key: bool(fields[key]) for key in ("dead_reckoned", "coordinated") if key in fields}
            arrival_ns = fields["t_ns"] + DELAY_NS + late_ms * 7_000_000
            due.append((arrival_ns, name, kind(**fields | {"arrival_ns": arrival_ns})))
    due.append((begin_ns + 10**9, "radar-1", Bad(source="radar-1", where="udp", reason="torn line")))
    due.append((begin_ns + 10**9, "stranger", Bad(source="stranger", where="udp", reason="who is it?")))
    due.sort(key=lambda item: item[0])
    due.append(due[-1])
    edges = np.arange(begin_ns, due[-1][0] + TURN_NS, TURN_NS).tolist()
    at = np.searchsorted([item[0] for item in due], edges, side="right").tolist()
    return [
        (now_ns, [(name, message) for _, name, message in due[first:last]])
        for now_ns, first, last in zip(edges, [0, *at], at, strict=False)
    ]


def fly(session, taken: Turns, keep) -> dict:
    """As ``live.run`` does, without a bus."""
    arrivals = live.Arrivals(session.ledger.sensors, session.intake.station.filter.lateness_s)
    for now_ns, arrived in taken:
        keep(now_ns, arrived)
        live.turn(session, arrivals, arrived, now_ns)
    return live.finish(session, arrivals, {"complete": True})
