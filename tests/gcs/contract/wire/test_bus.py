"""The bus with real sessions and processes on loopback; the other end is plain Zenoh where it can be."""

import contextlib
import itertools
import json
import signal
import threading
import time
from pathlib import Path

import pytest
import zenoh

from gcs.contract.messages import MSGPACK, Bad, Event, schema
from gcs.contract.wire import bus as bus_module
from gcs.contract.wire.bus import Bus, BusError
from tests.gcs.contract.ends import ROOT, client, collect, plain_zenoh, process, shot, state, until

pytestmark = pytest.mark.network

PUBLISHER = """
endpoint, count, source = sys.argv[1], int(sys.argv[2]), sys.argv[3]
again = lambda line: print(line) or True
with Bus.open("demo", "uav1", mode="client", endpoint=endpoint, waiting=again) as bus:
    bus.declare_alive(source)
    for number in range(count):
        bus.publish("raw", PolarMeasurement(t_ns=number, arrival_ns=0), source)
    print("sent")
    time.sleep(float(sys.argv[4]))
"""


def test_a_burst_from_three_processes_arrives_once_and_in_order(station, endpoint):
    subscription = station.subscribe("raw/*", capacity=100_000)
    count, sources = 20_000, ("ins", "radar", "theo-north")
    with contextlib.ExitStack() as running:
        for source in sources:
            running.enter_context(process(PUBLISHER, endpoint, str(count), source, "0"))
        got = collect(subscription, 3 * count, 60.0)
    for source in sources:
        assert [message.t_ns for name, message in got if name == source] == list(range(count))
    assert (sum(subscription.lost.values()), subscription.missed, subscription.undecodable) == (0, 0, 0)


def test_what_was_published_last_arrives_although_the_publisher_closes(endpoint):
    station = Bus.open("demo", "uav1", endpoint=endpoint)
    with plain_zenoh(endpoint) as session, client(endpoint) as reader:
        plain, got = [], reader.subscribe("state", capacity=10_000)
        session.declare_subscriber("demo/uav1/state", plain.append)
        time.sleep(0.2)
        for seq in range(5_000):
            station.publish("state", state(seq))
        station.close()
        assert [message.seq for _, message in collect(got, 5_000)] == list(range(5_000))
        assert until(lambda: len(plain) == 5_000)


def test_a_publisher_may_start_before_the_station(endpoint):
    with process(PUBLISHER, endpoint, "100", "radar", "5") as publisher:
        assert "no Zenoh router" in publisher.stdout.readline()
        with Bus.open("demo", "uav1", endpoint=endpoint) as station:
            got = collect(station.subscribe("raw/radar"), 100)
        assert [message.t_ns for _, message in got] == list(range(100))


def test_a_station_that_starts_again_gets_what_was_measured_meanwhile(endpoint):
    first = Bus.open("demo", "uav1", endpoint=endpoint)
    with client(endpoint) as publisher:
        publisher.publish("raw", shot(0), "radar")
        assert len(collect(first.subscribe("raw/*"), 1)) == 1
        first.close()
        for number in range(1, 200):
            publisher.publish("raw", shot(number), "radar")
        with Bus.open("demo", "uav1", endpoint=endpoint) as second:
            got = collect(second.subscribe("raw/*"), 200)
    assert [message.t_ns for _, message in got] == list(range(200))


def test_of_old_measurements_nothing_is_given_and_of_old_events_all(station, endpoint, monkeypatch):
    """A station that starts again would compute all of them before its first state."""
    monkeypatch.setattr(bus_module, "HISTORY_S", 0.5)
    with client(endpoint) as publisher, client(endpoint) as joiner:
        told = Event(t_ns=0, level="info", text="long ago")
        publisher.publish("event", told)
        for number in range(20):
            if number == 10:
                time.sleep(0.7)
            publisher.publish("raw", shot(number), "radar")
        got = collect(joiner.subscribe("raw/*"), 10)
        assert [message.t_ns for _, message in got] == list(range(10, 20))
        assert [message for _, message in collect(joiner.subscribe("event"), 1)] == [told]


