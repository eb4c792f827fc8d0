"""The station live: bus, MAVLink link, session, record and view, opened and closed together."""

import gc
import logging
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filters.correction.correction import off
from gcs import __version__
from gcs.commands.compose import introduce, new_session, open_bus, open_view, targets, until_stopped
from gcs.commands.options import run_folder, seconds_of
from gcs.contract import messages
from gcs.contract.config import Station
from gcs.contract.frames import origin_frame
from gcs.contract.messages import Event
from gcs.contract.supervision import Backoff, Supervisor, brief, log
from gcs.outputs import log as logbook
from gcs.outputs.console import say
from gcs.outputs.diary import Diary
from gcs.outputs.outbox import Outbox
from gcs.outputs.publish import Target
from gcs.outputs.record import stamp
from gcs.outputs.recording import RunRecorder
from gcs.outputs.terminal import unhindered
from gcs.station.health import Monitor
from gcs.station.scratch import Scratch
from gcs.station.session import Session, Sink
from gcs.station.sources import live

if TYPE_CHECKING:
    from gcs.contract.wire.bus import Bus

SWITCH_S = 0.0001  # of threads: with Python's 5 ms a state waits so long for the thread that sends it
LAST_TRIES = 20  # failures of the loop without a minute's work between them: nothing can go on


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
    frame = origin_frame(station)
    seconds = seconds_of(seconds)
    folder = run_folder(out or Path("logs/runs") / stamp(time.time_ns()))
    with ExitStack() as stack:
        stack.enter_context(unhindered())
        bus = stack.enter_context(open_bus(station, waiting=until_stopped(stop)))
        shown = open_view(station, frame) if view else None
        if shown:
            stack.callback(shown.close)
        outbox, finished = Outbox(bus.publish), threading.Event()
        send_to: list[Target] = [outbox, *targets(view=shown)]
        events = [partial(_send_event, target) for target in send_to]
        stack.enter_context(logbook.opened(folder, events))
        supervisor = stack.enter_context(Supervisor(stop))
        supervisor.start("publisher", outbox.run, finished)
        stack.callback(finished.set)  # after the session's last word
        say("compiling the filter (once; cached for the next start)")
        feeds = live.BusFeeds(bus, station.sources, station.filter.lateness_s)
        about = _about(method, correction)
        recorder = RunRecorder(folder, station, frame, _log, about, feeds.incoming.waiting)
        stack.callback(recorder.end)
        everyone = [*send_to, _note, recorder.target]
        monitor = Monitor(station.sources, feeds, supervisor.health)
        diary = Diary(folder, monitor, recorder.missing, recorder.note, recorder.put)
        keep = stack.enter_context(Scratch(folder, recorder.note)).keep
        records: list[Sink] = [diary, recorder]
        session = new_session(station, frame, records, method, everyone, monitor, correction, keep)
        supervisor.others = session.supervise()
        introduce(bus, station, frame)
        if station.mavlink.link:
            supervisor.start("mavlink", partial(_mavlink, station, Link(bus), recorder.link))
        say(f"bus: {station.bus.endpoint}   keys: {station.range.name}/{station.vehicle.name}/…")
        if shown:
            supervisor.adopt(shown.part)
            say(f"view: {shown.url}   (Ctrl-C ends)")
        over = beside(stack) if beside else stop
        if seconds is not None:  # from here, so that reading the demo's flight takes none of them
            _end_after(seconds, stop)
        _be_prompt()
        with supervisor.watched("session", over) as pulse:
            _run(session, feeds, pulse, recorder.turn)
        if shown and not stop.is_set():
            say("the flight is over; the view stays until Ctrl-C")
            stop.wait()
    _take_leave(folder, supervisor)


def _about(method: str, correction: Callable) -> dict[str, str]:
    """What the recording says of itself."""
    learned = "off" if correction is off else "on"
    return {"software": "gcs", "version": __version__, "method": method, "correction": learned}


def _take_leave(folder: Path, supervisor: Supervisor) -> None:
    """The last words: where the run is, and what is not whole."""
    say(f"run folder: {folder}   (a page to sign: gcs report {folder})")
    missed = [sink.name for sink in supervisor.others if not sink.health().running]
    if missed:
        sys.exit(f"gcs: {', '.join(missed)} failed and is not whole; see {folder / 'station.log'}")


def _end_after(seconds: float, stop: threading.Event) -> None:
    timer = threading.Timer(seconds, stop.set)
    timer.daemon = True
    timer.start()


def _be_prompt() -> None:
    """Have the interpreter not hold up a state."""
    sys.setswitchinterval(SWITCH_S)
    gc.collect()
    gc.freeze()  # what is loaded by now stays: else each full collection walks through all of it, 0.1 s


def _run(session: Session, feeds: live.BusFeeds, stop: threading.Event, keep: live.Keep) -> None:
    """The loop; what fails in it costs that turn's messages, not the flight."""
    again = Backoff()
    while True:
        again.begin()
        try:
            live.run(session, feeds, stop, keep)
            return
        except Exception as error:  # whatever it is: the flight goes on
            wait_s = again.fail()
            if again.in_a_row > LAST_TRIES:
                raise
            log.exception(
                "session failed: %s; goes on in %g s, failure %d", brief(error), wait_s, again.failures
            )
            stop.wait(wait_s)


class Link:
    """The bus for a bridge in this process: what it tells goes where all that the station tells goes."""

    def __init__(self, bus: "Bus"):
        self._bus, self.declare_alive = bus, bus.declare_alive

    def publish(self, subject: str, message: messages.ANY, source: str = "") -> None:
        if isinstance(message, Event):
            _log(message.level, message.text)
        else:
            self._bus.publish(subject, message, source)


def _mavlink(station: Station, bus: Any, keep: Callable[[int, bytes], None], stop: threading.Event) -> None:
    from bridges.mavlink import mavlink

    mavlink.run(station.mavlink.link, station.vehicle.system_id, bus, stop, keep)


def _log(level: str, text: str) -> None:
    log.log(logbook.LEVELS.get(level, logging.WARNING), "%s", text)


def _send_event(target: Target, event: Event) -> None:
    target("event", event, "")


def _note(subject: str, message: messages.ANY, source: str) -> None:
    """A target of the publisher: its events go into the log as well."""
    if isinstance(message, Event):
        logbook.note(message)
