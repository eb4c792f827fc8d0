"""``gcs screen FILE.csv``: one raw feed watched channel by channel, without station or trajectory.

Writes beside each other: ``NAME.cleaned.csv``, a feed with every outlier replaced by its prediction;
``NAME.flags.csv``, what was done with each value; ``NAME.svg``, the picture.
"""

from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from cyclopts import Parameter
from rich.table import Table

from bridges import feed as feeds
from filters.screening import screening
from gcs.contract.messages import INSTRUMENT_CHANNELS, InputError
from gcs.outputs.console import screen as terminal
from gcs.outputs.screen_plot import Panel, picture

FIELDS = dict(
    zip(INSTRUMENT_CHANNELS, ("range_m", "azimuth_deg", "elevation_deg", "range_rate_mps"), strict=True)
)
PERIOD = {"azimuth": 360.0}
LEAST = 20  # values of a channel that tell its noise
WHITE_FOURTH = np.sqrt(70.0)  # Δ⁴ of white noise: √(1 + 16 + 36 + 16 + 1) σ
NORMAL_MAD = 1.4826


class Result(NamedTuple):
    """One channel, screened."""

    channel: str
    screened: screening.Screened  # (n,) in order of time
    noise: float  # σ the screening started with, units of the channel


def command(
    feed: Path,
    *,
    out: Annotated[Path | None, Parameter(help="folder; beside the feed by default")] = None,
    method: Annotated[str, Parameter(help="linear-adaptive, or a baseline")] = "linear-adaptive",
    threshold: Annotated[float | None, Parameter(help="sigmas of a residual; 5 by default")] = None,
) -> None:
    """One raw feed, channel by channel, without a trajectory: cleaned feed, flags and a picture."""
    folder = feed.parent if out is None else out
    counts = run(feed, folder, method, threshold)
    unreadable = counts.pop("unreadable")
    table = Table("channel", *next(iter(counts.values())), box=None, pad_edge=False)
    for channel, said in counts.items():
        table.add_row(channel, *(f"{n:.4g}" if isinstance(n, float) else f"{n:,}" for n in said.values()))
    terminal.print(table)
    terminal.print(f"{unreadable} lines unreadable; written to {folder}", soft_wrap=True, markup=False)


def run(file: Path, out: Path, method: str = screening.METHODS[0], threshold: float | None = None) -> dict:
    """Screen ``file`` into the folder ``out``; returns counts by channel, for the console.

    Raises InputError where the file is no feed or nothing can be written.
    """
    rows, bad = _read(file)
    t_s = (rows["t_ns"] - rows["t_ns"][0]) * 1e-9
    limits = {} if threshold is None else {"threshold": threshold}
    results = [
        _screen(channel, t_s, rows[field], method, limits)
        for channel, field in FIELDS.items()
        if np.isfinite(rows[field]).sum() >= LEAST
    ]
    if not results:
        raise InputError(f"{file}: no channel has {LEAST} values; record longer, or screen another feed")
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / f"{file.stem}.cleaned.csv").write_text(_cleaned(rows, results), encoding="utf-8")
        (out / f"{file.stem}.flags.csv").write_text(_flags(rows, results), encoding="utf-8")
        (out / f"{file.stem}.svg").write_text(_plot(file.name, t_s, rows, results), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: {error.strerror}; name a folder that can be written") from None
    return {"unreadable": len(bad)} | {result.channel: _counts(result) for result in results}


def noise_of(values: np.ndarray, period: float = 0.0) -> float:
    """1-sigma of the noise in (n,) values at a steady rate, whatever the flight and its outliers.

    A fourth difference takes out any cubic, so what is left is noise; the median absolute deviation does not
    mind the outliers among them. Values that repeat give the step between them instead.
    """
    x = values[np.isfinite(values)]
    if period:
        x = np.unwrap(x, period=period)
    sigma = NORMAL_MAD * np.median(np.abs(np.diff(x, 4))) / WHITE_FOURTH
    steps = np.abs(np.diff(x))
    return float(sigma) if sigma > 0.0 else float(steps[steps > 0.0].min(initial=np.inf))


def _read(file: Path) -> tuple[np.ndarray, list]:
    """(n,) POLAR in order of time, one per instant: the first in the file."""
    try:
        rows, bad = feeds.read(file, file.stem)
    except feeds.FeedError as error:
        raise InputError(str(error)) from None
    if not len(rows):
        raise InputError(f"{file}: no line can be read; the first: {bad[0].where}: {bad[0].reason}")
    return rows[np.unique(rows["t_ns"], return_index=True)[1]], bad


def _screen(channel: str, t_s: np.ndarray, values: np.ndarray, method: str, limits: dict) -> Result:
    period = PERIOD.get(channel, 0.0)
    noise = noise_of(values, period)
    settings = screening.Thresholds(noise, period=period, **limits)
    try:
        return Result(channel, screening.screen(t_s, values, settings, method), noise)
    except ValueError as error:
        raise InputError(str(error)) from None


def _counts(result: Result) -> dict:
    flags = np.bincount(result.screened.flag, minlength=len(screening.FLAGS))
    return dict(zip(screening.FLAGS, flags.tolist(), strict=True)) | {
        "restarts": result.screened.restarts,
        "noise": result.noise,
    }


def _cleaned(rows: np.ndarray, results: list[Result]) -> str:
    columns = []
    for result in results:
        missing = result.screened.flag == screening.MISSING
        columns.append(_texts(np.where(missing, np.nan, result.screened.cleaned)))
    head = ",".join(["t", *(FIELDS[result.channel] for result in results)])
    lines = (
        ",".join((_seconds(t), *cells)) for t, *cells in zip(rows["t_ns"].tolist(), *columns, strict=True)
    )
    return "\n".join((head, *lines, ""))


def _flags(rows: np.ndarray, results: list[Result]) -> str:
    lines = ["t_ns,channel,value,predicted,sigma,flag"]
    for channel, screened, _ in results:
        names = [screening.FLAGS[flag] for flag in screened.flag]
        numbers = map(_texts, (rows[FIELDS[channel]], screened.predicted, screened.sigma))
        for t_ns, value, predicted, sigma, name in zip(rows["t_ns"].tolist(), *numbers, names, strict=True):
            lines.append(f"{t_ns},{channel},{value},{predicted},{sigma},{name}")
    return "\n".join((*lines, ""))


def _plot(title: str, t_s: np.ndarray, rows: np.ndarray, results: list[Result]) -> str:
    panels = [
        Panel(FIELDS[channel], screened.cleaned, rows[FIELDS[channel]], screened.flag == screening.OUTLIER)
        for channel, screened, _ in results
    ]
    return picture(title, t_s, panels)


def _texts(values: np.ndarray) -> list[str]:
    return ["" if value != value else f"{value:.9g}" for value in values.tolist()]


def _seconds(t_ns: int) -> str:
    return f"{t_ns // 10**9}.{t_ns % 10**9:09d}"
