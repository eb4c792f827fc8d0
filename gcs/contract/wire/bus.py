"""The bus: our messages on Zenoh keys ``{range}/{vehicle}/{subject}[/{source}]``, names of ``[a-z0-9-]``.

==========================  ==========================================================================
``raw/ins raw/theo-north``  measurements, from bridges
``state  smoothed``         the cleaned state now, and a window later
``verdict/theo-north``      what was done with each measurement, and why
``wind health event``       once a second; events when they happen
``alive/theo-north``        liveliness token of one source, no payload
``schema  scene  here``     queryables; ``here`` is answered by every bus, with nothing
==========================  ==========================================================================

Every key is written by an advanced publisher that keeps its last samples, and read by advanced subscribers
that notice a gap, ask for what is missing and deliver in order, each sample once. So a late joiner gets
history and a router may be away for seconds. A plain Zenoh subscriber reads the same keys.

The station is itself the router, on loopback: scouting is off, it listens on one endpoint. A range with
several machines points every process at one ``zenohd`` instead (mode ``client``, its endpoint).
Samples carry no Zenoh time; times are in the payload. This is the only file that knows Zenoh.
"""

import json
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import zenoh
from zenoh import ext

from gcs.contract.config import BusSection, TlsSection
from gcs.contract.messages import ANY, JSON, InputError, encode
from gcs.contract.supervision import guarded
from gcs.contract.wire.holders import Holders
from gcs.contract.wire.inbox import Inbox, Limits
from gcs.contract.wire.subscription import Sample, Subscription
from gcs.contract.wire.tls import shown

ENDPOINT = BusSection().endpoint
KEEP = 2_000  # samples each key keeps for late joiners and recovery: 20 s at 100 Hz
HISTORY_S = (
    20.0  # of measurements: longer than a station or a router is away; all of it has to be computed again
)
BURST_S = 5.0  # of its highest rate may come at once: the backlog of a source at half of it, after 10 s away
HEARTBEAT_S = 0.2  # a publisher tells its last number this often, so that a lost last sample is noticed
LEASE_MS = 2_000  # a peer that says nothing for so long is gone: hung processes show within about 2 s
STALL_US = 1_000_000  # a reader that takes nothing for so long is cut off, so that it cannot hold the station
BLOCK = zenoh.CongestionControl.BLOCK  # the default drops samples of a burst
RETRY_S = 0.25  # between attempts to reach a router that is not there
RETURN_S = 3 * RETRY_S  # a new router waits so long for the clients of the one before, who hold its history


class BusError(InputError):
    """The bus cannot be used; one line that says why and what to do."""


