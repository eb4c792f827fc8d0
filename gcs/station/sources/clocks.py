"""The flight's clock: what most sources agree on. Who is stamped elsewhere is refused until it is right.

A source's *lag* is arrival minus stamp: its delay, less what its clock is ahead. Nobody can measure the
future, and a delay has no upper end, so the lags of honest sources lie close above one number, the lag of a
measurement that comes without delay. That number is decided by vote, as among time servers (Marzullo &
Owicki 1983; RFC 5905, 11.2.1): every source votes with its lag, the station's own clock with zero, and the
largest group within ``lateness_s`` wins: what lies farther apart is late in the estimator anyway. Of three
or more the second smallest lag counts, so that one clock alone sets nothing; among equals the clock that ran
so far, then the group of the station's own clock. A played recording outvotes the station, and so does an
aircraft with its instruments when the station's own clock is wrong.

Then, row by row: stamped ahead of the flight's clock by more than ``AHEAD_NS``, it is a lie; what is less is
the range of the clock offsets that the estimator finds. A source that is behind the promptest one by more
than ``lateness_s``, for most of a second, has a wrong clock or too slow a link, and its rows would all be
late. A row that is late alone is left to the estimator: it may come after a stall, but not from before the
flight's first turn. A source whose lag runs away from the others' along a line has a clock that drifts, or a
link that fills up: `lags`. Two sources alone cannot tell which of them does.

At the start rows wait until two agree. A source that is alone and apart from the station's clock is taken
after ``LONE_NS``, and of several that all differ the one nearest to the station. A clock once agreed on moves
only if more votes stand against it for ``MOVE_NS``; all being late together is a slow link and moves nothing.

All is a function of stamps and arrivals, in their order; nothing here reads a clock.
"""

from collections import deque
from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

import numpy as np

from gcs.station.sources.lags import FEWEST, WATCH_NS, S, Voter

PACED_NS = S // 2  # how fast a recording is played shows after so long
VOTE_NS = 5 * S  # a source that is silent for longer has no vote: the slowest radars turn once in 4 s
AHEAD_NS = S // 4  # 2.5 sigma of the usual prior of a clock offset
LONE_NS = 10 * S  # time for the others to begin
MOVE_NS = 1 * S
RIGHT_NS = 1 * S  # a clock is right again after so long without a lie
STALE_NS = 60 * S  # no link holds back what it carries for so long: another clock, or a recording
STEADY = 0.05  # lags that grow by less are those of real time
STATION = ""  # the name under which the station's own clock votes
AHEAD = "stamped in the future: ahead of the flight's clock"
BEHIND = "stamped too far behind the flight's clock: its clock is wrong or its link too slow"
UNITS = ((31_557_600, "years"), (86_400, "days"), (3_600, "h"), (60, "min"))
DRIFTS = "stamped by a clock that drifts"
FAULTS = ("", AHEAD, BEHIND, DRIFTS)  # what ``FlightClock.judge`` finds, by number


class Drift(NamedTuple):
    """One that is found out, or is over."""

    name: str  # of the source
    before_ns: int  # its clock was right until then
    newest_ns: int  # stamp of its newest measurement that was taken
    moved_s: float = 0.0  # once it is over: how far its clock is from where it was


