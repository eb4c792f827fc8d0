"""Where the sensors claim the target was: raw points and outliers, once their verdict has settled.

Verdicts come by channel and may be revised while their row is inside the estimator's window. All channels of
one sensor at one instant make one claim. Where a channel that places it in space is refused, the place is
wrong: ``misplaced``. Where only a rate or an acceleration is refused, the place still stands.
"""

from gcs.contract.messages import Verdict

HOLD_NS = 3_000_000_000  # longer than the estimator's window of 1 to 2 s, so that revisions arrive in time
ACCEPTED, ISOLATED, PATCH, INVALID = "accepted", "isolated", "patch", "invalid"
KINDS = (ACCEPTED, ISOLATED, PATCH, INVALID)  # the worst channel speaks for the claim
KIND_OF = {"used": 0, "deweighted": 0, "isolated": 1, "patch": 2, "invalid": 3}  # others claim nothing new
PLACING = {"range", "azimuth", "elevation", "e", "n", "u"}


class Claim:
    """One sensor's measurement at one instant."""

    def __init__(self, t_ns: int, sensor: str):
        self.t_ns, self.sensor = t_ns, sensor
        self.position: tuple[float, float, float] | None = None  # station ENU, metres
        self.verdicts: dict[str, Verdict] = {}  # by channel

    @property
    def kind(self) -> str:
        return KINDS[max(KIND_OF[verdict.verdict] for verdict in self.verdicts.values())]

    @property
    def refused(self) -> list[Verdict]:
        return [verdict for verdict in self.verdicts.values() if KIND_OF[verdict.verdict]]

    @property
    def misplaced(self) -> bool:
        return any(verdict.channel in PLACING for verdict in self.refused)


class Claims:
    """Claims still open to revision."""

    def __init__(self):
        self._open: dict[tuple[int, str], Claim] = {}
        self._now_ns = 0
        self.newest: dict[str, Claim] = {}  # by sensor

    def take(self, verdict: Verdict) -> None:
        no_claim = verdict.verdict not in KIND_OF or not verdict.channel
        if no_claim or verdict.t_ns < self._now_ns - HOLD_NS:
            return
        self._now_ns = max(self._now_ns, verdict.t_ns)
        key = verdict.t_ns, verdict.sensor
        claim = self._open.get(key) or self._open.setdefault(key, Claim(*key))
        claim.verdicts[verdict.channel] = verdict
        claim.position = verdict.position_enu_m or claim.position
        newest = self.newest.get(verdict.sensor)
        if claim.position and (newest is None or verdict.t_ns >= newest.t_ns):
            self.newest[verdict.sensor] = claim

    def settle(self) -> list[Claim]:
        """What no revision can reach any more, in order of time."""
        keys = sorted(key for key in self._open if key[0] < self._now_ns - HOLD_NS)
        return [self._open.pop(key) for key in keys]

    def pending(self) -> list[Claim]:
        """The claims still open, in order of time."""
        return [self._open[key] for key in sorted(self._open)]

    def clear(self) -> None:
        self._open.clear()
        self.newest.clear()
        self._now_ns = 0
