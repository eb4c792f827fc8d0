"""Which channel is refused right now, since when, and by how much."""

from typing import NamedTuple

import numpy as np

from gcs.contract.messages import Verdict
from web.memory.claims import KIND_OF
from web.memory.flight import SeenFlight
from web.memory.residuals import off, sigmas_off

RUN = 3  # so many refused values in a row, up to the newest, are a lie and no accident
BACK_NS = 600_000_000_000  # a run is followed back for so long
OVER_NS = 2_000_000_000  # what ended longer ago is not now
UNITS = {"range": "m", "azimuth": "°", "elevation": "°", "range_rate": "m/s", "e": "m", "n": "m", "u": "m"}
UNITS |= dict.fromkeys(("ve", "vn", "vu"), "m/s") | dict.fromkeys(("ae", "an", "au"), "m/s²")


class Lie(NamedTuple):
    """A run of refused values of one channel that has not ended."""

    sensor: str
    channel: str
    since_ns: int
    sigmas: float  # median
    off: float  # median of value minus predicted, in the channel's unit

    @property
    def text(self) -> str:
        return f"{self.sensor} {self.channel.replace('_', ' ')} off by {self.off:+.3g} {UNITS[self.channel]}"


def lies(flight: SeenFlight, now_ns: int) -> list[Lie]:
    """The lies at ``now_ns``, the largest first."""
    recent: dict[tuple[str, str], list[Verdict]] = {}
    for claim in flight.claims.pending():
        for channel, verdict in claim.verdicts.items():
            recent.setdefault((claim.sensor, channel), []).append(verdict)
    found = [lie for key, verdicts in recent.items() if (lie := _run(flight, key, verdicts, now_ns))]
    return sorted(found, key=lambda lie: -abs(np.nan_to_num(lie.sigmas)))


def _run(flight: SeenFlight, key: tuple[str, str], verdicts: list[Verdict], now_ns: int) -> Lie | None:
    refused: list[Verdict] = []
    for verdict in reversed(verdicts):
        if not KIND_OF[verdict.verdict]:
            break
        refused.append(verdict)
    if len(refused) < RUN or now_ns - refused[0].t_ns > OVER_NS:
        return None
    since_ns = refused[-1].t_ns
    if len(refused) == len(verdicts) and key[1] in flight.residuals.channels(key[0]):
        before = flight.residuals.of(*key, since_ns - BACK_NS, since_ns - 1)
        accepted = np.flatnonzero(before["kind"] == 0)
        run = before[accepted[-1] + 1 :] if len(accepted) else before
        since_ns = int(run["t_ns"][0]) if len(run) else since_ns
    apart = np.array([off(verdict) for verdict in refused])
    known = apart[np.isfinite(apart)]
    middle = float(np.median(known)) if len(known) else float("nan")
    return Lie(*key, since_ns, float(np.median([abs(sigmas_off(v)) for v in refused])), middle)
