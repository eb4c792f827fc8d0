"""``gcs train``: learn the correction, test it on flights never seen, install it only if it helped."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from filters.correction.train import Plan
from gcs.commands.options import Config
from gcs.contract import config as configuration
from gcs.learning import training
from gcs.outputs.console import say
from gcs.station.intake import settings_of


def command(
    *runs: Annotated[Path, Parameter(help="run folders with a truth.csv: t_ns,lat_deg,lon_deg,alt_m")],
    out: Annotated[Path, Parameter(help="flights flown, network, report; the next start goes on from here")],
    flights: Annotated[int, Parameter(help="simulated flights beside the run folders")] = 100,
    seed: int = 0,
    compare: Annotated[int, Parameter(help="trainings each of three kinds of start, for the report")] = 0,
    install: Annotated[Path | None, Parameter(help="where a network that has earned it goes")] = None,
    config: Config = (),
) -> None:
    """Train the correction network and test it on flights it has never seen."""
    settings = settings_of(configuration.load(None, config))
    training.run(out, flights, list(runs), Plan(seed=seed), settings, compare, install, say)
