"""What a live flight goes on without: a sink that fails is set aside, an estimator that fails begins anew.

A replay ends at the first failure instead, since it can be repeated.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np

from filters.models.rows import TRACK, VERDICT, Step
from filters.smoother.estimator import FixedLagSmoother
from filters.smoother.snapshots import WrongClock
from gcs.contract.messages import PartHealth
from gcs.contract.supervision import Backoff, brief, log

if TYPE_CHECKING:  # the session uses this file
    from gcs.station.session import Sink, Update


class GuardedSink:
    """A sink that may fail: what it missed meanwhile is counted, and nobody else waits for it."""

    def __init__(self, sink: "Sink"):
        self.name, self._sink = getattr(sink, "name", type(sink).__name__.lower()), sink
        self.backoff, self.missed = Backoff(), 0  # rows it was not given: states, and verdicts that are final
        self._aside = False

    def health(self) -> PartHealth:
        return PartHealth(running=not self._aside, failures=self.backoff.failures)

    def take(self, update: "Update") -> None:
        if self._aside and not self.backoff.due:
            self.missed += len(update.track) + len(update.retired)
            return
        self.backoff.begin()
        try:
            self._sink.take(update)
        except Exception as error:  # whatever it is: the flight goes on
            self.missed += len(update.track) + len(update.retired)
            wait_s, self._aside = self.backoff.fail(), True
            text = "%s failed: %s; set aside for %g s, failure %d"
            log.exception(text, self.name, brief(error), wait_s, self.backoff.failures)
            return
        if self._aside:
            self._aside = False
            log.warning("%s works again; it missed %d states and values so far", self.name, self.missed)

    def close(self, summary: dict, best: np.ndarray) -> None:
        try:
            self._sink.close(summary, best)
        except Exception as error:  # one sink's end must not cost the others theirs
            self.backoff.fail()
            self._aside = True
            log.exception("%s could not be ended: %s", self.name, brief(error))
        else:
            self._aside = False


class Estimator(Protocol):
    """As `filters.methods.make` gives it."""

    def warm_up(self) -> None: ...

    def step(self, rows: np.ndarray) -> Step: ...

    def finish(self) -> Step: ...

    def smooth(self) -> np.ndarray: ...

    def report(self) -> dict: ...


class Relay:
    """An estimator and its successors: where one fails, the next begins with the rows that come after."""

    forgiving = False  # else a failure is raised

    def __init__(self, make: Callable[[], Estimator]):
        self._now, self._make = make(), make
        self._before: list[np.ndarray] = []  # best estimates (k,) TRACK of those that failed
        self._resets = self._newest = 0  # starts before the present one's first; the newest one told
        self.failures = 0
        self._failed: Exception | None = None  # at rest, not told yet

    def warm_up(self) -> None:
        self._now.warm_up()

    def step(self, rows: np.ndarray) -> Step:
        """As the estimator's. After a failure it is empty, and ``failures`` is one more."""
        try:
            if self._failed is not None:
                raise self._failed
            step = self._now.step(rows)
        except Exception as error:  # whatever it is: the flight goes on
            if not self.forgiving:
                raise
            self.failures, self._failed = self.failures + 1, None
            log.exception("the estimator failed: %s; it begins anew, failure %d", brief(error), self.failures)
            self._before.append(self._salvage())
            self._now, self._resets = self._make(), self._newest + 1
            return Step(np.zeros(0, TRACK), np.zeros(0, TRACK), np.zeros(0, VERDICT))
        for track in (step.track, step.smoothed):
            track["reset_counter"] += self._resets
        self._newest = int(step.track["reset_counter"].max(initial=self._newest))
        return step

    def rest(self, upto_ns: int) -> None:
        """As `FixedLagSmoother.rest`; the whole filters of the literature have nothing to do between steps.

        A failure is one of the next step.
        """
        if isinstance(self._now, FixedLagSmoother) and self._failed is None:
            try:
                self._now.rest(upto_ns)
            except Exception as error:  # whatever it is: the flight goes on
                if not self.forgiving:
                    raise
                self._failed = error

    def take_back(self, sensor: int, wrong: WrongClock) -> None:
        """As `FixedLagSmoother.take_back`; the whole filters of the literature take nothing back."""
        if isinstance(self._now, FixedLagSmoother):
            self._now.take_back(sensor, wrong)

    def finish(self) -> Step:
        step = self._now.finish()
        step.smoothed["reset_counter"] += self._resets
        return step

    def smooth(self) -> np.ndarray:
        last = self._now.smooth()
        if not self._before:
            return last  # not copied: of a day it is gigabytes, and may lie on the disk
        last["reset_counter"] += self._resets
        return np.concatenate([*self._before, last])

    def report(self) -> dict:
        return self._now.report() | ({"failures": self.failures} if self.failures else {})

    def _salvage(self) -> np.ndarray:
        """The best estimate of the one that has failed, if it can still say one."""
        try:
            self._now.finish()
            best = self._now.smooth()
        except Exception as error:  # it has failed before: whatever its state is, its successor begins
            log.exception("the best estimate before the failure is lost: %s", brief(error))
            return np.zeros(0, TRACK)
        best["reset_counter"] += self._resets
        return best
