"""``gcs replay``: a recorded flight through the session, into a run folder."""

import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from cyclopts import Parameter

from gcs.commands.compose import (
    announcer,
    introduce,
    new_session,
    open_bus,
    open_view,
    other_course,
    targets,
)
from gcs.commands.options import (
    Config,
    Correction,
    Feeds,
    Method,
    Overlay,
    StationFile,
    known_method,
    on_signal,
    run_folder,
    speed_of,
    writable,
)
from gcs.contract import config as configuration
from gcs.contract.frames import Frame, origin_frame
from gcs.contract.messages import InputError
from gcs.learning.network import correction_of
from gcs.outputs.console import say
from gcs.outputs.diary import Diary
from gcs.outputs.disk import to_operator
from gcs.outputs.record import Record, stamp
from gcs.station.health import Files, Monitor
from gcs.station.scratch import Scratch
from gcs.station.session import Session, Sink
from gcs.station.sources import replay as driver
from gcs.station.sources.playback import Playback
from gcs.station.sources.recording import RECORDING, STATION, Recording


def command(
    flight: Annotated[
        Path | None, Parameter(help="tlog, or run.mcap of a live run; left out: the feeds alone")
    ] = None,
    *,
    station: StationFile = None,
    feed: Feeds = (),
    speed: Annotated[str, Parameter(help="times real time, such as 1 or 10, or max")] = "max",
    out: Annotated[Path | None, Parameter(help="run folder; logs/runs/<start of flight> by default")] = None,
    view: Annotated[
        bool, Parameter(negative="", help="show it in the browser, with playback controls")
    ] = False,
    overlay: Overlay = None,
    publish: Annotated[bool, Parameter(negative="", help="publish the cleaned state on the bus")] = False,
    method: Method | None = None,
    correction: Correction = "off",
    config: Config = (),
) -> None:
    """After the flight: a tlog and ground-sensor feeds, or a recording, in; trajectory and verdicts out."""
    pace = speed_of(speed)
    learned = correction_of(correction)
    if out:
        writable(out)
    if overlay and not view:
        raise InputError(f"--overlay {overlay}: it is drawn on the page; add --view")
    other = other_course(overlay, flight) if overlay else None
    loaded, heard, frame, recorded = _flight(flight, station, _feed_paths(feed), config)
    if recorded.get("correction", "off") != "off" and correction == "off":
        say(f"{flight}: flown with a correction network; --correction FILE gives the same result again")
    estimator = known_method(method or recorded.get("method", "default"))
    folder = run_folder(out or Path("logs/runs") / stamp(loaded.start_ns))
    playback = Playback(loaded.start_ns, loaded.end_ns, loaded.times_ns, pace)
    records: list[Record] = []
    with ExitStack() as stack:
        scratch = stack.enter_context(Scratch(folder, to_operator))
        bus = stack.enter_context(open_bus(heard)) if publish else None
        if bus:
            introduce(bus, heard, frame)
        shown = open_view(heard, frame, playback, other) if view else None
        if shown:
            stack.callback(shown.close)
            say(f"view: {shown.url}   (Ctrl-C ends)")

        def session() -> Session:
            if shown:
                shown.clear()
            send_to = targets(bus, shown)
            records.append(Record(folder, heard, frame, announcer(send_to)))
            monitor = Monitor(heard.sources, Files())
            kept: list[Sink] = [Diary(folder, monitor, records[-1].missing), records[-1]]
            return new_session(heard, frame, kept, estimator, send_to, monitor, learned, scratch.keep)

        on_signal(playback.stop)
        summary = driver.run(loaded, session, playback, stay=view)
    say(f"run folder: {folder}   (a page to sign: gcs report {folder})")
    if not summary["complete"] and not view:
        say("stopped before the end of the flight")
        sys.exit(1)
    if records[-1].missing:
        sys.exit(1)  # the record has told what is missing


def _flight(
    path: Path | None, station: Path | None, feeds: dict[str, Path], config: tuple[str, ...]
) -> tuple[driver.Replayable, configuration.Station, Frame, dict[str, str]]:
    """The flight, its station and frame, and what a recording says of itself."""
    if path is None or path.suffix != Path(RECORDING).suffix:
        given = configuration.load(station, config)
        measured = driver.load(path, given, feeds)
        return measured, driver.heard(given, measured.feeds), measured.frame, {}
    if feeds:
        raise InputError(f"--feed {next(iter(feeds))}: {path} holds its feeds already; leave --feed out")
    recording = Recording(path)
    with TemporaryDirectory() as folder:
        own = Path(folder, STATION)
        own.write_text(recording.station_text, encoding="utf-8")
        live = configuration.load(station or own, config)
    return recording, live, origin_frame(live), recording.settings


def _feed_paths(feeds: tuple[str, ...]) -> dict[str, Path]:
    paths = {}
    for item in feeds:
        name, equals, path = item.partition("=")
        if not equals or not path:
            raise InputError(f"--feed {item}: expected NAME=FILE.csv")
        if name in paths:
            raise InputError(f"--feed {item}: {name} already has a feed")
        paths[name] = Path(path)
    return paths
