"""``gcs replay``: a recorded flight through the session, into a run folder."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gcs.commands.compose import new_session, open_bus, open_view, targets
from gcs.commands.options import Config, Correction, Feeds, StationFile, on_signal
from gcs.contract import config as configuration
from gcs.contract.messages import InputError
from gcs.learning.network import correction_of
from gcs.outputs.console import say
from gcs.outputs.record import stamp
from gcs.station import replay as driver
from gcs.station.health import Files
from gcs.station.session import Session


def command(
    flight: Path,
    *,
    station: StationFile = None,
    feed: Feeds = (),
    speed: Annotated[str, Parameter(help="times real time, such as 1 or 10, or max")] = "max",
    out: Annotated[Path | None, Parameter(help="run folder; logs/runs/<start of flight> by default")] = None,
    view: Annotated[
        bool, Parameter(negative="", help="show it in the browser, with playback controls")
    ] = False,
    publish: Annotated[bool, Parameter(negative="", help="publish the cleaned state on the bus")] = False,
    method: Annotated[str, Parameter(help="named estimator")] = "default",
    correction: Correction = "off",
    config: Config = (),
) -> None:
    """After the flight: a tlog and ground-sensor feeds in, trajectory and verdicts out."""
    resolved, learned = configuration.load(station, config), correction_of(correction)
    loaded = driver.load(flight, resolved, _feed_paths(feed))
    folder = out or Path("logs/runs") / stamp(loaded.start_ns)
    playback = driver.Playback(loaded.start_ns, loaded.end_ns, _speed(speed))
    with ExitStack() as stack:
        bus = stack.enter_context(open_bus(resolved)) if publish else None
        shown = open_view(resolved, loaded.frame, playback) if view else None
        if shown:
            stack.callback(shown.close)
            say(f"view: {shown.url}   (Ctrl-C ends)")

        def session() -> Session:
            if shown:
                shown.clear()
            return new_session(resolved, loaded.frame, folder, method, targets(bus, shown), Files(), learned)

        on_signal(playback.stop)
        summary = driver.run(loaded, session, playback, stay=view)
    say(f"run folder: {folder}")
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


def _speed(text: str) -> float:
    try:
        speed = float("inf") if text == "max" else float(text)
    except ValueError:
        speed = 0.0
    if not speed > 0:
        raise InputError(f"--speed {text}: expected a positive number, or max")
    return speed
