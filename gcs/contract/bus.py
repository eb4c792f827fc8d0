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
from collections import deque
from collections.abc import Callable

import msgspec
import zenoh
from zenoh import ext

from gcs.contract.config import BusSection, TlsSection
from gcs.contract.messages import ANY, JSON, Bad, InputError, decode, encode
from gcs.contract.tls import shown

ENDPOINT = BusSection().endpoint
KEEP = 2_000  # samples each key keeps for late joiners and recovery: 20 s at 100 Hz
HEARTBEAT_S = 0.2  # a publisher tells its last number this often, so that a lost last sample is noticed
LEASE_MS = 2_000  # a peer that says nothing for so long is gone: hung processes show within about 2 s
STALL_US = 1_000_000  # a reader that takes nothing for so long is cut off, so that it cannot hold the station
BLOCK = zenoh.CongestionControl.BLOCK  # the default drops samples of a burst
RETRY_S = 0.25  # between attempts to reach a router that is not there
RETURN_S = 3 * RETRY_S  # a new router waits so long for the clients of the one before, who hold its history
NOT_OURS = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)  # all that decoding strange bytes raises


class BusError(InputError):
    """The bus cannot be used; one line that says why and what to do."""


class Subscription:
    """A bounded queue of samples: the newest ``capacity`` wait here until drained, older ones are counted."""

    def __init__(self, capacity: int):
        self.dropped = 0  # messages lost because the queue was full
        self.undecodable = 0  # payloads that are none of ours
        self.missed = 0  # messages lost on the way and no longer kept by their publisher
        self._queue: deque[tuple[float, zenoh.Sample]] = deque(maxlen=capacity)
        self._early: list[zenoh.Sample] | None = []  # live samples that wait for the history
        self._newest: dict[tuple, int] = {}  # last sample number taken from each publisher
        self._filled = threading.Condition()

    @property
    def age_s(self) -> float:
        """How long the oldest queued message has waited, for health only (monotonic clock)."""
        with self._filled:
            return time.monotonic() - self._queue[0][0] if self._queue else 0.0

    def drain(self, timeout_s: float = 0.1) -> list[tuple[str, ANY]]:
        """All queued ``(source, message)`` in arrival order; waits at most ``timeout_s`` for the first.

        A payload on ``raw/*`` that is none of ours comes out as ``Bad``, so that it gets its verdict;
        on other keys it is only counted.
        """
        with self._filled:
            self._filled.wait_for(lambda: self._queue, timeout_s)
            samples = list(self._queue)
            self._queue.clear()
        return [pair for _, sample in samples if (pair := self._decode(sample))]

    def _push(self, sample: zenoh.Sample) -> None:
        # Zenoh's thread: a slow callback would stall every key of the session, so nothing else happens here.
        with self._filled:
            if self._early is None:
                self._take(sample)
            else:
                self._early.append(sample)

    def _begin(self, history: list[zenoh.Sample]) -> None:
        with self._filled:
            for sample in history + (self._early or []):
                self._take(sample)
            self._early = None

    def _take(self, sample: zenoh.Sample) -> None:
        if info := sample.source_info:  # a plain publisher's samples have none
            publisher = info.source_id.zid, info.source_id.eid
            if info.source_sn <= self._newest.get(publisher, -1):
                return  # came with the history
            self._newest[publisher] = info.source_sn
        self.dropped += len(self._queue) == self._queue.maxlen
        self._queue.append((time.monotonic(), sample))
        self._filled.notify()

    def _count_miss(self, miss: ext.Miss) -> None:
        self.missed += miss.nb

    def _decode(self, sample: zenoh.Sample) -> tuple[str, ANY] | None:
        key, payload = str(sample.key_expr), sample.payload.to_bytes()
        _, _, subject, source = (key + "/").split("/")[:4]
        try:
            return source, decode(payload, str(sample.encoding))
        except NOT_OURS as error:
            self.undecodable += 1
            if subject != "raw":
                return None
            clipped = payload[:200].decode(errors="replace")
            return source, Bad(source=source, where=key, reason=str(error), raw=clipped)


