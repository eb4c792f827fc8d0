"""``python -m bench``: how exact, how fast, and the papers' figures."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from gcs.contract.messages import InputError

app = App(name="python -m bench", help="Measure the estimator: how exact, how fast.")
Several = Parameter(consume_multiple=True, negative="")


@app.command
def accuracy(
    *cases: str,
    seeds: int = 50,
    first_seed: int = 10_000,
    seconds: float = 60.0,
    method: Annotated[tuple[str, ...], Several] = ("default",),
    out: Path | None = None,
) -> None:
    """Every case, or those named, over many seeds; errors as ratios to the filter told the outliers."""
    from bench import accuracy as asked

    asked.run(seeds, first_seed, seconds, cases, method, out=out)


@app.command
def speed(*, seconds: float = 3600.0, out: Path | None = None) -> None:
    """One update beside other filters, one measurement live, a whole flight; ratios from one run."""
    from bench.speed import speed as asked

    asked.run(seconds, out=out)


@app.command
def papers(
    *,
    out: Annotated[Path | None, Parameter(help="folder; logs/runs/bench-papers-<now> by default")] = None,
    recorded: Annotated[
        Path | None, Parameter(help="folder of plane_wind8.tlog, a flight in known wind; left out without it")
    ] = None,
) -> None:
    """The three papers: what they report, ours, the baselines; one table, and a report with pictures."""
    from bench.papers import papers as asked

    asked.run(out, recorded)


@app.command
def live(
    *command: Annotated[str, Parameter(help="the station, after --; an echo without it")],
    seconds: float = 60.0,
    role: Annotated[Literal["echo", "ins", "theo-north", "radar-1"] | None, Parameter(show=False)] = None,
) -> None:
    """Latency with real processes on loopback: from a measurement put to its state received."""
    from bench.speed import live as asked

    if role == "echo":
        asked.echo()
    elif role:
        asked.bridge(role, seconds)
    else:
        print(asked.soak(seconds, list(command)))


@app.command
def flood(
    *,
    rate_hz: float = 10_000.0,
    seconds: float = 60.0,
    role: Annotated[bool, Parameter(negative="", show=False)] = False,
) -> None:
    """One source gone wild beside two that are well: what these lose, how late they are, memory, the end."""
    from bench.speed import flood as asked

    if role:
        asked.pour(rate_hz, seconds)
    else:
        print(asked.soak(rate_hz, seconds))


@app.command
def long(
    *,
    hours: float = 24.0,
    trace: Annotated[bool, Parameter(negative="", help="say which code holds what has grown; slow")] = False,
) -> None:
    """A long flight through the live session, faster than real time: memory, work, handles and threads."""
    from bench.speed import long as asked

    asked.run(3600.0 * hours, trace=trace)


@app.command
def page(
    *parts: Annotated[str, Parameter(help="bytes, hour, seek or fusion; all by default")],
    minutes: float = 60.0,
    seconds: float = 60.0,
    repeats: int = 3,
    tape: Annotated[Path | None, Parameter(show=False)] = None,
    watch: Annotated[int | None, Parameter(show=False)] = None,
) -> None:
    """The page of an hour of flight: bytes, first picture, memory, seeks; what it takes from the fusion."""
    from bench.speed import page as asked

    if tape:
        asked.serve(tape, minutes)
    elif watch:
        asked.watch(watch)
    else:
        asked.run(parts, minutes, seconds, repeats)


@app.command
def faults(*, times: int = 20) -> None:
    """Bridge, station and router killed, stopped and started again: told when, back when, states lost."""
    from bench.speed import faults as asked

    print(asked.run(times))


@app.command
def replay(
    log: Path,
    truth: Path,
    *,
    against_filterpy: Annotated[bool, Parameter(negative="", help="accuracy instead of speed")] = False,
) -> None:
    """The main job on a whole recorded flight: speed and sameness, or accuracy beside filterpy."""
    from bench.speed import replay as asked

    (asked.accuracy if against_filterpy else asked.speed)(log, truth)


@app.command
def clocks(
    log: Path | None = None,
    truth: Path | None = None,
    *,
    liar: Annotated[tuple[str, ...], Several] = (),
    seconds: float = 60.0,
) -> None:
    """One source that lies about time, live and in replay: what it costs, and when it is back."""
    from bench.speed import clocks as asked

    asked.run(log, truth, liar, seconds)


@app.command
def links(*flights: Path, seconds: float | None = None, system_id: int | None = None) -> None:
    """Logs both ways: read after the flight, and message by message as a live link; what differs."""
    from bench.speed import links as asked

    asked.run(flights, seconds, system_id)


@app.command
def recording(*, seconds: float = 120.0, kills: int = 0) -> None:
    """A live run recorded: size, cost, its replay byte by byte; then killed at random instants."""
    from bench.speed import recording as asked

    asked.run(seconds, kills)


@app.command
def tlog(*flights: Annotated[Path, Parameter(help="the sample flight by default")]) -> None:
    """The log reader beside pymavlink: speed."""
    from bench.speed import tlog as asked

    asked.speed(list(flights) or [asked.oracle.SAMPLE / "flight.tlog"])


@app.command
def fuzz(*, seeds: int = 1000) -> None:
    """The log reader beside pymavlink: damaged logs by the thousand, equal in all fields."""
    from bench.speed import tlog as asked

    sys.exit(asked.fuzz(seeds))


if __name__ == "__main__":
    try:
        app()
    except InputError as error:
        sys.exit(f"bench: {error}")
