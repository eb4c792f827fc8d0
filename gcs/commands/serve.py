"""The station live: bus, MAVLink link, session, record and view, opened and closed together."""

import json
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from filters.correction.correction import off
from gcs.commands.compose import new_session, open_bus, open_view, targets
from gcs.commands.options import seconds_of, writable
from gcs.contract import messages
from gcs.contract.config import Station
from gcs.contract.frames import Frame, scene
from gcs.contract.messages import InputError
from gcs.outputs.console import say
from gcs.outputs.record import stamp
from gcs.station import live


class Worker(threading.Thread):
    """Runs ``work`` beside the session; what it raises ends the station and is raised again by ``done``."""

    def __init__(self, work: Callable[[], None], stop: threading.Event):
        super().__init__(daemon=True)
        self._work, self._stop_all = work, stop
        self._error: InputError | None = None

    def run(self) -> None:
        try:
            self._work()
        except InputError as error:
            self._error = error
            self._stop_all.set()

    def done(self) -> None:
        self.join()
        if self._error:
            raise self._error


def serve(
    station: Station,
    out: Path | None,
    stop: threading.Event,
    *,
    view: bool,
    method: str = "default",
    seconds: float | None = None,
    beside: Callable[[ExitStack], threading.Event] | None = None,
    correction: Callable = off,
) -> None:
    """Run until ``stop``, or for ``seconds`` from when the station is ready.

    ``beside`` is called when the station is ready: the demo starts its feeds there, and returns an event that
    says when they are over.
    """
    if station.range.origin is None:
        raise InputError("live operation needs [range] origin in the station file: every frame hangs on it")
    seconds = seconds_of(seconds)
    frame = Frame(*(getattr(station.range.origin, name) for name in ("lat_deg", "lon_deg", "alt_m")))
    folder = writable(out or Path("logs/runs") / stamp(time.time_ns()))
    with ExitStack() as stack:
        bus = stack.enter_context(open_bus(station))
        shown = open_view(station, frame) if view else None
        if shown:
            stack.callback(shown.close)
        say("compiling the filter (once; cached for the next start)")
        feeds = live.BusFeeds(bus)
        session = new_session(station, frame, folder, method, targets(bus, shown), feeds, correction)
        still = scene(station, frame)
        bus.publish("scene", still)
        bus.serve("scene", lambda: messages.encode(still))
        bus.serve("schema", lambda: (json.dumps(messages.schema()).encode(), messages.JSON))
        if station.mavlink.link:
            worker = Worker(lambda: _mavlink(station, bus, stop), stop)
            worker.start()
            stack.callback(worker.done)
            stack.callback(stop.set)
        say(f"bus: {station.bus.endpoint}   keys: {station.range.name}/{station.vehicle.name}/…")
        if shown:
            say(f"view: {shown.url}   (Ctrl-C ends)")
        over = beside(stack) if beside else stop
        if seconds is not None:  # from here, so that reading the demo's flight takes none of them
            timer = threading.Timer(seconds, stop.set)
            timer.daemon = True
            timer.start()
        live.run(session, feeds, over)
        if shown and not stop.is_set():
            say("the flight is over; the view stays until Ctrl-C")
            stop.wait()
    say(f"run folder: {folder}   (a page to sign: gcs report {folder})")


def _mavlink(station: Station, bus, stop: threading.Event) -> None:
    from bridges.mavlink import mavlink

    mavlink.run(station.mavlink.link, station.vehicle.system_id, bus, stop)
