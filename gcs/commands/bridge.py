"""``gcs bridge``: one instrument onto the bus."""

import threading
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from bridges.instruments import KINDS
from gcs.commands.compose import open_bus, until_stopped
from gcs.commands.options import Config, new_file, stopped
from gcs.contract import config as configuration
from gcs.contract.messages import InputError
from gcs.contract.supervision import Supervisor
from gcs.outputs import log
from gcs.outputs.disk import to_operator
from gcs.outputs.tlog import LinkLog

if TYPE_CHECKING:
    from gcs.contract.wire.bus import Bus

command = App(name="bridge", help="One bridge alone, on whichever machine the instrument hangs on.")


@command.command
def mavlink(
    *,
    station: Path,
    link: Annotated[
        str | None, Parameter(help="any pymavlink address; the station file's by default")
    ] = None,
    tlog: Annotated[Path | None, Parameter(help="keep all frames of the link in this new file")] = None,
    config: Config = (),
) -> None:
    """An autopilot's MAVLink, listen-only, onto the bus as ``raw/ins``."""
    from bridges.mavlink import mavlink as source

    resolved = configuration.load(station, config)
    address, system_id = link or resolved.mavlink.link, resolved.vehicle.system_id
    with ExitStack() as stack:
        keep = stack.enter_context(closing(LinkLog(new_file(tlog), to_operator))).take if tlog else None
        _bridge("mavlink", resolved, lambda bus, stop: source.run(address, system_id, bus, stop, keep))


@command.command
def simulated(
    truth: Path,
    *,
    station: Path,
    seed: int = 0,
    out: Annotated[Path | None, Parameter(help="folder: write feeds and labels there, play nothing")] = None,
    share: Annotated[float | None, Parameter(help="of the values, outliers; 0.041 by default")] = None,
    clean: Annotated[
        bool, Parameter(negative="", help="noise only: no outlier, no systematic error")
    ] = False,
    tlog: Annotated[
        Path | None, Parameter(help="the same flight's log, where the truth is in boot time")
    ] = None,
    speed: float = 1.0,
    now: Annotated[bool, Parameter(negative="", help="move the flight to the present")] = False,
    config: Config = (),
) -> None:
    """Every instrument of the station, simulated from a truth track with all that goes wrong."""
    from bridges import simulated as source

    resolved = configuration.load(station, config)
    track = source.read_truth(truth, source.boot_to_utc_ns(tlog) if tlog else None)
    instruments = source.instruments_of(station)
    if not clean:
        instruments = source.crooked(instruments, seed)
    outliers = 0.0 if clean else source.OUTLIER_SHARE if share is None else share
    if out:
        source.write_all(out, track, instruments, seed, outliers)
        return
    run = partial(source.run, share=outliers, speed=speed, now=now)
    _bridge("simulated", resolved, lambda bus, stop: run(bus, track, instruments, seed, stop))


def _instrument(kind: str) -> Callable[..., None]:
    """The command that bridges one instrument of a kind."""
    source = KINDS[kind]

    def bridge(
        name: str,
        *,
        station: Path,
        udp: Annotated[str | None, Parameter(help="HOST:PORT to listen on for its lines")] = None,
        tcp: Annotated[str | None, Parameter(help="HOST:PORT of the instrument, to connect to")] = None,
        file: Annotated[Path | None, Parameter(help="a feed file, played at its own pace")] = None,
        speed: Annotated[float, Parameter(help="times real time, of a file")] = 1.0,
        config: Config = (),
    ) -> None:
        resolved = configuration.load(station, config)
        known = [sensor.name for sensor in resolved.sensor if sensor.kind == kind]
        if name not in known:
            raise InputError(f"{station}: no {kind} {name!r}; it has {', '.join(known) or 'none'}")
        origins = {"udp": udp, "tcp": tcp, "file": file}
        named = [option for option, value in origins.items() if value is not None]
        if named not in ([source.LINK], ["file"]):
            raise InputError(f"name one origin of a {kind}: --{source.LINK} HOST:PORT or --file FILE.csv")
        if file is not None:
            _bridge(name, resolved, lambda bus, stop: source.run(bus, name, file, stop, speed=speed))
        else:
            address = _address(source.LINK, str(origins[source.LINK]))
            _bridge(name, resolved, lambda bus, stop: source.run(bus, name, address, stop))

    return bridge


for _kind in KINDS:
    command.command(_instrument(_kind), name=_kind, help=f"One {_kind} onto the bus as ``raw/NAME``.")


def _bridge(
    name: str, station: configuration.Station, work: Callable[["Bus", threading.Event], None]
) -> None:
    """Run a bridge until it is stopped or its file ends; what fails is told on the bus, and starts again.

    It is a client of the station's router, and waits for it.
    """
    stop = stopped()
    with (
        open_bus(station, mode="client", waiting=until_stopped(stop)) as bus,
        log.opened(None, [partial(bus.publish, "event")]),
        Supervisor(stop) as supervisor,
    ):
        supervisor.start(name, partial(work, bus)).join()


def _address(option: str, text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit():
        raise InputError(f"--{option} {text}: expected HOST:PORT, such as 127.0.0.1:9001")
    return host, int(port)
