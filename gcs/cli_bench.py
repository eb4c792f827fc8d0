"""``gcs bench``: how exact, how fast, and the papers' figures."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

app = App(name="bench", help="Measure the estimator: how exact, how fast.")


@app.command
def accuracy(
    *cases: str,
    seeds: int = 50,
    first_seed: int = 10_000,
    seconds: float = 60.0,
    method: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = ("default",),
    out: Path | None = None,
) -> None:
    """Every case, or those named, over many seeds; errors as ratios to the filter told the outliers."""
    from gcs.bench import accuracy as bench_accuracy

    bench_accuracy.run(seeds, first_seed, seconds, cases, method, out=out)


@app.command
def papers(
    *,
    out: Annotated[Path | None, Parameter(help="folder; logs/runs/bench-papers-<now> by default")] = None,
    recorded: Annotated[Path, Parameter(help="folder of plane_wind8.tlog, a flight in known wind")] = Path(
        "../shared/data"
    ),
) -> None:
    """The three papers: what they report, ours, the baselines; one table, and a report with pictures."""
    from gcs.bench import papers as bench_papers

    bench_papers.run(out, recorded)


@app.command(name="speed")
def bench_speed(*, seconds: float = 3600.0, out: Path | None = None) -> None:
    """One update beside other filters, one measurement live, a whole flight; ratios from one run."""
    from gcs.bench import speed

    speed.run(seconds, out=out)
