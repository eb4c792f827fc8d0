"""The flight's own clock: boot time to UTC, one line per boot.

A vehicle stamps its messages with the time since boot. Two things tie that to UTC: SYSTEM_TIME, which carries
both (zero before the first fix), and the receiver's stamps, which are late by an unknown, varying delay.
Without SYSTEM_TIME the line under all points (boot time, receipt − boot time) is taken: it goes through the
messages that were delayed least, where a mean would be late by the mean delay (Moon, Skelly & Towsley,
INFOCOM 1999).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from gcs.contract.limits import LAST_NS

MS, US, S = 1_000_000, 1_000, 1_000_000_000  # in nanoseconds
FIRST_UNIX_US = 1_262_304_000_000_000  # 2010-01-01: an earlier SYSTEM_TIME was never set by a receiver
LAST_UNIX_US = LAST_NS // US  # 2100: a later one is a fault, and may be no int64
AGREE_NS = 1 * S  # SYSTEM_TIMEs of one boot further apart were sent before the clock was set, or it jumped
RESTART_MS = 3_000  # boot time going back by more is a restart; less is two links out of step
LEAP_MS = 10_000  # boot time leaping ahead by more, and receipt not with it, is another log appended
TAKE_TURNS, FEW = 8, 50  # so many restarts, every few messages: two vehicles with one system id
GONE_MS = 10_000  # … of which the second is taken after such a silence of the first
WRAP_MS = 1 << 32  # time_boot_ms is 32 bits: 49.7 days
WRAP_GUARD_MS = 600_000
STAMP_TOLERANCE_US = 1_000_000  # links interleave; a stamp further outside its neighbours is damaged
MAX_DELAY_NS = 10 * S  # nothing is received later than this, nor before it was sent
BLOCK_NS = 10 * S  # the envelope is drawn through one low point per block
MAX_DRIFT = 5e-3  # ceramic resonators stay within 0.5 %; a steeper line says the stamps are not receipt times


class Boot(NamedTuple):
    """One boot of one vehicle in one log."""

    first: int  # frame numbers [first, stop)
    stop: int
    start_ns: int  # boot time of its first and last message
    end_ns: int
    source: str  # "SYSTEM_TIME" | "receipt"
    offset_ns: int  # UTC minus boot time, at boot time zero
    drift: float  # growth of that offset per unit of boot time
    jumps: int = 0  # SYSTEM_TIMEs that contradict it


def to_utc(boot: Boot, boot_ns: np.ndarray) -> np.ndarray:
    """UTC ns (int64) of boot times in ns (int64)."""
    drift_ns = np.rint(boot.drift * boot_ns).astype(np.int64) if boot.drift else 0
    return boot.offset_ns + boot_ns + drift_ns


def restarts(boot_ms: np.ndarray, receipt_us: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(starts, unwrapped): where a new boot begins, and boot time in ms with the 32-bit wrap taken out.

    ``boot_ms``, ``receipt_us`` (n,) int64 in arrival order, receipt already repaired.
    """
    step = np.diff(boot_ms)
    wrapped = (boot_ms[:-1] > WRAP_MS - WRAP_GUARD_MS) & (boot_ms[1:] < WRAP_GUARD_MS)
    unwrapped_back = (boot_ms[1:] > WRAP_MS - WRAP_GUARD_MS) & (boot_ms[:-1] < WRAP_GUARD_MS)
    turns = np.concatenate([[0], np.cumsum(wrapped.astype(np.int64) - unwrapped_back)])
    elsewhere = np.abs(np.diff(receipt_us) // 1000 - step) > LEAP_MS
    new = ~wrapped & ~unwrapped_back & ((step < -RESTART_MS) | ((step > LEAP_MS) & elsewhere))
    starts = np.concatenate([[0], np.flatnonzero(new) + 1])
    return starts, boot_ms + turns * WRAP_MS


def interleaved(boot_ms: np.ndarray, receipt_us: np.ndarray) -> np.ndarray:
    """(n,) bool: messages of a second vehicle with the same system id, among (n,) of both in arrival order.

    Two boot clocks that take turns look like a restart every few messages, which no vehicle does. Then the
    one that was there first is followed: what goes back, or ahead of receipt, is the other's.
    """
    starts, _ = restarts(boot_ms, receipt_us)
    if len(starts) < TAKE_TURNS or len(boot_ms) / len(starts) > FEW:
        return np.zeros(len(boot_ms), bool)
    return _not_followed(boot_ms, receipt_us // 1000)


@njit(cache=True)
def _not_followed(boot_ms, receipt_ms):
    other = np.zeros(boot_ms.size, np.bool_)
    last = 0
    for i in range(1, boot_ms.size):
        step = boot_ms[i] - boot_ms[last]
        wrapped = boot_ms[last] > WRAP_MS - WRAP_GUARD_MS and boot_ms[i] < WRAP_GUARD_MS
        ahead = step - max(receipt_ms[i] - receipt_ms[last], 0) > RESTART_MS
        if not wrapped and (step < -RESTART_MS or ahead):
            other[i] = abs(receipt_ms[i] - receipt_ms[last]) < GONE_MS
        if not other[i]:
            last = i
    return other


def from_system_time(
    unix_us: np.ndarray, boot_ns: np.ndarray, received_ns: np.ndarray
) -> tuple[int | None, int]:
    """(UTC minus boot time in ns, how many SYSTEM_TIMEs contradict it) of one boot, (n,) int64 each.

    Where SYSTEM_TIME jumps against boot time, the offset that the receiver's clock agrees with is kept, else
    that of most messages. None where none was set.
    """
    is_set = (unix_us >= FIRST_UNIX_US) & (unix_us < LAST_UNIX_US)
    if not is_set.any():
        return None, 0
    offset = unix_us[is_set].astype(np.int64) * US - boot_ns[is_set]
    delay = np.sort(received_ns[is_set] - boot_ns[is_set])[np.count_nonzero(is_set) // 2]
    ordered = np.sort(offset)
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > AGREE_NS) + 1)
    kept = max(groups, key=lambda group: (abs(group[len(group) // 2] - delay) <= AGREE_NS, len(group)))
    near = kept - kept[0]
    return int(kept[0]) + int(near.mean()), len(offset) - len(kept)


def lower_envelope(sent_ns: np.ndarray, received_ns: np.ndarray) -> tuple[int, float]:
    """(offset_ns at sent time zero, drift) of the line under ``received − sent`` ((n,) int64 each, n ≥ 1).

    The second lowest value of each block stands for it, so that one wrong stamp cannot pull the line down;
    the hull's edge above the mean of the blocks is the line. No drift where the blocks are fewer than three.
    """
    offset = received_ns - sent_ns
    base, origin = int(offset[0]), int(sent_ns.min())
    low = _second_lowest((sent_ns - origin) // BLOCK_NS, offset)
    x, y = (sent_ns[low] - origin).astype(float), (offset[low] - base).astype(float)
    slope, height = 0.0, y.min()
    if x.size >= 3:
        hull = _lower_hull(x, y)
        right = min(max(int(np.searchsorted(x[hull], x.mean())), 1), hull.size - 1)
        i, j = hull[right - 1], hull[right]
        edge = (y[j] - y[i]) / (x[j] - x[i])
        if abs(edge) <= MAX_DRIFT:
            slope, height = edge, y[i] - edge * x[i]
    return base + round(height - slope * origin), slope


@njit(cache=True)
def _second_lowest(block, values):
    """Index of the second lowest value of each block that has any (of the lowest where it is alone)."""
    best = np.full((block.max() + 1, 2), -1, np.int64)
    for i in range(block.size):
        pair = best[block[i]]
        if pair[0] < 0 or values[i] < values[pair[0]]:
            pair[0], pair[1] = i, pair[0]
        elif pair[1] < 0 or values[i] < values[pair[1]]:
            pair[1] = i
    best = best[best[:, 0] >= 0]
    return np.where(best[:, 1] >= 0, best[:, 1], best[:, 0])


@njit(cache=True)
def _lower_hull(x, y):
    """Indices of the lower convex hull of points with x ascending (Andrew's monotone chain)."""
    hull = np.empty(x.size, np.int64)
    n = 0
    for i in range(x.size):
        while n >= 2:
            a, b = hull[n - 2], hull[n - 1]
            if (x[b] - x[a]) * (y[i] - y[a]) - (y[b] - y[a]) * (x[i] - x[a]) > 0:
                break
            n -= 1
        hull[n] = i
        n += 1
    return hull[:n].copy()


@njit(cache=True)
def repair_stamps(receipt_us):
    """(repaired, dropped): each stamp that cannot be true replaced by the one before it, and how many.

    A stamp must be before 2100, and lie between the median of the three before it and of the three after it.
    That finds damaged ones and lets the jumps through where logs were joined.
    """
    n = receipt_us.size
    out = receipt_us.copy()
    dropped = 0
    for i in range(n):
        before = _median_of_three(receipt_us, max(i - 3, 0)) if i else receipt_us[i]
        after = _median_of_three(receipt_us, min(i + 1, n - 3)) if i < n - 1 else receipt_us[i]
        low, high = min(before, after) - STAMP_TOLERANCE_US, max(before, after) + STAMP_TOLERANCE_US
        if not 0 <= receipt_us[i] < LAST_UNIX_US or (n >= 4 and not low <= receipt_us[i] <= high):
            out[i] = -1
            dropped += 1
    believed = out[out >= 0]
    newest = believed[0] if believed.size else np.int64(0)
    for i in range(n):
        if out[i] < 0:
            out[i] = newest
        newest = out[i]
    return out, dropped


@njit(cache=True)
def _median_of_three(values, i):
    if values.size < 3:
        return values[i]
    a, b, c = values[i], values[i + 1], values[i + 2]
    return max(min(a, b), min(max(a, b), c))
