"""Where the sensors claim the target was: raw points and flagged outliers, once their verdict has settled.

Verdicts come by channel and may be revised while their row is inside the estimator's window. All channels of
one sensor at one instant make one claim; it is an outlier as soon as one of its channels is refused.
"""

from collections.abc import Callable, Sequence

from gcs.messages import Verdict

HOLD_NS = 3_000_000_000  # longer than the estimator's window of 1 to 2 s, so that revisions arrive in time
ACCEPTED = ("used", "deweighted")


class Claim:
    """One sensor's measurement at one instant."""

    def __init__(self):
        self.position: tuple[float, float, float] | None = None  # station ENU, metres
        self.refused: dict[str, bool] = {}  # by channel

    @property
    def outlier(self) -> bool:
        return any(self.refused.values())


class Claims:
    """Claims still open to revision; settled ones go to ``settle(sensor, position, outlier)``."""

    def __init__(self, settle: Callable[[str, Sequence[float], bool], None]):
        self._settle = settle
        self._open: dict[tuple[int, str], Claim] = {}
        self.newest: dict[str, tuple[int, Claim]] = {}  # by sensor: t_ns and claim

    def take(self, verdict: Verdict) -> None:
        newest_ns, _ = self.newest.get(verdict.sensor, (verdict.t_ns, None))
        if verdict.t_ns < newest_ns - HOLD_NS:
            return
        claim = self._open.setdefault((verdict.t_ns, verdict.sensor), Claim())
        claim.refused[verdict.channel] = verdict.verdict not in ACCEPTED
        claim.position = verdict.position_enu_m or claim.position
        if claim.position and verdict.t_ns >= newest_ns:
            self.newest[verdict.sensor] = verdict.t_ns, claim

    def settle_before(self, t_ns: int) -> None:
        for key in sorted(key for key in self._open if key[0] < t_ns - HOLD_NS):
            claim = self._open.pop(key)
            if claim.position:
                self._settle(key[1], claim.position, claim.outlier)

    def pending(self, sensor: str | None, outlier: bool) -> list[Sequence[float]]:
        """Positions of the claims still open, of one sensor or of all."""
        return [
            claim.position
            for (_, name), claim in self._open.items()
            if claim.position and claim.outlier == outlier and sensor in (None, name)
        ]

    def clear(self) -> None:
        self._open.clear()
        self.newest.clear()