class FlightClock:
    """Hears of every turn's stamps first, settles on a time, then judges them."""

    def __init__(self, voters: Iterable[str], lateness_s: float):
        self._near_ns = max(round(lateness_s * S), 2 * AHEAD_NS)
        self._names = set(voters)
        self._sources: dict[str, Voter] = {}
        self._lag_ns: int | None = None  # of a measurement without delay, at _now_ns; None: not settled
        self._lags: deque[tuple[int, int]] = deque()  # (time, lag of the group) in VOTE_NS, ten a second
        self._rate = 0.0  # growth of all lags: 0 in real time, −1 for a recording at double speed
        self._now_ns = self._began_ns = self._against_ns = 0
        self._promptest_ns = 0
        self._taken = 0, 0  # when, and which lag
        self._watched_ns = 0
        self._lags_before: dict[str, int] = {}  # by source, when they were last looked at
        self._common_ns = 0.0  # by how much most lags have grown
        self._first_ns = 0  # the flight's time when the first turn came
        self.told: list[tuple[str, str]] = []  # (level, text) of what has happened, for whoever takes it
        self.drifts: list[Drift] = []  # the same

    @property
    def now_ns(self) -> int:
        """The flight's time at the newest turn; the station's own until there is one."""
        return self._now_ns - (self._lag_ns or 0)

    def latency_s(self, name: str) -> float:
        """Delay of a source; in a recording, beyond that of the promptest."""
        if name not in self._sources or self._lag_ns is None:
            return 0.0
        base = self._lag_ns if abs(self._lag_ns) > STALE_NS else 0
        return (self._sources[name].lag_ns(self._now_ns, self._rate) - base) / S

    def hear(self, name: str, t_ns: np.ndarray, arrival_ns: int) -> None:
        """Take (n,) stamps, n > 0, of one source that arrived in this turn."""
        self._began_ns = self._began_ns or arrival_ns
        self._sources.setdefault(name, Voter()).hear(arrival_ns - t_ns, arrival_ns)

    def settle(self, now_ns: int) -> bool:
        """Vote, once a turn. False while there is no clock yet: rows must wait."""
        self._heal(now_ns)
        if self._lag_ns is not None:
            self._lag_ns += round(self._rate * (now_ns - self._now_ns))
        self._now_ns = now_ns
        votes = {
            name: voter.lag_ns(now_ns, self._rate)
            for name, voter in self._sources.items()
            if name in self._names and now_ns - voter.lags[-1][0] <= VOTE_NS
        }
        if not votes:
            return self._lag_ns is not None
        group = self._largest(votes | {STATION: 0})
        if self._lag_ns is None:
            self._begin(votes, group)
        elif len(group) > 1:
            self._follow(group)
        if self._lag_ns is not None:
            if not self._first_ns:
                self._first_ns = self.now_ns - round((1.0 - self._rate) * (now_ns - self._began_ns))
            honest = (lag for lag in votes.values() if lag >= self._lag_ns - self._ahead_ns())
            self._promptest_ns = min(honest, default=self._lag_ns)
            if now_ns - self._watched_ns >= WATCH_NS:
                self._watched_ns = now_ns
                self._watch([*votes, *({STATION} & group.keys())])
        return self._lag_ns is not None

    def judge(self, name: str, t_ns: np.ndarray, arrival_ns: int) -> np.ndarray:
        """(n,) index into FAULTS of (n,) stamps of one source that arrived together, now or before."""
        voter, speed = self._sources[name], 1.0 - self._rate
        since_ns = round(self._rate * (self._now_ns - arrival_ns))
        lags = arrival_ns - t_ns + since_ns
        late_ns = self._promptest_ns + round(speed * self._near_ns)
        fault = np.zeros(len(t_ns), np.int64)
        fault[lags < (self._lag_ns or 0) - self._ahead_ns()] = 1
        kept_for_us = arrival_ns == self._began_ns  # by the bridges, and as old as it likes
        if not kept_for_us:
            always = len(voter.lags) >= FEWEST and voter.lag_ns(self._now_ns, self._rate) > late_ns
            fault[lags > late_ns + (0 if always else STALE_NS)] = 2
            fault[(fault == 0) & (t_ns < self._first_ns - self._near_ns)] = 2
        if voter.drift:
            fault[fault == 0] = 3
        if fault.any():
            self._lied(name, voter, int(lags[fault > 0][-1]), arrival_ns)
        voter.taken_ns = int(t_ns[fault == 0].max(initial=voter.taken_ns))
        return fault

    def _watch(self, names: list[str]) -> None:
        """Twice a second: whose lag grows otherwise than most do? A stall, or a pace, is common to all."""
        now_ns = self._now_ns
        fast = [name for name in names if name != STATION and self._sources[name].is_fast(now_ns)]
        lags = {name: self._sources[name].least_ns(now_ns, self._rate) for name in fast}
        lags |= {STATION: 0} if STATION in names else {}
        steps = [lag - self._lags_before[name] for name, lag in lags.items() if name in self._lags_before]
        self._lags_before = lags
        self._common_ns += median(steps) if len(steps) > 2 else 0.0
        if len(lags) > 2:
            for name in fast:
                voter, drifted = self._sources[name], bool(self._sources[name].drift)
                voter.watch((now_ns - self._began_ns) / S, (lags[name] - self._common_ns) / S)
                if voter.drift and not drifted:
                    voter.right_ns = self.now_ns - round(voter.lied_s * S)
                    self.drifts.append(Drift(name, voter.right_ns, voter.taken_ns))
                elif drifted and not voter.drift:
                    self.drifts.append(Drift(name, voter.right_ns, voter.taken_ns, voter.moved_s()))

    def _ahead_ns(self) -> int:
        return round(min(AHEAD_NS, self._near_ns / 2) * (1.0 - self._rate))

    def _largest(self, votes: dict[str, int]) -> dict[str, int]:
        """The group that wins."""
        width = round(self._near_ns * (1.0 - self._rate))
        groups = (
            {name: lag for name, lag in votes.items() if low <= lag <= low + width} for low in votes.values()
        )
        return max(groups, key=self._standing)

    def _standing(self, group: dict[str, int]) -> tuple:
        running = self._lag_ns is not None and abs(_least(group) - self._lag_ns) <= self._near_ns
        return len(group), running, STATION in group, -abs(min(group.values(), key=abs))

    def _begin(self, votes: dict[str, int], group: dict[str, int]) -> None:
        """Settle if there is reason to."""
        paced = any(self._sources[name].span_ns() >= PACED_NS for name in group if name != STATION)
        if STATION in group and len(group) > 1:
            self._take(group)
        elif len(group) > 1 and paced:
            self._take(group)
            self._warn(group, "they agree")
        elif self._now_ns - self._began_ns >= LONE_NS:
            group = {min(votes, key=lambda name: abs(votes[name])): 0}
            self._take(group)
            self._warn(group, "alone" if len(votes) == 1 else "of sources that all differ the nearest")

    def _warn(self, group: Iterable[str], why: str) -> None:
        far = _far(self._lag_ns or 0)
        self._tell("warning", f"{_listed(group)}: {far} the station's clock; taken as the flight's, {why}")

    def _follow(self, group: dict[str, int]) -> None:
        """Keep to the clock that runs; another one needs more votes, and patience."""
        lag_ns, old_ns = _least(group), self._lag_ns or 0
        apart_ns = lag_ns - old_ns
        if abs(apart_ns) <= self._near_ns:
            lag_ns = self._lag_ns = self._lowest(lag_ns)
            self._against_ns = 0
            run_ns, grown_ns = self._now_ns - self._taken[0], lag_ns - self._taken[1]
            if STATION not in group and run_ns >= PACED_NS:
                self._rate = _if_not_steady(grown_ns / run_ns)
        elif 0 < apart_ns < STALE_NS:
            self._against_ns = 0
        elif self._against_ns == 0:
            self._against_ns = self._now_ns
        elif self._now_ns - self._against_ns >= MOVE_NS:
            self._take(group)
            told = f"the flight's clock moves, {_far(apart_ns)} what it was: {_listed(group)} agree on it"
            self._tell("error", told)

    def _lowest(self, lag_ns: int) -> int:
        """The lowest lag of late: who was held up with all others is prompt again, and not in the future."""
        if not self._lags or self._now_ns - self._lags[-1][0] >= S // 10:
            self._lags.append((self._now_ns, lag_ns))
        while self._now_ns - self._lags[0][0] > VOTE_NS:
            self._lags.popleft()
        return min(lag_ns, *(lag + round(self._rate * (self._now_ns - then)) for then, lag in self._lags))

    def _take(self, group: Iterable[str]) -> None:
        """Take a group's clock for the flight's: its pace, then its time."""
        voters = {name: self._sources[name] for name in group if name != STATION}
        rates = [voter.rate() for voter in voters.values() if voter.span_ns() >= PACED_NS]
        real = STATION in group or not rates
        self._rate = 0.0 if real else _if_not_steady(median(rates))
        lags = {name: voter.lag_ns(self._now_ns, self._rate) for name, voter in voters.items()}
        self._lag_ns, self._against_ns = _least(lags | ({STATION: 0} if STATION in group else {})), 0
        self._taken = self._now_ns, self._lag_ns
        self._lags.clear()

    def _lied(self, name: str, voter: Voter, lag_ns: int, arrival_ns: int) -> None:
        if voter.lied_ns is None:
            far = _far(lag_ns - (self._lag_ns or 0))
            drifts = ", and drifts" if voter.drift else ""
            text = f"{name} is stamped {far} the flight's clock{drifts}: refused; set its clock right"
            self._tell("warning", text)
        voter.lied_ns = arrival_ns

    def _heal(self, now_ns: int) -> None:
        for name, voter in self._sources.items():
            spoke_ns = voter.lags[-1][0]
            if voter.lied_ns is not None and spoke_ns > voter.lied_ns and now_ns - voter.lied_ns > RIGHT_NS:
                voter.lied_ns = None
                self._tell("info", f"{name} is stamped right again: taken")

    def _tell(self, level: str, text: str) -> None:
        self.told.append((level, text))


def _least(group: dict[str, int]) -> int:
    """Lag without delay: of three or more votes the second smallest; never more than the station's."""
    lags = sorted(group.values())
    least = lags[1] if len(lags) > 2 else lags[0]
    return min(least, 0) if STATION in group else least


def _if_not_steady(rate: float) -> float:
    return rate if abs(rate) > STEADY else 0.0


def _far(lag_ns: int) -> str:
    """In words: ``10.0 s ahead of``."""
    apart_s = abs(lag_ns) / S
    size_s, unit = next((of for of in UNITS if apart_s >= 2 * of[0]), (1, "s"))
    return f"{apart_s / size_s:.1f} {unit} {'behind' if lag_ns > 0 else 'ahead of'}"


def _listed(names: Iterable[str]) -> str:
    return ", ".join(name or "the station's own clock" for name in names)
