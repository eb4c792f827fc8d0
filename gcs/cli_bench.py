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
def papers() -> None:
    """The papers' tables: what they report, ours, the baselines."""
    from gcs.bench import show_m1, show_m2, show_m3, table

    for paper in (show_m1, show_m2, show_m3):
        for each in paper.tables():
            table.show(each)


@app.command(name="speed")
def bench_speed(*, seconds: float = 3600.0, out: Path | None = None) -> None:
    """One update beside other filters, one measurement live, a whole flight; ratios from one run."""
    from gcs.bench import speed

    speed.run(seconds, out=out)
