"""``gcs run``: the station live."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gcs.commands.options import Config, Correction, Method, known_method, stopped
from gcs.commands.serve import serve
from gcs.contract import config as configuration
from gcs.learning.network import correction_of


def command(
    *,
    station: Path,
    out: Annotated[Path | None, Parameter(help="run folder; logs/runs/<now> by default")] = None,
    view: Annotated[bool, Parameter(help="show it in the browser")] = True,
    method: Method = "default",
    correction: Correction = "off",
    seconds: Annotated[float | None, Parameter(help="end after so long")] = None,
    config: Config = (),
) -> None:
    """Live: MAVLink and ground sensors in over the bus, cleaned state out, view, recording."""
    resolved, learned = configuration.load(station, config), correction_of(correction)
    serve(
        resolved, out, stopped(), view=view, method=known_method(method), seconds=seconds, correction=learned
    )
