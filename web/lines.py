"""Line segments on the page, by name: drawn, changed or taken away with one call."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import viser

from web.colours import Colour


class Lines:
    """All line nodes of a page. A width is in pixels, or in metres with ``units="world"``."""

    def __init__(self, api: viser.SceneApi):
        self._api = api
        self._shown: dict[str, viser.LineSegmentsHandle] = {}

    def draw(
        self,
        name: str,
        segments: np.ndarray,
        colour: Colour,
        width: float,
        units: Literal["screen", "world"] = "screen",
    ) -> None:
        """Show (n, 2, 3) segments in place of what has that name; with n = 0 nothing is left."""
        shown = self._shown.get(name)
        if len(segments) == 0:
            if shown:
                self._shown.pop(name).remove()
        elif shown:
            shown.points = np.asarray(segments, np.float32)
        else:
            self._shown[name] = self._api.add_line_segments(
                name, segments, colour, thickness=width, thickness_units=units
            )

    def drawer(self, colour: Colour, width: float) -> Callable[[str, np.ndarray], None]:
        """``draw`` with its colour and width in pixels chosen."""
        return lambda name, segments: self.draw(name, segments, colour, width)

    def set_width(self, under: str, width: float) -> None:
        for name, shown in self._shown.items():
            if name.startswith(under):
                shown.thickness = width
