"""``python -m bench papers``: the methods of the three papers, measured, beside what the papers report.

Whatever was chosen by looking at results was chosen on seeds below ``accuracy.FIRST_SEED``; what is reported
begins there.
"""

import time
from importlib.util import find_spec
from pathlib import Path

from bench import table
from bench.accuracy import FIRST_SEED
from bench.papers.counts import Counts
from gcs.contract.messages import InputError
from gcs.outputs.console import say
from gcs.outputs.record import stamp

NEEDED = ("torch", "pywt", "matplotlib")


def run(out: Path | None = None, recorded: Path | None = None, counts: Counts = Counts()) -> dict:  # noqa: B008
    """Measure all; prints the table, writes report.html, its pictures and papers.json into folder ``out``.

    ``recorded`` is the folder of the recorded flight of row 10; without it that row stays empty. Raises
    InputError where a package is missing or nothing can be written.
    """
    for name in NEEDED:
        if find_spec(name) is None:
            raise InputError(f"bench papers needs {name}: pip install 'gcs-trajectory[train,bench]'")
    from bench.papers import measure
    from bench.papers.show import lines_m1, lines_m2, lines_m3, report

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
    lines = lines_m1.lines(m1) + lines_m2.lines(m2) + lines_m3.lines(m3)
    lines.sort(key=lambda line: line.row)
    grids = lines_m1.grids(m1) + lines_m2.grids(m2) + lines_m3.grids(m3)
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
