"""Vendor bytes in, our messages out. One file per source; ``decode`` is pure, ``run`` does the I/O."""
