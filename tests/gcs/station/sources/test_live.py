"""Live over Zenoh against the replay of the same data: the same flight, every state once and in order."""

import json
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from bridges import feed
from filters.models.rows import TRACK
from gcs.contract import config
from gcs.contract.messages import INS, InsMeasurement, PolarMeasurement
from gcs.contract.wire.bus import Bus
from gcs.outputs.publish import Publisher
from gcs.outputs.record import Record
from gcs.station.health import Monitor
from gcs.station.session import Session
from gcs.station.sources import live, replay
from tests.ports import free_port

pytestmark = [pytest.mark.network, pytest.mark.slow]

SAMPLE = Path(__file__).resolve().parents[4] / "logs" / "sample"
FEEDS = {name: SAMPLE / f"{name}.csv" for name in ("theo-north", "theo-east", "radar-1")}
SECONDS, SPEED = 12.0, 2.0  # of the flight, from before take-off


@pytest.fixture
def station():
    port = free_port()
    return config.load(SAMPLE / "station.toml", [f"bus.endpoint=tcp/127.0.0.1:{port}"])


@pytest.fixture
def flight(station):
    """The first seconds of the sample flight, every row stamped as it comes."""
    whole = replay.load(SAMPLE / "flight.tlog", station, FEEDS)
    end_ns = whole.start_ns + round(SECONDS * 1e9)
    feeds = {
        name: (rows[(rows["t_ns"] >= whole.start_ns) & (rows["t_ns"] < end_ns)], [])
        for name, (rows, _) in whole.feeds.items()
    }
    return whole._replace(ins=whole.ins[whole.ins["t_ns"] < end_ns], feeds=feeds, end_ns=end_ns)


class Best:
    """A sink that keeps the best estimate and the causal track."""

    def __init__(self):
        self.track, self.smoothed = [], np.zeros(0, TRACK)

    def take(self, update):
        self.track.append(update.track)

    def close(self, summary, best):
        self.smoothed = best


def timelines(flight) -> dict[str, list]:
    """What each bridge publishes, due at its own time."""
    ins = np.sort(flight.ins, order="t_ns")
    names = INS.names
    own = [
        InsMeasurement(**{n: v for n, v in zip(names, row, strict=True) if v == v and n != "dead_reckoned"})
        for row in ins.tolist()
    ]
    told = {"ins": [(message.t_ns, "ins", message) for message in own]}
    return told | {name: feed.timeline(name, rows, bad) for name, (rows, bad) in flight.feeds.items()}


def play_live(station, flight, folder) -> tuple[Best, list, dict]:
    """Bridges, station and subscriber, each with a Zenoh session of its own."""
    best, stop = Best(), threading.Event()
    endpoint = station.bus.endpoint
    with Bus.open("demo", "uav1", endpoint=endpoint) as bus:
        names = ["ins", *FEEDS]
        feeds = live.BusFeeds(bus, names, station.filter.lateness_s)
        publisher = Publisher(flight.frame, Monitor(names, feeds), [bus.publish])
        session = Session(station, flight.frame, [best, publisher, Record(folder, station, flight.frame)])
        session.estimator.warm_up()
        server = threading.Thread(target=live.run, args=(session, feeds, stop))
        with Bus.open("demo", "uav1", mode="client", endpoint=endpoint) as watcher:
            states = watcher.subscribe("state")
            server.start()
            time.sleep(live.SETTLE_S)
            clients = [Bus.open("demo", "uav1", mode="client", endpoint=endpoint) for _ in names]
            told = timelines(flight)
            players = [
                threading.Thread(
                    target=feed.play,
                    args=(client, told[name], stop),
                    kwargs={"speed": SPEED, "begin_ns": flight.start_ns},
                )
                for name, client in zip(names, clients, strict=True)
            ]
            for player in players:
                player.start()
            for player in players:
                player.join()
            for client in clients:
                client.close()
            time.sleep(1.0)
            while feeds.queue_age_s() > 0.0:  # what still waits at the end is refused
                time.sleep(0.1)
            stop.set()
            server.join()
            received = [message for _, message in states.drain(1.0)]
    return best, received, json.loads((folder / "summary.json").read_text())


def test_live_is_the_replay(station, flight, tmp_path):
    seen = Best()
    session = Session(station, flight.frame, [seen])
    session.enter(replay.batch(flight, session.intake))
    session.finish({})
    best, states, summary = play_live(station, flight, tmp_path)

    assert [state.seq for state in states] == list(range(len(states)))
    assert len(states) == sum(len(part) for part in best.track)
    causes = ("on_the_way", "undecodable", "second_publisher", "queue_full", "over_limit", "not_taken_in")
    assert summary["bus"] == dict.fromkeys(causes, 0)
    kinds = (InsMeasurement, PolarMeasurement)
    put = sum(isinstance(item[2], kinds) for told in timelines(flight).values() for item in told)
    assert put == session.ledger._measurements
    assert summary["verdicts"] == session.ledger.count_table()
    np.testing.assert_array_equal(best.smoothed["t_ns"], seen.smoothed["t_ns"])
    np.testing.assert_allclose(best.smoothed["x"][:, :3], seen.smoothed["x"][:, :3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(best.smoothed["x"], seen.smoothed["x"], rtol=0, atol=1e-8)
