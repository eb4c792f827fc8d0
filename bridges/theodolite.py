"""An optical theodolite: azimuth, elevation, and slant range with a laser. Format: ``bridges.feed``."""

from functools import partial

from bridges import feed

COLUMNS = tuple(name for name in feed.COLUMNS if not name.endswith("range_rate_mps"))

read = partial(feed.read, columns=COLUMNS)
decode = partial(feed.decode, columns=COLUMNS)
run = partial(feed.run, columns=COLUMNS)

LINK, RATE_HZ = "udp", 20.0