def test_a_subscriber_recovers_what_passed_while_the_router_was_away(endpoint):
    router = Bus.open("demo", "uav1", endpoint=endpoint)
    with client(endpoint) as publisher, client(endpoint) as reader:
        subscription = reader.subscribe("state")
        publisher.publish("state", state(0))
        assert len(collect(subscription, 1)) == 1
        router.close()
        for seq in range(1, 100):
            publisher.publish("state", state(seq))
        with Bus.open("demo", "uav1", endpoint=endpoint):
            got = collect(subscription, 99)
            assert [message.seq for _, message in got] == list(range(1, 100))
            assert collect(subscription, 1, seconds=0.5) == []


def test_a_late_joiner_gets_history_once_while_messages_go_on(station, endpoint):
    with process(
        "with Bus.open('demo', 'uav1', mode='client', endpoint=sys.argv[1]) as bus:\n"
        "    for number in range(100_000):\n"
        "        bus.publish('raw', PolarMeasurement(t_ns=number, arrival_ns=0), 'radar')\n"
        "        time.sleep(0.001 * (number > 500))\n",
        endpoint,
    ):
        assert until(lambda: len(collect(station.subscribe("raw/*"), 500)) >= 500)
        for _ in range(5):
            with client(endpoint) as joiner:
                got = collect(joiner.subscribe("raw/*"), 600)
            assert [message.t_ns for _, message in got] == list(range(len(got)))


def test_alive_knows_who_is_there_and_who_was_killed(station, endpoint):
    with process(PUBLISHER, endpoint, "0", "theo-north", "60") as publisher:
        assert until(lambda: station.alive() == {"theo-north"})
        with client(endpoint) as late:
            assert until(lambda: late.alive() == {"theo-north"})
        publisher.kill()
        assert until(lambda: station.alive() == set())


def test_a_hung_publisher_is_not_alive(station, endpoint):
    with process(PUBLISHER, endpoint, "0", "theo-north", "60") as publisher:
        assert until(lambda: station.alive() == {"theo-north"})
        publisher.send_signal(signal.SIGSTOP)
        assert until(lambda: station.alive() == set(), seconds=5.0)


def test_queries_are_answered_to_plain_zenoh(station, endpoint):
    station.serve("schema", lambda: (json.dumps(schema()).encode(), "application/schema+json"))
    with plain_zenoh(endpoint) as session:
        [reply] = session.get("demo/uav1/schema")
    assert json.loads(reply.ok.payload.to_bytes()) == schema()
    assert str(reply.ok.encoding) == "application/schema+json"


@pytest.mark.parametrize("media", ["application/json", MSGPACK])
def test_the_encoding_names_the_schema(endpoint, media):
    with (
        Bus.open("demo", "uav1", endpoint=endpoint, media=media) as station,
        plain_zenoh(endpoint) as session,
    ):
        plain, ours = session.declare_subscriber("demo/uav1/*"), station.subscribe("event")
        time.sleep(0.2)
        event = Event(t_ns=1, level="info", text="start")
        station.publish("event", event)
        assert str(plain.recv().encoding) == f"{media};gcs.Event"
        assert collect(ours, 1) == [("", event)]


