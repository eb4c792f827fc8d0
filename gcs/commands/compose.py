"""Puts the sinks of one run together: the record, the bus, the view, the terminal."""

import json
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from filters.correction.correction import off
from filters.models.store import InMemory, Keep
from gcs.commands.compiled import prepare
from gcs.contract import messages
from gcs.contract.config import Station
from gcs.contract.frames import Frame, scene
from gcs.contract.messages import Event, InputError
from gcs.outputs.console import Console, say
from gcs.outputs.disk import Tell, to_operator
from gcs.outputs.publish import Publisher, Target
from gcs.station.health import Monitor
from gcs.station.session import Session, Sink
from gcs.station.sources.playback import Playback

if TYPE_CHECKING:
    from gcs.contract.wire.bus import Bus
    from web.memory.other import Geodetic
    from web.memory.site import GroundPicture
    from web.view import View


def open_bus(station: Station, **options: Any) -> "Bus":
    """The station's bus, as its file says."""
    from gcs.contract.messages import JSON, MSGPACK
    from gcs.contract.wire.bus import Bus  # zenoh is not needed by a replay into files

    media = MSGPACK if station.bus.media == "msgpack" else JSON
    names = station.range.name, station.vehicle.name
    said = station.bus
    settings: dict[str, Any] = {"mode": said.mode, "endpoint": said.endpoint, "media": media}
    return Bus.open(*names, **settings | {"tls": said.tls, "rates_hz": said.rates_hz} | options)


def until_stopped(stop: threading.Event) -> Callable[[str], bool]:
    """For a client of the bus: it waits for a router until ``stop``, and says so once."""
    waiting = list[str]()

    def again(line: str) -> bool:
        if not waiting:
            say(f"{line}; waiting for it")
            waiting.append(line)
        return not stop.is_set()

    return again


def introduce(bus: "Bus", station: Station, frame: Frame) -> None:
    """Tell whoever follows on the bus, now or later, what stands still and what the messages are like."""
    still = scene(station, frame)
    bus.publish("scene", still)
    bus.serve("scene", lambda: messages.encode(still))
    bus.serve("schema", lambda: (json.dumps(messages.schema()).encode(), messages.JSON))


def open_view(
    station: Station, frame: Frame, playback: Playback | None = None, other: "Geodetic | None" = None
) -> "View":
    """The view in the browser, on the station's port; ``other`` is a course to lay beside the flight."""
    from web.view import View  # viser is not needed without a view

    said = station.view
    still, ground = scene(station, frame), ground_picture(station)
    return View(still, port=said.port, playback=playback, origins=said.origins, other=other, ground=ground)


def ground_picture(station: Station) -> "GroundPicture | None":
    """The picture of the ground that the station file names. Raises ``InputError``, one line."""
    from web.memory import site

    return site.read(Path(station.view.ground)) if station.view.ground else None


def other_course(path: Path, flight: Path | None = None) -> "Geodetic":
    """For the page to lay beside the flight: a run's best estimate, or a truth file's places.

    Read as ``gcs compare`` reads its second one. Raises ``InputError``, one line.
    ``flight`` is the flight's log, for truth files that have boot time.
    """
    from web.memory.other import Geodetic

    if path.is_dir():
        from gcs.report.basis import run

        rows, name = run.load(path).smoothed, path.resolve().name
    else:
        from bridges import simulated

        name = path.name
        try:
            rows = simulated.read_truth(path)
        except InputError as error:
            if "TimeUS is boot time" in str(error) and flight is None:
                line = f"{path}:1: TimeUS is boot time; give a truth file with t_ns, or a run folder"
                raise InputError(line) from None
            if flight is None or flight.suffix != ".tlog":
                raise
            rows = simulated.read_truth(path, simulated.boot_to_utc_ns(flight))
    if not len(rows):
        raise InputError(f"{path}: not one place; name a run folder or a truth file")
    rows = rows[np.argsort(rows["t_ns"], kind="stable")]
    return Geodetic(name, *(rows[column].copy() for column in ("t_ns", "lat_deg", "lon_deg", "alt_m")))


def targets(bus: "Bus | None" = None, view: "View | None" = None) -> list[Target]:
    """Where messages go: the bus as they are, the view with its own names."""
    found: list[Target] = []
    if bus:
        found.append(bus.publish)
    if view:
        found.append(lambda subject, message, source: view.put(message, source or subject))
    return found


def announcer(send_to: Sequence[Target]) -> Tell:
    """Tells the operator: on the terminal and, as an event, wherever messages go."""

    def tell(level: str, text: str) -> None:
        to_operator(level, text)
        for target in send_to:
            target("event", Event(t_ns=time.time_ns(), level=level, text=text), "")

    return tell


def new_session(
    station: Station,
    frame: Frame,
    records: Sequence[Sink],
    method: str,
    send_to: Sequence[Target],
    monitor: Monitor,
    correction: Callable = off,
    keep: Keep = InMemory,
) -> Session:
    """A session with its sinks, compiled and ready for the first measurement; ``keep`` as `Session`'s."""
    publishers = [Publisher(frame, monitor, send_to)] if send_to else []
    sinks: list[Sink] = [*publishers, *records, Console()]  # who waits for a state does not wait for files
    prepare()
    session = Session(station, frame, sinks, method, correction, keep)
    session.estimator.warm_up()
    return session
