"""Parts that run beside one another: what fails is logged, told and started again; what hangs is noticed.

A part is a function that works until it is told to stop, in a thread of its own. Whoever asks whether to stop
shows by this that he is alive, so no part needs to know of the watchdog:

    part ──► stop.is_set(), stop.wait(…) ──► heartbeat ──► watchdog: a part that is silent hangs

What happens to a part goes to the logger ``gcs``; ``gcs/outputs/log.py`` makes a file and events of it.
No duration here is taken from the wall clock, which a time server may set; that it was set is told.
"""

import contextlib
import logging
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from gcs.contract.messages import InputError, PartHealth

WAITS_S = (
    0.5,
    1.0,
    2.0,
    5.0,
    10.0,
    30.0,
)  # before a part starts again: after the first failure, the second …
BEGIN_S = 5.0  # input that cannot be used is the operator's to mend if it shows within this of the start
STEADY_S = 60.0  # a part that has worked for so long has recovered: its next failure is a first one
HUNG_S = 5.0  # a loop here turns ten times a second or more; so long without a turn is no busy moment
CHECK_S = 0.5
STEP_S = 2.0  # a clock that is off by more than this was set, and did not drift
END_S = 5.0  # a part that does not end when told to is left behind after this

log = logging.getLogger("gcs")


class Pulse(threading.Event):
    """The stop event of one part; whoever asks it is alive."""

    def __init__(self, name: str, stop: threading.Event):
        super().__init__()
        self.name, self._stop = name, stop
        self.thread = 0  # who asked last
        self.hung = False
        self._due_s = time.monotonic()

    @property
    def silent_s(self) -> float:
        """How long the next question is overdue."""
        return time.monotonic() - self._due_s

    @property
    def running(self) -> bool:
        """Has it begun, and neither ended nor been told to?"""
        return self.thread in sys._current_frames() and not self._stop.is_set()

    def is_set(self) -> bool:
        self._beat()
        return self._stop.is_set()

    def wait(self, timeout: float | None = None) -> bool:
        self._beat(float("inf") if timeout is None else timeout)
        try:
            return self._stop.wait(timeout)
        finally:
            self._beat()

    def set(self) -> None:
        self._stop.set()

    def excuse(self, seconds: float) -> None:
        """For so long nobody could have asked."""
        self._due_s += seconds

    def _beat(self, until_s: float = 0.0) -> None:
        self.thread, self._due_s = threading.get_ident(), time.monotonic() + until_s


class Backoff:
    """When something that has failed may be tried again: later each time, up to a bound."""

    def __init__(self) -> None:
        self.failures = 0  # all of them
        self.in_a_row = 0  # without recovery between them
        self._began_s = self._again_s = time.monotonic()

    def begin(self) -> None:
        """It is tried now."""
        self._began_s = time.monotonic()

    @property
    def lasted_s(self) -> float:
        """How long the present try has lasted."""
        return time.monotonic() - self._began_s

    def fail(self) -> float:
        """It has failed: how many seconds to wait."""
        self.in_a_row = 0 if self.lasted_s > STEADY_S else self.in_a_row
        wait_s = WAITS_S[min(self.in_a_row, len(WAITS_S) - 1)]
        self.in_a_row += 1
        self.failures += 1
        self._again_s = time.monotonic() + wait_s
        return wait_s

    @property
    def due(self) -> bool:
        """Has the wait passed?"""
        return time.monotonic() >= self._again_s


class Part(threading.Thread):
    """One part: ``work`` is called with its stop event, and again after every failure until that is set.

    An ``InputError`` at the start is the operator's to mend: it ends all, see `Supervisor`.
    """

    def __init__(self, name: str, work: Callable[[threading.Event], None], stop: threading.Event):
        super().__init__(name=name, daemon=True)
        self.pulse, self.backoff = Pulse(name, stop), Backoff()
        self.unusable: InputError | None = None
        self._work, self._waiting = work, False

    def health(self) -> PartHealth:
        running = self.is_alive() and not self._waiting
        return PartHealth(running=running, hung=self.pulse.hung, failures=self.backoff.failures)

    def run(self) -> None:
        while not self.pulse.is_set():
            self.backoff.begin()
            try:
                self._work(self.pulse)
                return
            except InputError as error:
                if not self.backoff.failures and self.backoff.lasted_s < BEGIN_S:
                    self.unusable = error
                    self.pulse.set()
                    return
                self._again(error, trace=False)
            except Exception as error:  # whatever it is: the flight goes on
                self._again(error, trace=True)

    def _again(self, error: Exception, *, trace: bool) -> None:
        wait_s = self.backoff.fail()
        text = "%s failed: %s; starts again in %g s, failure %d"
        log.error(text, self.name, brief(error), wait_s, self.backoff.failures, exc_info=trace)
        self._waiting = True
        self.pulse.wait(wait_s)
        self._waiting = False
        if not self.pulse.is_set():
            log.info("%s starts again", self.name)


