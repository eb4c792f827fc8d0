"""The kinds of instrument. A kind is a module of this folder and a line here; see CONTRIBUTING.md."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from bridges import radar, theodolite
from gcs.contract.messages import Bad

Feed = tuple[np.ndarray, list[Bad]]  # (n,) POLAR in file order, and what could not be read


class Kind(Protocol):
    """What such a module offers."""

    LINK: str  # udp: it listens for datagrams; tcp: it connects to the instrument
    RATE_HZ: float  # usual for the kind, of a simulated one

    @property
    def read(self) -> Callable[[Path, str], Feed]:
        """A feed file after the flight: path, sensor's name."""

    @property
    def run(self) -> Callable[..., None]:
        """The instrument onto the bus until it is stopped; parameters as ``feed.run`` without ``columns``."""


KINDS: dict[str, Kind] = {"theodolite": theodolite, "radar": radar}
