"""The clock of one vehicle while its messages come in: boot time, and what ties it to UTC.

Boot time is monotonic and the better clock; SYSTEM_TIME says once what it is in UTC. So:

    until SYSTEM_TIME is set, UTC is boot time plus the least delay so far, by the station's clock;
    a SYSTEM_TIME that jumps against boot time once positions are out is told and not followed, unless the
    station's clock agrees with it and contradicts the one before;
    boot time that goes back, or leaps ahead of receipt, after a silence is a restart. Without one, two
    vehicles speak with one system id: the one that was there is kept, the other is told and not mixed in.
"""

from bridges.mavlink.flightclock import (
    AGREE_NS,
    FIRST_UNIX_US,
    GONE_MS,
    LAST_UNIX_US,
    LEAP_MS,
    MS,
    RESTART_MS,
    US,
    WRAP_GUARD_MS,
    WRAP_MS,
    S,
)

DRIFT = 1e-4  # the least delay may grow so fast: crystals drift, a link that stalls must not count
MEMORY = 64  # SYSTEM_TIMEs in the mean: a minute at one a second, so that a drift of the crystal is followed
QUIET_MS = 1_000  # no autopilot boots in less, and none that flies says nothing for so long
AGAIN_NS = 60 * S  # a state of affairs that lasts is told again after so long


class LiveClock:
    """See the module's text. ``told``: (level, text) for the operator, taken by whoever publishes it."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str]] = []
        self._rival: tuple[int, int] | None = None  # boot ms and receipt ns of another with this id
        self._rival_told_ns = -AGAIN_NS
        self._receipt_ns: int | None = None  # of the newest message; None: none yet
        self._restart(0)

    def _restart(self, boot_ms: int) -> None:
        self._boot_ms = boot_ms
        self._turns = 0
        self._known: tuple[int, int] = 0, 0  # SYSTEM_TIME offset: mean in ns, messages in it
        self._least: tuple[int, int] | None = None  # smallest receipt − boot time in ns, and its boot time
        self._jumped = False

    @property
    def known(self) -> bool:
        """Has a SYSTEM_TIME been set?"""
        return self._known[1] > 0

    def shared(self, receipt_ns: int) -> bool:
        """Does another vehicle speak with the same system id?"""
        return self._rival is not None and receipt_ns - self._rival[1] < GONE_MS * MS

    def boot_ns(self, boot_ms: int, receipt_ns: int) -> tuple[int | None, bool]:
        """(boot time in ns with the wrap taken out, has the vehicle restarted) for a message received now.

        No boot time for a message of another vehicle with the same system id.
        """
        wrapped = self._boot_ms > WRAP_MS - WRAP_GUARD_MS and boot_ms < WRAP_GUARD_MS
        restarted = False
        if self._receipt_ns is not None and not wrapped and self._elsewhere(boot_ms, receipt_ns):
            if self._is_rival(boot_ms, receipt_ns):
                self._tell_rival(boot_ms, receipt_ns)
                return None, False
            restarted = True
            self._restart(boot_ms)
        self._turns += wrapped
        self._boot_ms, self._receipt_ns = boot_ms, receipt_ns
        boot_ns = (boot_ms + self._turns * WRAP_MS) * MS
        delay = receipt_ns - boot_ns
        if self._least is None or delay < self._floor(boot_ns):
            self._least = delay, boot_ns
        return boot_ns, restarted

    def _elsewhere(self, boot_ms: int, receipt_ns: int) -> bool:
        step_ms, passed_ms = boot_ms - self._boot_ms, (receipt_ns - (self._receipt_ns or 0)) // MS
        return step_ms < -RESTART_MS or step_ms - max(passed_ms, 0) > LEAP_MS

    def _is_rival(self, boot_ms: int, receipt_ns: int) -> bool:
        silent_ms = abs(receipt_ns - (self._receipt_ns or 0)) // MS
        if silent_ms < QUIET_MS or self._rival is None:
            return silent_ms < QUIET_MS
        ran_ms = (receipt_ns - self._rival[1]) // MS
        return abs(boot_ms - self._rival[0] - ran_ms) < RESTART_MS and silent_ms < GONE_MS

    def _tell_rival(self, boot_ms: int, receipt_ns: int) -> None:
        self._rival = boot_ms, receipt_ns
        if receipt_ns - self._rival_told_ns >= AGAIN_NS:
            self._rival_told_ns = receipt_ns
            ran = f"one runs since {self._boot_ms / 1e3:.0f} s, the other since {boot_ms / 1e3:.0f} s"
            text = f"two vehicles with one system id ({ran}): the first is kept; give each an id of its own"
            self.told.append(("error", text))

    def _floor(self, boot_ns: int) -> int:
        least, since_ns = self._least or (0, boot_ns)
        return least + int(DRIFT * (boot_ns - since_ns))

    def system_time(self, unix_us: int, boot_ns: int, receipt_ns: int, *, in_use: bool) -> None:
        """Take in a SYSTEM_TIME: not set yet or impossible, it is passed over.

        ``in_use``: positions have been stamped in this boot, so that another offset would tear the track.
        """
        if not FIRST_UNIX_US <= unix_us < LAST_UNIX_US:
            return
        offset = unix_us * US - boot_ns
        mean, count = self._known
        if not count:
            mean = self._floor(boot_ns) if in_use else offset
        apart = offset - mean
        if abs(apart) <= AGREE_NS:
            self._known = mean + apart // min(count + 1, MEMORY), count + 1
            if self._jumped:
                self.told.append(("info", "SYSTEM_TIME agrees with boot time again"))
            self._jumped = False
            return
        delay = receipt_ns - boot_ns
        follow = not in_use or (abs(delay - offset) <= AGREE_NS < abs(delay - mean))
        if in_use and not self._jumped:
            kept = "followed, the station's clock agrees" if follow else "not followed, boot time goes on"
            self.told.append(
                ("warning", f"SYSTEM_TIME jumps by {apart / S:+.1f} s against boot time: {kept}")
            )
        self._jumped = in_use and not follow
        if follow:
            self._known = offset, 1

    def utc_ns(self, boot_ns: int) -> int:
        """UTC ns of a boot time in ns."""
        mean, count = self._known
        return boot_ns + (mean if count else self._floor(boot_ns))