def test_a_full_queue_keeps_the_newest_and_counts_the_rest(station):
    subscription = station.subscribe("raw/*", capacity=10)
    for number in range(25):
        station.publish("raw", shot(number), "radar")
    assert until(lambda: subscription.lost["queue_full"] == 15)
    assert subscription.age_s > 0.0
    (source, lost), *kept = subscription.drain()
    assert (source, lost.count, lost.reason) == ("radar", 15, "faster than it can be taken in")
    assert [message.t_ns for _, message in kept] == list(range(15, 25))
    assert (subscription.age_s, subscription.drain(timeout_s=0.0)) == (0.0, [])


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\x89PNG\r\n",
        b'{"type":"Nothing"}',
        b'{"type":"Event","t_ns":1,"level":"\xff","text":""}',
        b'{"type":"Event","deep":' + b"[" * 50_000,
    ],
    ids=["empty", "png", "unknown", "utf8", "deep"],
)
def test_what_is_none_of_ours_is_counted_and_on_raw_gets_a_verdict(station, endpoint, payload):
    subscription = station.subscribe("raw/*", "state")
    with plain_zenoh(endpoint) as session:
        block = zenoh.CongestionControl.BLOCK  # by default what is not sent within a millisecond is lost
        raw, state = (
            session.declare_publisher(f"demo/uav1/{key}", congestion_control=block)
            for key in ("raw/radar", "state")
        )
        assert until(lambda: raw.matching_status.matching and state.matching_status.matching)
        raw.put(payload)
        state.put(payload)
        raw.put(b'{"type":"PolarMeasurement","t_ns":7,"arrival_ns":7}')
        assert until(lambda: subscription.waiting(0))
        [(arrival_ns, source, message)] = subscription.waiting(0)  # the other one is no message
        assert (source, message.t_ns, subscription.waiting(arrival_ns)) == ("radar", 7, [])
        assert subscription.undecodable == 0  # it is not taken
        got = collect(subscription, 2)
    assert isinstance(got[0][1], Bad)
    assert (got[0][0], got[0][1].where) == ("radar", "demo/uav1/raw/radar")
    assert got[1][1].t_ns == 7
    assert until(lambda: not subscription.drain() and subscription.undecodable == 2)


def test_a_taken_port_is_one_line(station, endpoint):
    with pytest.raises(BusError, match=rf"^{endpoint} is in use: .*\[bus\] endpoint.*$"):
        Bus.open("demo", "uav1", endpoint=endpoint)


def test_no_router_is_one_line(endpoint):
    with pytest.raises(BusError, match=rf"^no Zenoh router at {endpoint}: start the station.*$"):
        client(endpoint)


@pytest.mark.parametrize("name", ["Demo", "a b", "", "é", "a/b", "*", "uav\n"])
def test_a_name_that_breaks_keys_is_refused(endpoint, name):
    with pytest.raises(BusError, match="lower-case letters, digits and '-'"):
        Bus.open(name, "uav1", endpoint=endpoint)


@pytest.mark.parametrize(
    "options", [{"mode": "bogus"}, {"endpoint": "bogus"}, {"endpoint": "tcp/8.8.8.8:7447"}]
)
def test_a_wrong_setting_is_one_line(endpoint, options):
    with pytest.raises(BusError) as error:
        Bus.open("demo", "uav1", **{"endpoint": endpoint} | options)
    assert "bogus" in str(error.value) or "Cannot assign" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_router_listens_on_loopback_only(station, endpoint):
    port = int(endpoint.rsplit(":", 1)[1])
    listening = [
        line.split()[1]
        for table in ("/proc/net/tcp", "/proc/net/tcp6")
        for line in Path(table).read_text().splitlines()[1:]
        if int(line.split()[1].rsplit(":", 1)[1], 16) == port and line.split()[3] == "0A"
    ]
    assert listening == [f"0100007F:{port:04X}"]


def test_the_subscriber_in_the_documentation_runs(station, endpoint):
    code = (ROOT / "docs/subscriber.py").read_text().replace(bus_module.ENDPOINT, endpoint)
    numbers, printed = itertools.count(), []
    with process(code) as subscriber:
        threading.Thread(
            target=lambda: printed.extend(iter(subscriber.stdout.readline, "")), daemon=True
        ).start()
        assert until(lambda: printed or station.publish("state", state(next(numbers))))
        station.publish("state", state(1_000_000))
        assert until(lambda: printed[-1].startswith("1000000.000 s"))
    assert printed[-2].endswith("expected, 1000000 came\n")
    assert printed[-1] == (
        "1000000.000 s  -35.5000000° 149.2500000° 600.00 m  ±2.00 ±3.00 ±4.00 m  quality 87\n"
    )
