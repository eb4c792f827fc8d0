"""``gcs bench papers``: the methods of the three papers, measured, beside what the papers report.

Whatever was chosen by looking at results was chosen on seeds below ``accuracy.FIRST_SEED``; what is reported
begins there.
"""

import time
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from gcs.bench import table
from gcs.bench.accuracy import FIRST_SEED
from gcs.bench.screening import POINTS
from gcs.contract.messages import InputError
from gcs.outputs.console import say
from gcs.outputs.record import stamp

RECORDED = Path("../shared/data")
NEEDED = ("torch", "pywt", "matplotlib")


class Counts(NamedTuple):
    """How much is measured."""

    runs: int = 200  # flights of simulations 1 and 2
    lessons: int = 300  # flights their networks learn from
    tuning: int = 20  # flights that the tuned filters are tuned on
    trainings: int = 20  # of each start
    theodolites: int = 20  # flights of each level
    flights: int = 100  # that the default network is trained on
    unseen: int = 20  # that it is tried on
    winds: int = 1000  # of which the first `show_m2.FEW` make row 8, all its second line
    records: int = 20  # screened
    joined: int = 5  # of them, with the trajectory filter
    points: int = POINTS  # of each of those


def run(out: Path | None = None, recorded: Path = RECORDED, counts: Counts = Counts()) -> dict:  # noqa: B008
    """Measure all; prints the table, writes report.html, its pictures and papers.json into folder ``out``.

    ``recorded`` is the folder of the recorded flight of row 10. Raises InputError where a package is missing
    or nothing can be written.
    """
    for name in NEEDED:
        if find_spec(name) is None:
            raise InputError(f"bench papers needs {name}: pip install 'gcs-trajectory[train,bench]'")
    from gcs.bench import papers_measure as measure
    from gcs.bench import papers_report as report
    from gcs.bench import show_m1, show_m2, show_m3

    folder = out or Path("logs/runs") / f"bench-papers-{stamp(time.time_ns())}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror}; name a folder that can be written") from None
    begin_s = time.monotonic()
    m1, drawn_m1 = measure.m1(counts)
    m2, drawn_m2 = measure.m2(counts, recorded)
    m3, drawn_m3 = measure.m3(counts)
    wall_s = time.monotonic() - begin_s
    lines = show_m1.lines(m1) + show_m2.lines(m2) + show_m3.lines(m3)
    lines.sort(key=lambda line: line.row)
    grids = show_m1.grids(m1) + show_m2.grids(m2) + show_m3.grids(m3)
    head = f"Measured in {wall_s:.0f} s, on seeds from {FIRST_SEED}; " + _said(counts)
    path = report.write(folder, head, lines, drawn_m1 + drawn_m2 + drawn_m3, grids)
    found = {"m1": m1, "m2": m2, "m3": m3}
    found = {"wall_s": wall_s, "counts": counts._asdict(), "lines": [one._asdict() for one in lines]} | found
    table.write(found, folder / "papers.json", "papers")
    table.show(report.terminal(lines))
    say(f"{wall_s:.0f} s; written: {path}")
    return found


def _said(counts: Counts) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts._asdict().items()) + "."
