"""The live MAVLink link of a vehicle: listens, never speaks.

A heartbeat from a ground station arms an autopilot's failsafe, so nothing is ever sent: no heartbeat, no
request. The autopilot or its router must stream by itself. The one exception is ``udpout:``, where the other
end only learns who listens from a datagram of ours: an empty one, once a second until the vehicle is heard.
"""

import socket
import time
from collections.abc import Callable
from contextlib import closing
from threading import Event as Flag
from typing import TYPE_CHECKING

from bridges.mavlink.decoder import Decoder
from gcs.contract.messages import AirData, Bad, Event, InputError, InsMeasurement
from gcs.contract.steady import now_ns

if TYPE_CHECKING:  # a bridge is given its bus; zenoh is loaded by whoever opens it
    from gcs.contract.wire.bus import Bus

RETRY_S = 1.0  # between two attempts to open a link that was there
SILENT_S = 5.0  # a link without the vehicle for so long is reported
POLL_S = 0.1
KNOCK_S = 1.0


Keep = Callable[[int, bytes], None]


class LinkError(InputError):
    """A link that cannot be used. The message names it and what to do."""


def run(link: str, system_id: int | None, bus: "Bus", stop: Flag, keep: Keep | None = None) -> None:
    """Publish ``raw/ins`` and ``raw/air`` from ``link`` (any pymavlink address) until ``stop`` is set.

    ``keep`` is given every good frame of every system on the link, with its arrival in ns.

    Without a ``system_id`` it is the first autopilot heard.

    A link that is lost is opened again and again; losing and finding it are published as events.
    Raises LinkError where the address cannot be used at all.
    """
    _check(link)
    bus.declare_alive("ins")
    decoder, lost = Decoder(system_id, link), False
    while not stop.is_set():
        try:
            with closing(_open(link)) as port:
                _tell(bus, "info", f"{link}: listening for vehicle {system_id or '(any)'}")
                lost = False
                _listen(port, decoder, bus, stop, keep)
        except OSError as error:
            if not lost:
                _tell(bus, "warning", f"{link}: {error.strerror or error}; trying again every {RETRY_S:g} s")
            lost = True
            stop.wait(RETRY_S)
    _publish(bus, decoder.flush())


def _listen(port, decoder: Decoder, bus, stop: Flag, keep: Keep | None) -> None:
    heard, silent, knocked, readable = time.monotonic(), False, -KNOCK_S, False
    knock, stream = decoder.link.startswith("udpout:"), decoder.link.startswith("tcp:")
    while not stop.is_set():
        now = time.monotonic()
        if knock and now - knocked >= KNOCK_S:
            port.write(b"")
            knocked = now
        before = port.mav.total_bytes_received
        message = port.recv_msg()
        if message is None:
            if stream and readable and port.mav.total_bytes_received == before:
                raise ConnectionResetError(0, "closed by the other end")
            if now - heard > SILENT_S and not silent:
                silent = True
                _tell(bus, "warning", f"{decoder.link}: nothing from vehicle {decoder.system_id}")
            readable = port.select(POLL_S)
            continue
        readable = False
        arrival_ns = now_ns()
        if keep and message.get_type() != "BAD_DATA":
            keep(arrival_ns, bytes(message.get_msgbuf()))
        _publish(bus, decoder.decode(message, arrival_ns))
        while decoder.told:
            _tell(bus, *decoder.told.pop(0))
        if message.get_srcSystem() == decoder.system_id:
            heard, knock = now, False
            if silent:
                silent = False
                _tell(bus, "info", f"{decoder.link}: vehicle {decoder.system_id} is back")


def _publish(bus, measurements: list[InsMeasurement | AirData | Bad]) -> None:
    for measurement in measurements:
        bus.publish("raw", measurement, "air" if isinstance(measurement, AirData) else "ins")


def _tell(bus, level: str, text: str) -> None:
    bus.publish("event", Event(t_ns=now_ns(), level=level, text=text))


def _check(link: str) -> None:
    """Raise LinkError for an address pymavlink would not refuse clearly."""
    kind, _, rest = link.partition(":")
    if kind not in ("udpin", "udpout", "tcp", "tcpin"):
        return  # a serial port, whose own error says enough
    host, _, port = rest.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise LinkError(f"{link}: give {kind}:HOST:PORT, as in {kind}:127.0.0.1:14550")
    if kind == "udpin":
        # pymavlink binds with SO_REUSEADDR, which would quietly share the port with another listener
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
            try:
                probe.bind((host, int(port)))
            except (OSError, TypeError, ValueError) as error:  # a name that cannot be resolved too
                why = getattr(error, "strerror", None) or error
                raise LinkError(
                    f"{link}: {why}; another ground station may be listening: choose another port"
                ) from None


def _open(link: str):
    """A pymavlink connection that parses MAVLink 1 and 2 and never answers."""
    from pymavlink import mavutil  # sets os.environ when imported

    return mavutil.mavlink_connection(link, retries=1)
