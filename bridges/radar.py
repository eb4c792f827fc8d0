"""A tracking radar: range, azimuth, elevation; range rate if it has it. Format: ``bridges.feed``."""

from functools import partial

from bridges import feed

COLUMNS = feed.COLUMNS

read = partial(feed.read, columns=COLUMNS)
decode = partial(feed.decode, columns=COLUMNS)
run = partial(feed.run, columns=COLUMNS)

LINK, RATE_HZ = "udp", 10.0
