"""An optical theodolite: azimuth, elevation, and slant range with a laser. Format: ``bridges.feed``."""

from functools import partial

from bridges import feed

COLUMNS = ("t", "range_m", "azimuth_deg", "elevation_deg")

read = partial(feed.read, columns=COLUMNS)
decode = partial(feed.decode, columns=COLUMNS)
run = partial(feed.run, columns=COLUMNS)

LINK, RATE_HZ = "udp", 20.0
