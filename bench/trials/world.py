"""Everything that the trials take from the rest of the project, named in one place."""

import hashlib
import os
import tempfile
from pathlib import Path

from filters import methods
from filters.baselines import baselines
from filters.models.rows import (
    AZIMUTH,
    CHANNELS,
    ELEVATION,
    ISOLATED,
    PATCH,
    RANGE,
    RANGE_RATE,
    ROW,
    TRACK,
    VERDICT,
    E,
    N,
    Sensor,
    Step,
    U,
)
from filters.simulation import autopilot, faults, gusts, scenario, simulate
from filters.simulation.scenario import Truth

__all__ = [
    "AZIMUTH",
    "CHANNELS",
    "ELEVATION",
    "ISOLATED",
    "PATCH",
    "RANGE",
    "RANGE_RATE",
    "ROW",
    "TRACK",
    "VERDICT",
    "E",
    "N",
    "Sensor",
    "Step",
    "Truth",
    "U",
    "autopilot",
    "baselines",
    "cache_file",
    "decode",
    "default_ins",
    "faults",
    "fingerprint",
    "gusts",
    "methods",
    "scenario",
    "simulate",
]  # fmt: skip

HOME = (-35.363261, 149.165230, 584.0)  # of the recorded flights: latitude, longitude deg, ellipsoidal m


def decode(log: Path):
    """((n,) ROW of the INS as the station makes them, (n,) arrival ns, its Sensor, UTC − boot ns, frame)."""
    import numpy as np

    from bridges.tlog import flight as tlog_flight
    from bridges.tlog import tlog
    from gcs.contract import config
    from gcs.contract.frames import Frame
    from gcs.station.intake import Intake, sensors_of
    from gcs.station.ledger import Ledger

    own = tlog_flight.flight(tlog.read(log))
    station, frame = config.load(None), Frame(*HOME)
    sensor = sensors_of(station, frame)[0]
    intake = Intake(station, frame, Ledger([sensor.name], ("",)))
    batch = intake.ins(own.rows)
    entered, _ = intake.enter(batch)
    rows = np.zeros(len(entered), ROW)
    for field in ("id", "t_ns", "sensor", "channel", "value"):
        rows[field] = entered[field]
    arrival_ns = own.rows["arrival_ns"][batch.entries["measurement"][batch.complaints == 0]]
    order = np.argsort(rows["t_ns"], kind="stable")
    return rows[order], arrival_ns[order], sensor, own.boots[0].offset_ns, frame


def default_ins() -> Sensor:
    """The INS with the station's own settings."""
    from gcs.contract import config
    from gcs.contract.frames import Frame
    from gcs.station.intake import sensors_of

    return sensors_of(config.load(None), Frame(*HOME))[0]


def cache_file(name: str) -> Path:
    """A file of this user's cache of decoded flights."""
    user = getattr(os, "getuid", lambda: 0)()
    folder = Path(tempfile.gettempdir()) / f"gcs-trials-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder / name


def fingerprint(*files: Path) -> str:
    """Of files' names, sizes and times of change, and of what a row is."""
    stats = [(f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files]
    return hashlib.sha256(repr((stats, ROW.descr)).encode()).hexdigest()[:12]
