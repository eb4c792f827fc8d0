"""The command ``gcs``.

Exit codes: 0 done, 1 the run failed, 2 wrong usage or input (one line on stderr, no traceback).
"""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

from gcs import __version__, cli_bench, cli_bridge
from gcs.cli_options import Config, Correction, Feeds, StationFile, on_signal, stopped
from gcs.messages import InputError

app = App(name="gcs", version=__version__, help="Flight-test trajectory measurement: where was it really?")
app.command(cli_bridge.app)
app.command(cli_bench.app)


def main() -> None:
    """Entry point."""
    try:
        app(sys.argv[1:], exit_on_error=False, print_error=False)
    except CycloptsError as error:
        _refuse(" ".join(str(error).split()) + "; see gcs --help")
    except InputError as error:
        _refuse(str(error))
    except KeyboardInterrupt:  # before a command listens for it: while it waits for a router, say
        sys.exit(130)


@app.command
def replay(
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
    from contextlib import ExitStack

    from gcs import config as configuration
    from gcs import replay as driver
    from gcs.console import say
    from gcs.health import Files
    from gcs.network import correction_of
    from gcs.record import stamp
    from gcs.sinks import new_session, open_bus, open_view, targets

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

        def session():
            if shown:
                shown.clear()
            return new_session(resolved, loaded.frame, folder, method, targets(bus, shown), Files(), learned)

        on_signal(playback.stop)
        summary = driver.run(loaded, session, playback, stay=view)
    say(f"run folder: {folder}")
    if not summary["complete"] and not view:
        say("stopped before the end of the flight")
        sys.exit(1)


@app.command
def run(
    *,
    station: Path,
    out: Annotated[Path | None, Parameter(help="run folder; logs/runs/<now> by default")] = None,
    view: Annotated[bool, Parameter(help="show it in the browser")] = True,
    method: Annotated[str, Parameter(help="named estimator")] = "default",
    correction: Correction = "off",
    seconds: Annotated[float | None, Parameter(help="end after so long")] = None,
    config: Config = (),
) -> None:
    """Live: MAVLink and ground sensors in over the bus, cleaned state out, view, recording."""
    from gcs import config as configuration
    from gcs.network import correction_of
    from gcs.station import serve

    resolved, learned = configuration.load(station, config), correction_of(correction)
    serve(resolved, out, view, method, stopped(), seconds, correction=learned)


@app.command
def train(
    *runs: Annotated[Path, Parameter(help="run folders with a truth.csv: t_ns,lat_deg,lon_deg,alt_m")],
    out: Annotated[Path, Parameter(help="flights flown, network, report; the next start goes on from here")],
    flights: Annotated[int, Parameter(help="simulated flights beside the run folders")] = 100,
    seed: int = 0,
    compare: Annotated[int, Parameter(help="trainings each of three kinds of start, for the report")] = 0,
    install: Annotated[Path | None, Parameter(help="where a network that has earned it goes")] = None,
    config: Config = (),
) -> None:
    """Train the correction network and test it on flights it has never seen."""
    from filters.correction.train import Plan
    from gcs import config as configuration
    from gcs import train as trainer
    from gcs.console import say
    from gcs.session import settings_of

    settings = settings_of(configuration.load(None, config))
    trainer.run(out, flights, list(runs), Plan(seed=seed), settings, compare, install, say)


@app.command
def demo(
    *,
    seconds: Annotated[
        float | None, Parameter(help="end after so long; runs until stopped by default")
    ] = None,
    view: Annotated[bool, Parameter(help="show it in the browser")] = True,
    out: Annotated[Path | None, Parameter(help="run folder; logs/runs/<now> by default")] = None,
    config: Config = (),
) -> None:
    """The sample flight with theodolites and a radar, live through Zenoh, in the browser."""
    from gcs import demo as demonstration

    demonstration.run(stopped(), seconds, view, out, config)


@app.command
def screen(
    feed: Path,
    *,
    out: Annotated[Path | None, Parameter(help="folder; beside the feed by default")] = None,
    method: Annotated[str, Parameter(help="linear-adaptive, or a baseline")] = "linear-adaptive",
    threshold: Annotated[float | None, Parameter(help="sigmas of a residual; 5 by default")] = None,
) -> None:
    """One raw feed, channel by channel, without a trajectory: cleaned feed, flags and a picture."""
    from rich.table import Table

    from gcs import screen as screening
    from gcs.console import screen as terminal

    folder = feed.parent if out is None else out
    counts = screening.run(feed, folder, method, threshold)
    unreadable = counts.pop("unreadable")
    table = Table("channel", *next(iter(counts.values())), box=None, pad_edge=False)
    for channel, said in counts.items():
        table.add_row(channel, *(f"{n:.4g}" if isinstance(n, float) else f"{n:,}" for n in said.values()))
    terminal.print(table)
    terminal.print(f"{unreadable} lines unreadable; written to {folder}", soft_wrap=True, markup=False)


@app.command
def doctor(*, station: StationFile = None, config: Config = ()) -> None:
    """Check Python, packages, station file, ports, router and clock before a flight."""
    from gcs import doctor as checks

    sys.exit(0 if checks.run(station, config) else 1)


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


def _refuse(line: str) -> None:
    print(f"gcs: {line}", file=sys.stderr)
    sys.exit(2)