class Clocks:
    """Notices a machine that slept, a process that was stopped, and a wall clock that was set."""

    def __init__(self) -> None:
        self._before = self._read()

    def look(self) -> float:
        """To be called every CHECK_S; says what happened since, and how many seconds nothing could run."""
        now, before = self._read(), self._before
        self._before = now
        running_s, asleep_s, set_s = (n - b for n, b in zip(now, before, strict=True))
        stopped_s = running_s - CHECK_S
        if abs(set_s) > STEP_S:
            log.warning("the wall clock was set by %+.1f s; the flight's time goes on as before", set_s)
        if asleep_s > STEP_S:
            log.warning("the machine slept for %.1f s", asleep_s)
        if stopped_s > STEP_S:
            log.warning("the station stood still for %.1f s", stopped_s)
        return stopped_s if stopped_s > STEP_S else 0.0

    @staticmethod
    def _read() -> tuple[float, float, float]:
        """Seconds it ran, seconds it slept beside these, and wall clock less both."""
        ran_s = time.monotonic()
        boot = getattr(time, "CLOCK_BOOTTIME", None)  # counts sleep too, where there is such a clock
        since_boot_s = ran_s if boot is None else time.clock_gettime(boot)
        return ran_s, since_boot_s - ran_s, time.time() - since_boot_s


class Reporting(Protocol):
    """What says itself how it does."""

    @property
    def name(self) -> str: ...

    def health(self) -> PartHealth: ...


class Supervisor:
    """All parts of one process and the watchdog over them. Use it in a ``with``: it ends them.

    Raises at its end the ``InputError`` of a part that could never begin.
    """

    def __init__(self, stop: threading.Event):
        self._stop, self._over = stop, threading.Event()
        self.others: Sequence[Reporting] = ()  # what has no thread of its own and can fail: sinks
        self._parts: list[Part] = []
        self._adopted: list[Part] = []
        self._pulses: list[Pulse] = []
        self._watchdog = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def start(
        self, name: str, work: Callable[[threading.Event], None], stop: threading.Event | None = None
    ) -> Part:
        """Let ``work`` run until the stop event that it is given is set: that of all, or ``stop``."""
        part = Part(name, work, stop or self._stop)
        self._parts.append(part)
        self._pulses.append(part.pulse)
        part.start()
        return part

    def adopt(self, part: Part) -> None:
        """Watch a part that somebody else started and will end."""
        self._adopted.append(part)
        self._pulses.append(part.pulse)

    @contextlib.contextmanager
    def watched(self, name: str, stop: threading.Event) -> Iterator[Pulse]:
        """The stop event for a loop in the caller's own thread, watched like a part."""
        pulse = Pulse(name, stop)
        self._pulses.append(pulse)
        try:
            yield pulse
        finally:
            self._pulses.remove(pulse)

    def health(self) -> dict[str, PartHealth]:
        """How each part does."""
        found = {pulse.name: PartHealth(hung=pulse.hung) for pulse in list(self._pulses)}
        reporting = [*self._parts, *self._adopted, *self.others]
        return found | {part.name: part.health() for part in reporting}

    def __enter__(self) -> "Supervisor":
        self._watchdog.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._stop.set()
        end_s = time.monotonic() + END_S
        for part in self._parts:
            part.join(max(0.0, end_s - time.monotonic()))
            if part.is_alive():
                log.error("%s does not end; left behind", part.name)
        self._over.set()
        self._watchdog.join()
        unusable = next((part.unusable for part in self._parts if part.unusable), None)
        if unusable and kind is None:
            raise unusable

    def _watch(self) -> None:
        clocks = Clocks()
        while not self._over.wait(CHECK_S):
            away_s = clocks.look()
            for pulse in list(self._pulses) if away_s else ():
                pulse.excuse(away_s)
            for pulse in list(self._pulses):
                hung = pulse.silent_s > HUNG_S and pulse.running
                if hung and not pulse.hung:
                    text = "%s has hung for %g s; where it stands is in station.log"
                    log.error(text, pulse.name, HUNG_S, extra={"stack": stack_of(pulse.thread)})
                elif pulse.hung and not hung:
                    log.warning("%s goes on", pulse.name)
                pulse.hung = hung


def stack_of(thread: int) -> str:
    """Where a thread stands now, as a traceback; "" when it is gone."""
    frame = sys._current_frames().get(thread)
    return "".join(traceback.format_stack(frame)) if frame else ""


def brief(error: BaseException) -> str:
    """An exception in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")[:200]


def guarded(who: str, call: Callable[..., None]) -> Callable[..., None]:
    """``call``, for a library that calls us in its own thread: what it raises is logged under ``who``."""

    def safe(*arguments: object) -> None:
        try:
            call(*arguments)
        except Exception as error:  # the library would print it where nobody looks
            log.exception("%s failed: %s", who, brief(error))

    return safe