class Bus:
    """One Zenoh session for one vehicle. Use it in a ``with``: left open, it hangs the interpreter's exit."""

    def __init__(self, session: zenoh.Session, prefix: str, media: str, settled_s: float):
        self._session, self._prefix, self._media, self._settled_s = session, prefix, media, settled_s
        self._publishers: dict[str, ext.AdvancedPublisher] = {}
        self._alive: set[str] = set()
        self._held: list[object] = [
            session.liveliness().declare_subscriber(f"{prefix}/alive/*", self._on_liveliness, history=True)
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
        tls: TlsSection | None = None,
        waiting: Callable[[str], None] | None = None,
    ) -> "Bus":
        """Join the bus.

        ``mode`` "router" listens on ``endpoint`` and carries everybody's messages; "client" and "peer"
        connect to it. (Peers joined only by a router do not hear one another: bridges are clients.)
        Without a router there, a client calls ``waiting`` once with a line for the operator and tries
        until one comes; ``waiting=None`` raises instead. Once joined, a client returns by itself.

        Raises ``BusError``: bad name or endpoint, endpoint taken, no router.
        """
        prefix = f"{_name(range_name)}/{_name(vehicle)}"
        config = _config(mode, endpoint, tls)
        while True:
            try:
                settled_s = time.monotonic() + (RETURN_S if mode == "router" else 0.0)
                return cls(zenoh.open(config), prefix, media, settled_s)
            except zenoh.ZError as error:
                line = _explain(mode, endpoint, error)
                if waiting is None or mode == "router":
                    raise BusError(line) from error
            waiting(line)
            waiting = _say_nothing
            time.sleep(RETRY_S)

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
        subscription = Subscription(capacity)
        for key in (f"{self._prefix}/{subject}" for subject in subjects):
            subscriber = ext.declare_advanced_subscriber(
                self._session,
                key,
                subscription._push,
                recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
            )
            self._held += [subscriber, subscriber.sample_miss_listener(subscription._count_miss)]
        subscription._begin([s for subject in subjects for s in self._history(f"{self._prefix}/{subject}")])
        return subscription

    def _history(self, key: str) -> list[zenoh.Sample]:
        # The advanced subscriber's own history option loses the older part whenever a live sample comes
        # while it is being fetched (zenoh 1.10: every third late joiner at 20 Hz). This is the same query.
        return [reply.ok for reply in self._ask(f"{key}/@adv/pub/**") if reply.ok]

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

    def declare_alive(self, source: str) -> None:
        """Hold the liveliness token of ``source`` until this bus closes or its process dies."""
        key = f"{self._prefix}/alive/{_name(source)}"
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

        self._held.append(self._session.declare_queryable(key, answer))

    def _declare_publisher(self, key: str) -> ext.AdvancedPublisher:
        for name in key.split("/"):
            _name(name)
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


def _name(name: str) -> str:
    if not re.fullmatch(r"[a-z0-9-]+", name):
        raise BusError(f"'{name}' cannot be part of a key: use lower-case letters, digits and '-'")
    return name


def _say_nothing(_line: str) -> None:
    pass


def _config(mode: str, endpoint: str, tls: TlsSection | None) -> zenoh.Config:
    listens, retry_ms = mode == "router", int(RETRY_S * 1e3)
    settings = shown(tls, listens=listens) | {
        "mode": mode,
        "listen/endpoints": [endpoint] if listens else [],
        "connect/endpoints": [] if listens else [endpoint],
        "connect/timeout_ms": retry_ms,
        "connect/exit_on_failure": True,
        "connect/retry": {"period_init_ms": retry_ms, "period_max_ms": retry_ms, "period_increase_factor": 1},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
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
        return f"no Zenoh router at {endpoint}: start the station (gcs run) or set [bus] endpoint"
    if "in use" in str(error):
        return f"{endpoint} is in use: stop the other station or set [bus] endpoint to a free port"
    reason = str(error).split(" at /")[0].rsplit(": ", 1)[-1]
    return f"cannot listen on {endpoint}: {reason}; set [bus] endpoint"
