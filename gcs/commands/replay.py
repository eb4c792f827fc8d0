"""``gcs replay``: a recorded flight through the session, into a run folder."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gcs.commands.compose import new_session, open_bus, open_view, targets
from gcs.commands.options import Config, Correction, Feeds, Method, StationFile, on_signal, speed_of, writable
from gcs.contract import config as configuration
from gcs.contract.messages import InputError
from gcs.learning.network import correction_of
from gcs.outputs.console import say
from gcs.outputs.record import stamp
from gcs.station import replay as driver
from gcs.station.health import Files
from gcs.station.session import Session


def command(
    flight: Annotated[Path | None, Parameter(help="the log; left out: the feeds alone")] = None,
    *,
    station: StationFile = None,
    feed: Feeds = (),
    speed: Annotated[str, Parameter(help="times real time, such as 1 or 10, or max")] = "max",
    out: Annotated[Path | None, Parameter(help="run folder; logs/runs/<start of flight> by default")] = None,
    view: Annotated[
        bool, Parameter(negative="", help="show it in the browser, with playback controls")
    ] = False,
    publish: Annotated[bool, Parameter(negative="", help="publish the cleaned state on the bus")] = False,
    method: Method = "default",
    correction: Correction = "off",
    config: Config = (),
) -> None:
    """After the flight: a tlog, ground-sensor feeds or both in, trajectory and verdicts out."""
    pace = speed_of(speed)
    resolved, learned = configuration.load(station, config), correction_of(correction)
    if out:
        writable(out)
    loaded = driver.load(flight, resolved, _feed_paths(feed))
    folder = writable(out or Path("logs/runs") / stamp(loaded.start_ns))
    heard = driver.heard(resolved, loaded.feeds)
    playback = driver.Playback(loaded.start_ns, loaded.end_ns, pace)
    with ExitStack() as stack:
        bus = stack.enter_context(open_bus(resolved)) if publish else None
        shown = open_view(resolved, loaded.frame, playback) if view else None
        if shown:
            stack.callback(shown.close)
            say(f"view: {shown.url}   (Ctrl-C ends)")

        def session() -> Session:
            if shown:
                shown.clear()
            return new_session(heard, loaded.frame, folder, method, targets(bus, shown), Files(), learned)

        on_signal(playback.stop)
        summary = driver.run(loaded, session, playback, stay=view)
    say(f"run folder: {folder}   (a page to sign: gcs report {folder})")
    if not summary["complete"] and not view:
        say("stopped before the end of the flight")
        sys.exit(1)


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
