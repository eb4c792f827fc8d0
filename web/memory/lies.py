"""Which channel is refused at a moment, since when, and by how much."""

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from web.memory.claims import KIND_OF
from web.memory.flight import SeenFlight
from web.memory.residuals import RESIDUAL, row

RUN = 3  # so many refused values in a row, up to the newest, are a lie and no accident
BACK_NS = 600_000_000_000  # a run is followed back for so long
OVER_NS = 2_000_000_000  # what ended longer ago is not now
RECENT_NS = 3_000_000_000  # by how much it is off is told of its last values
UNITS = {"range": "m", "azimuth": "°", "elevation": "°", "range_rate": "m/s", "e": "m", "n": "m", "u": "m"}
UNITS |= dict.fromkeys(("ve", "vn", "vu"), "m/s") | dict.fromkeys(("ae", "an", "au"), "m/s²")


class Lie(NamedTuple):
    """A run of refused values of one channel that has not ended."""

    sensor: str
    channel: str
    since_ns: int
    sigmas: float  # median, NaN: refused before there was any prediction
    off: float  # median of value minus predicted, in the channel's unit; NaN as well

    @property
    def text(self) -> str:
        name = f"{self.sensor} {self.channel.replace('_', ' ')}"
        if np.isnan(self.sigmas):
            return f"{name} refused"
        return f"{name} off by {self.off:+.3g} {UNITS[self.channel]} ({self.sigmas:.0f} σ)"


def lies(flight: SeenFlight, now_ns: int) -> list[Lie]:
    """The lies at ``now_ns``, the largest first."""
    pending: dict[tuple[str, str], list[tuple]] = defaultdict(list)
    for claim in flight.claims.pending():
        if claim.t_ns <= now_ns:
            for channel, verdict in claim.verdicts.items():
                pending[claim.sensor, channel].append(row(claim, verdict))
    settled = [(s, channel) for s in flight.residuals.sensors() for channel in flight.residuals.channels(s)]
    keys = dict.fromkeys((*settled, *pending))
    found = [lie for key in keys if (lie := _run(flight, key, pending.get(key, []), now_ns))]
    return sorted(found, key=lambda lie: -np.nan_to_num(lie.sigmas))


def _run(flight: SeenFlight, key: tuple[str, str], pending: list[tuple], now_ns: int) -> Lie | None:
    rows = np.array(pending, RESIDUAL)
    if not np.any(rows["kind"] == KIND_OF["used"]) and key[1] in flight.residuals.channels(key[0]):
        rows = np.concatenate([flight.residuals.of(*key, now_ns - BACK_NS, now_ns), rows])
    accepted = np.flatnonzero(rows["kind"] == KIND_OF["used"])
    run = rows[accepted[-1] + 1 :] if len(accepted) else rows
    if len(run) < RUN or now_ns - run["t_ns"][-1] > OVER_NS:
        return None
    recent = run[run["t_ns"] >= run["t_ns"][-1] - RECENT_NS]
    return Lie(*key, int(run["t_ns"][0]), _median(abs(recent["sigmas"])), _median(recent["off"]))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
