"""What a state rests on: which sensors say where the target is, and from when till when that is too few.

Spans are (begin, end) in ns, in order and apart.
"""

import numpy as np

from filters.models.rows import AZIMUTH, ELEVATION, RANGE, E, N, U

PLACE = (RANGE, AZIMUTH, ELEVATION, E, N, U)  # channels that say where the target is

Spans = tuple[tuple[int, int], ...]


def witnesses(sensor: np.ndarray, channel: np.ndarray, used: np.ndarray) -> tuple[int, int]:
    """How many sensors confirm where a state has the target, and how many say where it is at all.

    Of rows (k,); ``used`` (k,) bool by the state. Who confirms it has more than half of its values used.
    """
    place = np.isin(channel, PLACE)
    count = np.bincount(sensor[place])
    good = np.bincount(sensor[place], used[place], len(count))
    return int((2 * good > count).sum()), int((count > 0).sum())


def with_span(spans: Spans, begin_ns: int, end_ns: int) -> Spans:
    """``spans`` and one that begins after the last of them does, as one with it where they meet."""
    if spans and begin_ns <= spans[-1][1]:
        return (*spans[:-1], (spans[-1][0], max(spans[-1][1], end_ns)))
    return (*spans, (begin_ns, end_ns))


def within(spans: Spans, t_ns: np.ndarray) -> np.ndarray:
    """(k,) bool, which of ``t_ns`` (k,) are in one of ``spans``."""
    found = np.zeros(len(t_ns), bool)
    for begin_ns, end_ns in reversed(spans):  # after hours there are many, and the newest are asked for
        if end_ns <= t_ns.min(initial=np.iinfo(np.int64).max):
            break
        found |= (begin_ns <= t_ns) & (t_ns < end_ns)
    return found