class Bus:
    """One Zenoh session for one vehicle. Use it in a ``with``: left open, it hangs the interpreter's exit."""

    def __init__(self, session: zenoh.Session, prefix: str, media: str, rates_hz: Mapping[str, float]):
        self._session, self._prefix, self._media, self._rates_hz = session, prefix, media, rates_hz
        self._settled_s = 0.0
        self._publishers: dict[str, ext.AdvancedPublisher] = {}
        self._declaring = threading.Lock()
        self._alive: set[str] = set()
        self._tokens: set[str] = set()
        self._held: list[object] = [
            session.liveliness().declare_subscriber(
                f"{prefix}/alive/*", guarded("liveliness", self._on_liveliness), history=True
            )
        ]
        self.serve("here", lambda: (b"", "zenoh/bytes"))

    @classmethod
    def open(
        cls,
        range_name: str,
        vehicle: str,
        *,
        mode: str = "router",
        endpoint: str = ENDPOINT,
        media: str = JSON,
        rates_hz: Mapping[str, float] = MappingProxyType({}),
        tls: TlsSection | None = None,
        waiting: Callable[[str], bool] = lambda _line: False,
    ) -> "Bus":
        """Join the bus.

        ``mode`` "router" listens on ``endpoint`` and carries everybody's messages; "client" and "peer"
        connect to it. (Peers joined only by a router do not hear one another: bridges are clients.)
        Without a router there, a client asks ``waiting``, with a line for the operator, whether to try once
        more; by default it raises instead, after 2 s. Once joined, a client returns by itself.
        ``rates_hz``: source → how many measurements a second are taken from it, "" for all others.

        Raises ``BusError``: bad name or endpoint, endpoint taken, no router.
        """
        prefix = f"{_name(range_name)}/{_name(vehicle)}"
        config = _config(mode, endpoint, tls)
        while True:
            try:
                bus = cls(zenoh.open(config), prefix, media, rates_hz)
            except zenoh.ZError as error:
                line = _explain(mode, endpoint, error)
                if mode == "router" or not waiting(line):
                    raise BusError(line) from error
            else:
                bus._settled_s = time.monotonic() + (RETURN_S if mode == "router" else 0.0)
                return bus

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Wait until the others have what was published, withdraw tokens, end the session."""
        if self._session.is_closed():
            return
        # Zenoh throws away what is still on its way when a session closes. A query travels behind it.
        self._ask(f"{self._prefix}/here")
        self._session.close()

    def publish(self, subject: str, message: ANY, source: str = "") -> None:
        """Put one message on ``subject[/source]``. Waits while readers are behind, rather than lose it."""
        payload, encoding = encode(message, self._media)
        key = f"{subject}/{source}" if source else subject
        publisher = self._publishers.get(key) or self._declare_publisher(key)
        publisher.put(payload, encoding=encoding)

    def subscribe(self, *subjects: str, capacity: int = 20_000) -> Subscription:
        """One queue fed by all ``subjects``: "state", "raw/*", "verdict/*" ...; kept samples come first."""
        time.sleep(max(0.0, self._settled_s - time.monotonic()))
        subscription = Subscription(Inbox(capacity, self._limits_of))
        push, miss = (guarded("subscription", call) for call in (subscription.push, subscription.count_miss))
        for key in (f"{self._prefix}/{subject}" for subject in subjects):
            subscriber = ext.declare_advanced_subscriber(
                self._session,
                key,
                push,
                recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
            )
            left = guarded("subscription", partial(_on_publisher, subscription.holders))
            self._held += [
                subscriber,
                subscriber.sample_miss_listener(miss),
                subscriber.detect_publishers(left, history=False),
            ]
        subscription.begin([s for subject in subjects for s in self._history(f"{self._prefix}/{subject}")])
        return subscription

    def _limits_of(self, key: str) -> Limits:
        """How much of a key is taken: of measurements, which anybody may send, no more than told."""
        *_, subject, source = key.split("/")
        if subject != "raw":
            return Limits()
        return Limits(self._rates_hz.get(source, self._rates_hz.get("", float("inf"))), BURST_S)

    def _history(self, key: str) -> list[Sample]:
        # The advanced subscriber's own history option loses the older part whenever a live sample comes
        # while it is being fetched (zenoh 1.10: every third late joiner at 20 Hz). This is the same query.
        lately = f"?_time=[now(-{HISTORY_S:g}s)..]" if key.startswith(f"{self._prefix}/raw") else ""
        return [reply.ok for reply in self._ask(f"{key}/@adv/pub/**{lately}") if reply.ok]

    def _ask(self, key: str) -> list[zenoh.Reply]:
        replies = self._session.get(
            key,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            congestion_control=BLOCK,
            timeout=LEASE_MS / 1e3,
        )
        return list(replies)

    def vehicles(self) -> set[str]:
        """The vehicles of this range whose stations answer now."""
        replies = self._ask(f"{self._prefix.split('/', 1)[0]}/*/scene")
        return {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok}

    def claim(self, *subjects: str) -> Counter[str]:
        """Watch ``subjects`` that nobody else should write; counts what others put there, by their id."""
        others: Counter[str] = Counter()

        def heard(sample: zenoh.Sample) -> None:
            others[str(sample.source_info.source_id.zid) if sample.source_info else "unknown"] += 1

        for key in (f"{self._prefix}/{subject}" for subject in subjects):
            remote = zenoh.Locality.REMOTE
            self._held.append(self._session.declare_subscriber(key, heard, allowed_origin=remote))
        return others

    def declare_alive(self, source: str) -> None:
        """Hold the liveliness token of ``source`` until this bus closes or its process dies."""
        key = f"{self._prefix}/alive/{_name(source)}"
        if key in self._tokens:
            return  # a bridge that starts again in this process
        self._tokens.add(key)
        self._held.append(self._session.liveliness().declare_token(key))

    def alive(self) -> set[str]:
        """The sources whose token is held now."""
        return set(self._alive)

    def serve(self, subject: str, reply: Callable[[], tuple[bytes, str]]) -> None:
        """Answer queries on ``subject`` with ``(payload, encoding)``; ``reply`` runs in Zenoh's thread."""
        key = f"{self._prefix}/{subject}"

        def answer(query: zenoh.Query) -> None:
            payload, encoding = reply()
            query.reply(key, payload, encoding=encoding)

        self._held.append(self._session.declare_queryable(key, guarded(f"the answer on {subject}", answer)))

    def _declare_publisher(self, key: str) -> ext.AdvancedPublisher:
        for name in key.split("/"):
            _name(name)
        with self._declaring:  # several threads publish events
            return self._publishers.get(key) or self._new_publisher(key)

    def _new_publisher(self, key: str) -> ext.AdvancedPublisher:
        self._publishers[key] = ext.declare_advanced_publisher(
            self._session,
            f"{self._prefix}/{key}",
            congestion_control=BLOCK,
            cache=ext.CacheConfig(KEEP, replies_config=ext.RepliesConfig(congestion_control=BLOCK)),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        return self._publishers[key]

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        source = str(sample.key_expr).rsplit("/", 1)[1]
        (self._alive.add if sample.kind == zenoh.SampleKind.PUT else self._alive.discard)(source)


def _on_publisher(holders: Holders, sample: zenoh.Sample) -> None:
    """Its token's key: ``KEY/@adv/pub/ZID/EID/_``."""
    if sample.kind == zenoh.SampleKind.DELETE:
        key, _, rest = str(sample.key_expr).partition("/@adv/pub/")
        zid, eid = rest.split("/")[:2]
        holders.left(key, (zid, int(eid)))


def _name(name: str) -> str:
    if not re.fullmatch(r"[a-z0-9-]+", name):
        raise BusError(f"'{name}' cannot be part of a key: use lower-case letters, digits and '-'")
    return name


def _config(mode: str, endpoint: str, tls: TlsSection | None) -> zenoh.Config:
    listens, retry_ms = mode == "router", int(RETRY_S * 1e3)
    settings = shown(tls, listens=listens) | {
        "mode": mode,
        "listen/endpoints": [endpoint] if listens else [],
        "connect/endpoints": [] if listens else [endpoint],
        "connect/timeout_ms": LEASE_MS,  # of all attempts together: on a busy machine one takes a while
        "connect/exit_on_failure": True,
        "connect/retry": {"period_init_ms": retry_ms, "period_max_ms": retry_ms, "period_increase_factor": 1},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "timestamping/enabled": True,  # of what is kept: its age is told by the clock of who keeps it
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": STALL_US,
        "transport/unicast/open_timeout": LEASE_MS,
        "transport/shared_memory/enabled": False,  # a killed process would leave segments behind
    }
    config = zenoh.Config()
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        line = f"mode '{mode}' or endpoint '{endpoint}' is none: router, client or peer, and like {ENDPOINT}"
        raise BusError(line) from error
    return config


def _explain(mode: str, endpoint: str, error: zenoh.ZError) -> str:
    if mode != "router":
        return f"no Zenoh router at {endpoint}: start the station (gcs run) or zenohd, or set [bus] endpoint"
    if "in use" in str(error):
        return f"{endpoint} is in use: stop the other station or set [bus] endpoint to a free port"
    reason = str(error).split(" at /")[0].rsplit(": ", 1)[-1]
    return f"cannot listen on {endpoint}: {reason}; set [bus] endpoint"
