"""Arrival times: UTC as the machine had it when the process began, carried on by a clock that nobody sets.

A clock that NTP or an operator sets while measurements come in would look like all of them jumping. What was
wrong with it at the start stays wrong by the same amount, and that shows. Where the system has such a clock
(Linux), it goes on while the machine sleeps.
"""

import time

_GOES_ON = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
_BEGAN_NS = time.time_ns() - time.clock_gettime_ns(_GOES_ON)


def now_ns() -> int:
    """UTC ns, by the station's own clock."""
    return _BEGAN_NS + time.clock_gettime_ns(_GOES_ON)
