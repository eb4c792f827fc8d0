"""Where the sensors claim the target was: raw points and flagged outliers, once their verdict has settled.

Verdicts come by channel and may be revised while their row is inside the estimator's window. All channels of
one sensor at one instant make one claim; it is an outlier as soon as one of its channels is refused.
"""

from collections.abc import Callable, Sequence

from gcs.messages import Verdict

HOLD_NS = 3_000_000_000  # longer than the estimator's window of 1 to 2 s, so that revisions arrive in time
REFUSED = {"used": False, "deweighted": False, "isolated": True, "patch": True}  # others claim nothing new


class Claim:
    """One sensor's measurement at one instant."""

    def __init__(self):
        self.position: tuple[float, float, float] | None = None  # station ENU, metres
        self.refused: dict[str, bool] = {}  # by channel

    @property
    def outlier(self) -> bool:
        return any(self.refused.values())


class Claims:
    """Claims still open to revision; settled ones go to ``settled(sensor, position, outlier)``."""

    def __init__(self, settled: Callable[[str, Sequence[float], bool], None]):
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
                self._settled(key[1], claim.position, claim.outlier)

    def pending(self) -> tuple[dict[str, list[Sequence[float]]], list[Sequence[float]]]:
        """Positions of the claims still open: accepted ones by sensor, and all refused ones."""
        accepted: dict[str, list[Sequence[float]]] = {}
        refused: list[Sequence[float]] = []
        for (_, sensor), claim in self._open.items():
            if claim.position:
                (refused if claim.outlier else accepted.setdefault(sensor, [])).append(claim.position)
        return accepted, refused

    def clear(self) -> None:
        self._open.clear()
        self.newest.clear()
        self._now_ns = 0
