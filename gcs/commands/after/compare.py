"""``gcs compare A B``: two runs, or a run and a truth file, held against each other."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.table import Table

from gcs.commands.after.report import write
from gcs.outputs.console import say
from gcs.outputs.console import screen as terminal


def command(
    a: Annotated[Path, Parameter(help="run folder")],
    b: Annotated[Path, Parameter(help="another one, or a truth file: CSV, gzip or not")],
    *,
    live: Annotated[
        bool, Parameter(negative="", help="what was known live, instead of the best estimates")
    ] = False,
    tlog: Annotated[Path | None, Parameter(help="the flight's log, where a truth file has boot time")] = None,
    out: Annotated[Path | None, Parameter(help="write the figures too: file.html")] = None,
) -> None:
    """Two runs, or a run and a truth file: differences along, across and up, and whether the sigmas hold."""
    from gcs.report import compare
    from gcs.report.basis import page, run

    first = run.load(a)
    if b.is_dir():
        second = compare.of_run(run.load(b), first.frame, live=live)
    else:
        from bridges import simulated

        boot_ns = simulated.boot_to_utc_ns(tlog) if tlog else None
        second = compare.of_truth(b, simulated.read_truth(b, boot_ns), first.frame)
    found = compare.difference(compare.of_run(first, first.frame, live=live), second)
    for sheet in (compare.distances(found), compare.consistency(found)):
        table = Table(*sheet.head, box=None, pad_edge=False)
        for row in sheet.rows:
            table.add_row(*row)
        terminal.print(table)
        say(f"{sheet.note}\n")
    if out:
        say(f"comparison: {write(out, page.render(compare.document(found)))}   (opens offline)")
