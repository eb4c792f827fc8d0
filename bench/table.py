"""The bench's figures on the terminal and in a file."""

import json
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from gcs import __version__
from gcs.outputs.record import stamp

WIDE = 180  # columns where there is no terminal
COLUMNS = {
    "rms_m": "rms m", "ratio_median": "/ oracle", "ratio_worst": "worst", "smoothed_median": "smoothed",
    "smoothed_worst": "worst", "lost": "lost", "found_isolated": "isolated found", "found_patch": "in runs",
    "false_per_10000": "false of 10⁴", "nees_mean": "NEES", "oracle_nees": "of the oracle",
    "nees_in_band": "in band", "nis_in_band": "NIS in band",
    "during_median": "during", "during_worst": "worst", "back_median_s": "back after s",
    "back_worst_s": "worst",
    "beside_median": "beside straight", "beside_worst": "worst", "within_3": "within 3σ",
    "late_m": "late m",
}  # fmt: skip


def accuracy(results: list[dict]) -> list[Table]:
    """One table per requirement, one line per case and method; what misses its limit is red."""
    return [_one([r for r in results if r["row"] == row]) for row in sorted({r["row"] for r in results})]


def _one(results: list[dict]) -> Table:
    names = [name for name in COLUMNS if any(r["figures"].get(name) is not None for r in results)]
    table = Table(title=f"requirement {results[0]['row']}", title_justify="left")
    for heading in ("case", "method", *(COLUMNS[name] for name in names), "worst seed"):
        table.add_column(heading)
    for r in results:
        shown = (_shown(name, r["figures"].get(name), r["limits"]) for name in names)
        table.add_row(r["case"], r["method"], *shown, str(r["worst_seed"]))
    return table


def speed(found: dict, limits: dict[str, float]) -> list[Table]:
    """Updates beside the peers, then what a station and a replay need."""
    updates = Table(title="one update", title_justify="left")
    for heading in ("filter", "µs", "times ours", "range", "end apart m"):
        updates.add_column(heading)
    for name, one in found["update"].items():
        if one is None:
            updates.add_row(name, "not installed here", "–", "–", "–")
            continue
        low, high = one["times_ours_range"]
        ratio = f"{one['times_ours']:.3g}"
        if one["times_ours"] < limits.get(name, 0.0):
            ratio = f"[red]{ratio}[/red]"
        updates.add_row(name, f"{one['us']:.3g}", ratio, f"{low:.3g} … {high:.3g}", f"{one['apart_m']:.2g}")
    rest = Table(title="estimator", title_justify="left")
    for heading in ("what", "figure", "limit"):
        rest.add_column(heading)
    live = ", ".join(f"{name.removesuffix('_us')} {value:.0f}" for name, value in found["live"].items())
    rest.add_row("one measurement live, µs", live, f"{limits['live_us']:g}")
    rest.add_row("one hour of flight, s", f"{found['replay']['per_hour_s']:.3g}", f"{limits['hour_s']:g}")
    return [updates, rest]


def missed(name: str, value: float, limits: dict[str, float]) -> bool:
    """Whether a figure is on the wrong side of its limit: shares that are found should be large."""
    if name not in limits:
        return False
    return value < limits[name] if name.startswith(("found", "within")) else value > limits[name]


def show(*tables: Table) -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDE)
    for table in tables:
        console.print(table)


def write(found: dict, out: Path | None, kind: str) -> Path:
    """Everything as JSON, in ``logs/runs`` where ``out`` is not given."""
    path = out or Path("logs/runs") / f"bench-{kind}-{stamp(time.time_ns())}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"version": __version__} | found, indent=1) + "\n", encoding="utf-8")
    return path


def _shown(name: str, value: float | None, limits: dict[str, float]) -> str:
    if value is None:
        return "–"
    return f"[red]{value:.4g}[/red]" if missed(name, value, limits) else f"{value:.4g}"
