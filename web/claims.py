"""Where the sensors claim the target was: raw points and flagged outliers, once their verdict has settled.

Verdicts come by channel and may be revised while their row is inside the estimator's window. All channels of
one sensor at one instant make one claim. Where a channel that places it in space is refused, the place is
wrong: ``misplaced``. Where only a rate or an acceleration is refused, the place still stands: ``misjudged``.
"""

from collections.abc import Callable, Iterator, Sequence

from gcs.contract.messages import Verdict

HOLD_NS = 3_000_000_000  # longer than the estimator's window of 1 to 2 s, so that revisions arrive in time
REFUSED = {"used": False, "deweighted": False, "isolated": True, "patch": True}  # others claim nothing new
PLACING = {"range", "azimuth", "elevation", "e", "n", "u"}
ACCEPTED, MISJUDGED, MISPLACED = "accepted", "misjudged", "misplaced"


class Claim:
    """One sensor's measurement at one instant."""

    def __init__(self):
        self.position: tuple[float, float, float] | None = None  # station ENU, metres
        self.refused: dict[str, bool] = {}  # by channel

    @property
    def kind(self) -> str:
        refused = {channel for channel, refused in self.refused.items() if refused}
        if refused & PLACING:
            return MISPLACED
        return MISJUDGED if refused else ACCEPTED


class Claims:
    """Claims still open to revision; settled ones go to ``settled(sensor, position, kind)``."""

    def __init__(self, settled: Callable[[str, Sequence[float], str], None]):
        self._settled = settled
        self._open: dict[tuple[int, str], Claim] = {}
        self._now_ns = 0
        self.newest: dict[str, tuple[int, Claim]] = {}  # by sensor: t_ns and claim

    def take(self, verdict: Verdict) -> None:
        if verdict.verdict not in REFUSED or verdict.t_ns < self._now_ns - HOLD_NS:
            return
        self._now_ns = max(self._now_ns, verdict.t_ns)
        claim = self._open.setdefault((verdict.t_ns, verdict.sensor), Claim())
        claim.refused[verdict.channel] = REFUSED[verdict.verdict]
        claim.position = verdict.position_enu_m or claim.position
        newest_ns, _ = self.newest.get(verdict.sensor, (0, None))
        if claim.position and verdict.t_ns >= newest_ns:
            self.newest[verdict.sensor] = verdict.t_ns, claim

    def settle(self) -> None:
        """Hand on, in order of time, what no revision can reach any more."""
        for key in sorted(key for key in self._open if key[0] < self._now_ns - HOLD_NS):
            claim = self._open.pop(key)
            if claim.position:
                self._settled(key[1], claim.position, claim.kind)

    def pending(self) -> Iterator[tuple[str, Sequence[float], str]]:
        """Sensor, position and kind of the claims still open."""
        for (_, sensor), claim in self._open.items():
            if claim.position:
                yield sensor, claim.position, claim.kind

    def clear(self) -> None:
        self._open.clear()
        self.newest.clear()
        self._now_ns = 0
