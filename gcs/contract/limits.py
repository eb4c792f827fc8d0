"""What a value on the wire can be: one set of limits for every bridge and for the station.

Beyond them a number is a fault of the feed and no measurement. They are wide on purpose: what an instrument
could say of any aircraft that is served here passes, and the estimator judges it.
"""

from datetime import UTC, datetime

POLAR = {
    "range_m": (0.0, 1e6),  # 1,000 km: no instrument of a test range sees farther
    "azimuth_deg": (-360.0, 720.0),  # instruments count turns, one up and one down
    "elevation_deg": (-90.0, 90.0),
    "range_rate_mps": (-3e3, 3e3),  # Mach 9: no aircraft that is served here
}
SIGMA = {  # 1-sigma of one value, of the station file and of a feed's row alike
    "range_m": (1e-6, 1e3),  # a micrometre: no instrument is better, and its square is still a number
    "azimuth_deg": (1e-7, 10.0),  # 0.4 milliseconds of arc; beyond 10° the small-angle noise model is none
    "elevation_deg": (1e-7, 10.0),
    "range_rate_mps": (1e-6, 1e3),
}
CHANNEL = {  # by channel, in the units of the input
    **{name.rsplit("_", 1)[0]: limits for name, limits in POLAR.items()},
    **dict.fromkeys(("e", "n", "u"), (-1e6, 1e6)),  # m from the station's origin
    **dict.fromkeys(("ve", "vn", "vu"), (-3e3, 3e3)),  # m/s
    **dict.fromkeys(("ae", "an", "au"), (-1e3, 1e3)),  # m/s²: a hundred g
}
FIRST_NS, LAST_NS = (int(datetime(year, 1, 1, tzinfo=UTC).timestamp()) * 10**9 for year in (2000, 2100))
WIRE_NS = 2**62  # a time on the bus lies within ± this: half of int64, so no latency taken off overflows
FASTEST = 1e6  # times real time, of a file that is played: an hour in 4 ms
LONGEST_S = 1e7  # of a run whose end is set beforehand: four months; a timer takes no more than 292 years
TEXT = 200  # characters of damaged input, or of a reason, that travel on and reach verdicts.csv
LARGEST_BYTES = 65_536  # of one message: no datagram is larger, and ours have some hundred bytes


def between(limits: tuple[float, float]) -> str:
    """The limits in words: ``0 to 1000000``."""
    return " to ".join(f"{x:.0f}" if x == round(x) else f"{x:g}" for x in limits)
