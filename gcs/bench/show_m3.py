"""The screening paper's table, ours beside the paper's; alone, and joined with the trajectory filter."""

import numpy as np
from rich.table import Table

from gcs.bench import screening
from gcs.bench.joined import Joined, joined


def tables(seeds: int = 20, joined_seeds: int = 2) -> list[Table]:
    """``seeds`` records screened alone by every method, with runs of either kind; a few joined."""
    alone = [
        _alone(screening.table(seeds, regular=regular), "regular" if regular else "irregular")
        for regular in (False, True)
    ]
    return [*alone, _joined([joined(seed) for seed in range(joined_seeds)])]


def _alone(found: dict[str, screening.Score], kind: str) -> Table:
    table = Table(title=f"screening one range, {kind} runs: ours (the paper's)", title_justify="left")
    for heading in ("method", "restarts", "false alarms", "isolated found", "in runs found"):
        table.add_column(heading)
    for method, ours in found.items():
        paper = screening.PAPER[method]
        counts = (f"{a:.1f} ({b})" for a, b in zip(ours[:2], paper[:2], strict=True))
        shares = (f"{a:.1%} ({b:.1%})" for a, b in zip(ours[2:], paper[2:], strict=True))
        table.add_row(method, *counts, *shares)
    return table


def _joined(found: list[Joined]) -> Table:
    table = Table(
        title="the same range with azimuth and elevation, in the trajectory filter", title_justify="left"
    )
    for heading in ("who", "false alarms", "isolated found", "in runs found"):
        table.add_column(heading)
    for who in Joined._fields:
        false, isolated, in_runs = np.mean([getattr(one, who) for one in found], axis=0)
        table.add_row(who, f"{false:.1f}", f"{isolated:.2%}", f"{in_runs:.2%}")
    return table
