"""The compiled filter on disk: numba keeps it beside the source, renewed only where that very file changed.

A function compiled into another one is forgotten so. Hence everything goes when any source file is newer.

Code fresh from the compiler may round the last digit otherwise than the same code read back. So a process of
its own compiles, and every run reads: the first one gives the same bits as all later ones.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import filters

FOLDER = Path(filters.__file__).parent
LAST = "status.advance"  # is compiled when everything else is


def drop_stale(folder: Path = FOLDER) -> None:
    """Remove what was compiled before the newest source file in ``folder``, before anything is loaded."""
    kept = [file for kind in ("nbi", "nbc") for file in folder.rglob(f"__pycache__/*.{kind}")]
    newest = max(source.stat().st_mtime for source in folder.rglob("*.py"))
    if any(file.stat().st_mtime < newest for file in kept):
        for file in kept:
            file.unlink(missing_ok=True)


def prepare() -> None:
    """See that the compiled filter is there and fresh; the first time this takes half a minute."""
    drop_stale()
    kept = any(FOLDER.rglob(f"__pycache__/{LAST}*.nbi"))
    if not kept and os.access(FOLDER, os.W_OK):
        subprocess.run([sys.executable, "-m", "gcs.commands.compiled"], cwd=FOLDER.parent, check=True)


def _compile() -> None:
    """Every kind of sensor with everything to be estimated: all the code a session can ask for."""
    from filters import methods
    from filters.correction.correction import Correction, Network
    from filters.models.rows import CHANNELS, ROW, Sensor
    from filters.screening.channels import ChannelScreening
    from filters.wind.wind import WindEstimator

    every = np.ones(len(CHANNELS))
    sensors = [
        Sensor("ins", "ins", every),
        Sensor("theodolite", "theodolite", every, estimate=("bias", "clock")),
    ]
    ChannelScreening(sensors).doubts(np.zeros(1, ROW))
    wind, level, ahead = WindEstimator(), np.zeros(3), np.array([20.0, 0.0, 0.0])
    for t_ns in (0, 100_000_000):
        wind.step(t_ns, 20.0, level, ahead)
    wind.carry(t_ns, np.zeros(2), np.eye(2)).step(2 * t_ns, 20.0, level)
    methods.make("imm", sensors).warm_up()  # and wolf: the same code
    nothing = Network(np.zeros((1, 9)), np.zeros(1), np.zeros((9, 1)), np.zeros(9), np.ones(9), np.zeros(9))
    learned = Correction(nothing)
    methods.make("default", sensors, correction=learned).warm_up()  # the last; all others are of this code


if __name__ == "__main__":
    _compile()
