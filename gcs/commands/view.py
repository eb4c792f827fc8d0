"""``gcs view``: the page alone, on any machine, as a plain subscriber of the bus."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import Parameter

from gcs.commands.compose import open_bus, other_course
from gcs.commands.options import Config, Overlay, stopped
from gcs.contract import config as configuration
from gcs.contract.messages import InputError
from gcs.outputs.console import say


def command(
    *,
    station: Path,
    vehicle: Annotated[
        tuple[str, ...],
        Parameter(consume_multiple=True, negative="", help="which to show; the station file's by default"),
    ] = (),
    overlay: Overlay = None,
    config: Config = (),
) -> None:
    """Show a flight that a station publishes: the same page as the station's own, in a process of its own.

    Several vehicles of the range on one page: ``--vehicle uav1 uav2``. Beside another page on this machine:
    ``--config view.port=PORT``.
    """
    from web import follow  # viser is not needed by other commands

    resolved, other = configuration.load(station, config), other_course(overlay) if overlay else None
    names = vehicle or (resolved.vehicle.name,)
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"--vehicle {twice[0]}: named twice")
    stop = stopped()
    with ExitStack() as stack:
        buses = {}
        for name in names:
            whose = msgspec.structs.replace(resolved.vehicle, name=name)
            bus = open_bus(msgspec.structs.replace(resolved, vehicle=whose), mode="client", waiting=say)
            buses[name] = stack.enter_context(bus)
        said = ", ".join(f"{resolved.range.name}/{name}" for name in names)
        say(f"waiting for {said}   (Ctrl-C ends)")
        follow.run(buses, resolved.view.port, stop, _opened, origins=resolved.view.origins, other=other)


def _opened(url: str) -> None:
    say(f"view: {url}")
