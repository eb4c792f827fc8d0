"""``gcs report DIR``: a run folder as one HTML page to read, print and sign."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gcs.commands.options import metres_of
from gcs.contract.messages import InputError
from gcs.outputs.console import say

ToleranceH = Annotated[
    float | None, Parameter(help="m, horizontally, that the best estimate must keep in 95 % of all cases")
]
ToleranceV = Annotated[float | None, Parameter(help="m, in height, the same")]


def command(
    folder: Annotated[Path, Parameter(help="the run folder of gcs replay or gcs run")],
    *,
    tolerance_h: ToleranceH = None,
    tolerance_v: ToleranceV = None,
    out: Annotated[
        Path | None, Parameter(help="file to write; report.html in the run folder by default")
    ] = None,
) -> None:
    """A run folder as one HTML page that opens offline: tables, figures, verdict, a place to sign."""
    from gcs.report import report
    from gcs.report.basis import page, run
    from gcs.report.trust import Tolerance

    tolerance = Tolerance(metres_of("--tolerance-h", tolerance_h), metres_of("--tolerance-v", tolerance_v))
    written = write(out or folder / "report.html", page.render(report.document(run.load(folder), tolerance)))
    say(f"report: {written}   ({written.stat().st_size / 1e6:.1f} MB, opens offline)")


def write(path: Path, html: str) -> Path:
    """The page as a file. Raises InputError where it cannot be written."""
    try:
        path.write_text(html, encoding="utf-8")
    except OSError as error:
        raise InputError(f"--out {path}: {error.strerror}; name a file that can be written") from None
    return path
