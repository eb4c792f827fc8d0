"""Where a replay stands in time: played, paused, sought, at any speed."""

import threading
import time

import numpy as np

STEP_NS = 1_000_000_000  # data taken in one go at full speed: long enough to be quick, short enough to seek
EMPTY_NS = 10_000_000_000  # a stretch without data longer than this is not waited for, at any speed
TICK_S = 0.02  # pace of the loop at a given speed


class Playback:
    """Where the replay stands; the view's buttons work it, the replay obeys.

    ``times_ns`` (n,), in order, are the times of the data: where there are none for long, as between two logs
    that were joined, time goes on at the next.
    """

    def __init__(self, start_ns: int, end_ns: int, times_ns: np.ndarray, speed: float):
        self.start_ns, self.now_ns = start_ns, start_ns
        self.end_ns = max(end_ns, start_ns + 1)  # a flight of one instant ends as well
        self._times_ns = times_ns
        self.speed, self.playing = speed, True
        self.stopped = False
        self._goal_ns: int | None = None
        self._changed = threading.Condition()
        self._mark()

    def play(self) -> None:
        self._set(playing=True)

    def pause(self) -> None:
        self._set(playing=False)

    def set_speed(self, speed: float) -> None:
        self._set(speed=speed)

    def seek(self, t_ns: int) -> None:
        self._set(_goal_ns=int(np.clip(t_ns, self.start_ns, self.end_ns)))

    def stop(self) -> None:
        self._set(stopped=True)

    def upto(self) -> int | None:
        """How far to go now, waiting while there is nothing to do; None: start anew, the goal lies behind."""
        with self._changed:
            while not self.stopped:
                if self._goal_ns is not None and self._goal_ns < self.now_ns:
                    self.now_ns = self.start_ns
                    return None
                target_ns = self._target_ns()
                if target_ns > self.now_ns:
                    self.now_ns = target_ns
                    return target_ns
                self._changed.wait(TICK_S)
            return self.now_ns

    def _target_ns(self) -> int:
        """Where time has come to: a seek hurries, a pause stands still."""
        if self._goal_ns is not None and self.now_ns < self._goal_ns:
            return min(self._goal_ns, self._hurried_ns())
        if self._goal_ns is not None:
            self._goal_ns = None
            self._mark()
        if not self.playing:
            return self.now_ns
        if self.speed == float("inf"):
            return min(self.end_ns, self._hurried_ns())
        if self._next_ns() - self.now_ns > EMPTY_NS:
            self._from_s, self._from_ns = time.monotonic(), self._next_ns()
        return min(self.end_ns, self._from_ns + round((time.monotonic() - self._from_s) * self.speed * 1e9))

    def _hurried_ns(self) -> int:
        return max(self.now_ns + STEP_NS, self._next_ns())

    def _next_ns(self) -> int:
        """When there are data again, or the end."""
        following = int(np.searchsorted(self._times_ns, self.now_ns, side="right"))
        return int(self._times_ns[following]) if following < len(self._times_ns) else self.end_ns

    def _set(self, **changes) -> None:
        with self._changed:
            for name, value in changes.items():
                setattr(self, name, value)
            self._mark()
            self._changed.notify_all()

    def _mark(self) -> None:
        """From here on, time runs at ``speed``."""
        self._from_s, self._from_ns = time.monotonic(), self.now_ns
