"""``gcs view``: the page alone, on any machine, as a plain subscriber of the bus."""

from pathlib import Path

from gcs.commands.compose import open_bus, other_course
from gcs.commands.options import Config, Overlay, stopped
from gcs.contract import config as configuration
from gcs.outputs.console import say


def command(*, station: Path, overlay: Overlay = None, config: Config = ()) -> None:
    """Show a flight that a station publishes: the same page as the station's own, in a process of its own.

    For another vehicle of the range: ``--config vehicle.name=NAME``; beside another page on this machine:
    ``--config view.port=PORT``.
    """
    from web import view  # viser is not needed by other commands

    resolved, other = configuration.load(station, config), other_course(overlay) if overlay else None
    stop = stopped()
    with open_bus(resolved, mode="client", waiting=say) as bus:
        say(f"waiting for {resolved.range.name}/{resolved.vehicle.name}   (Ctrl-C ends)")
        view.run(bus, resolved.view.port, stop, _opened, origins=resolved.view.origins, other=other)


def _opened(url: str) -> None:
    say(f"view: {url}")
