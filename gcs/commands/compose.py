"""Puts the sinks of one run together: the record, the bus, the view, the terminal."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filters.correction.correction import off
from gcs.commands.compiled import prepare
from gcs.contract.config import Station
from gcs.contract.frames import Frame, scene
from gcs.outputs.console import Console
from gcs.outputs.diary import Diary
from gcs.outputs.publish import Publisher, Target
from gcs.outputs.record import Record
from gcs.station.health import Feeds, Files, Monitor
from gcs.station.replay import Playback
from gcs.station.session import Session, Sink

if TYPE_CHECKING:
    from gcs.contract.bus import Bus
    from web.view import View


def open_bus(station: Station, **options: Any) -> "Bus":
    """The station's bus, as its file says."""
    from gcs.contract.bus import Bus  # zenoh is not needed by a replay into files
    from gcs.contract.messages import JSON, MSGPACK

    media = MSGPACK if station.bus.media == "msgpack" else JSON
    names = station.range.name, station.vehicle.name
    return Bus.open(
        *names, **{"mode": station.bus.mode, "endpoint": station.bus.endpoint, "media": media} | options
    )


def open_view(station: Station, frame: Frame, playback: Playback | None = None) -> "View":
    """The view in the browser, on the station's port."""
    from web.view import View  # viser is not needed without a view

    return View(scene(station, frame), port=station.view.port, playback=playback)


def targets(bus: "Bus | None" = None, view: "View | None" = None) -> list[Target]:
    """Where messages go: the bus as they are, the view with its own names."""
    found: list[Target] = []
    if bus:
        found.append(bus.publish)
    if view:
        found.append(lambda subject, message, source: view.put(message, source or subject))
    return found


def new_session(
    station: Station,
    frame: Frame,
    out: Path,
    method: str,
    send_to: Sequence[Target],
    feeds: Feeds,
    correction: Callable = off,
) -> Session:
    """A session with its sinks, compiled and ready for the first measurement."""
    names = ["ins", *(sensor.name for sensor in station.sensor)]
    sinks: list[Sink] = [Record(out, station, frame), Diary(out, Monitor(names, Files())), Console()]
    if send_to:
        sinks.append(Publisher(frame, Monitor(names, feeds), send_to))
    prepare()
    session = Session(station, frame, sinks, method, correction)
    session.estimator.warm_up()
    return session
