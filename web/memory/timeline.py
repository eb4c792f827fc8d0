"""Where in the flight a page stands: now, or back in what it has seen. Times are the flight's, int64 ns UTC.

Going back costs nothing, however long the flight: what the filter knew then is kept, state by state.
"""

import math
import time
from typing import NamedTuple, Protocol

from web.memory.flight import SeenFlight

FASTEST = 50.0  # times real time: what was flown is played no faster, else nobody would see it


class Playable(Protocol):
    """A replay: what may be done with its time."""

    @property
    def start_ns(self) -> int: ...
    @property
    def end_ns(self) -> int: ...
    @property
    def now_ns(self) -> int: ...
    @property
    def playing(self) -> bool: ...
    @property
    def speed(self) -> float:
        """1, 2, 5, …; inf is as fast as it goes."""

    def play(self) -> None: ...
    def pause(self) -> None: ...
    def seek(self, t_ns: int) -> None: ...
    def set_speed(self, speed: float) -> None: ...


class LookBack:
    """A live flight looked back upon by one viewer: `playing` is now, everything else is the past."""

    live, speed = True, 1.0

    def __init__(self, flight: SeenFlight):
        self._flight = flight
        self._at_ns: int | None = None

    @property
    def start_ns(self) -> int:
        return self._flight.span_ns[0]

    @property
    def end_ns(self) -> int:
        return self._flight.span_ns[1]

    @property
    def now_ns(self) -> int:
        at_ns = self._at_ns
        return self.end_ns if at_ns is None else max(at_ns, self.start_ns)

    @property
    def playing(self) -> bool:
        return self._at_ns is None

    @property
    def back(self) -> bool:
        return self._at_ns is not None

    def play(self) -> None:
        self._at_ns = None

    def pause(self) -> None:
        self._at_ns = self.now_ns

    def seek(self, t_ns: int) -> None:
        self._at_ns = t_ns

    def set_speed(self, speed: float) -> None:
        """Live goes at its own pace."""


class Past(NamedTuple):
    """Where a replay is looked at behind its front, and since when that moment plays."""

    at_ns: int
    playing: bool
    since_s: float  # monotonic


class Rewind:
    """A replay that all viewers share: its front flies, everything behind it is looked up.

    Only a seek beyond what was flown makes the replay go on; one back never makes it fly again.
    """

    live = False

    def __init__(self, replay: Playable, flight: SeenFlight):
        self._replay, self._flight = replay, flight
        self._past: Past | None = None

    @property
    def start_ns(self) -> int:
        return self._replay.start_ns

    @property
    def end_ns(self) -> int:
        return self._replay.end_ns

    @property
    def speed(self) -> float:
        return self._replay.speed

    @property
    def front_ns(self) -> int:
        """How far it was flown."""
        return max(self._replay.now_ns, self._flight.span_ns[1])

    @property
    def now_ns(self) -> int:
        past = self._past
        if past is None:
            return self._replay.now_ns
        if not past.playing:
            return past.at_ns
        played_ns = (time.monotonic() - past.since_s) * min(self.speed, FASTEST) * 1e9
        return min(past.at_ns + round(played_ns), self.front_ns)

    @property
    def playing(self) -> bool:
        past = self._past
        return self._replay.playing if past is None else past.playing

    @property
    def back(self) -> bool:
        return self._past is not None

    def step(self) -> None:
        """Hand over to the replay where its front is reached; to be called again and again."""
        past = self._past
        if past and past.playing and self.now_ns >= self.front_ns:
            self._past = None
            self._replay.play()

    def play(self) -> None:
        if self._past:
            self._go(self.now_ns, playing=True)
        else:
            self._replay.play()

    def pause(self) -> None:
        if self._past:
            self._go(self.now_ns, playing=False)
        else:
            self._replay.pause()

    def seek(self, t_ns: int) -> None:
        t_ns = min(max(t_ns, self.start_ns), self.end_ns)
        playing = self.playing
        if t_ns < self.front_ns:
            self._replay.pause()
            hurried = math.isinf(self.speed) or self.now_ns >= self.end_ns  # it would run away from there
            self._go(t_ns, playing=playing and not hurried)
            return
        self._past = None
        self._replay.seek(t_ns)
        if playing:
            self._replay.play()

    def set_speed(self, speed: float) -> None:
        now_ns, past = self.now_ns, self._past
        self._replay.set_speed(speed)
        if past:
            self._go(now_ns, playing=past.playing)

    def _go(self, t_ns: int, *, playing: bool) -> None:
        self._past = Past(t_ns, playing, time.monotonic())
