"""Line segments on the page, by name: drawn, changed or taken away with one call."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import viser

from web.look.colours import Colour, linear


class Lines:
    """All line nodes of a page. A width is in pixels, or in metres with ``units="world"``."""

    def __init__(self, api: viser.SceneApi):
        self._api = api
        self._shown: dict[str, viser.LineSegmentsHandle] = {}

    def draw(
        self,
        name: str,
        segments: np.ndarray,
        colour: Colour | np.ndarray,
        width: float,
        units: Literal["screen", "world"] = "screen",
    ) -> None:
        """Show (n, 2, 3) segments in place of what has that name; with n = 0 nothing is left.

        ``colour`` is one for all, or (n, 2, 3) uint8, one for each end.
        """
        if isinstance(colour, np.ndarray):
            colour = linear(colour)  # as the browser takes it; one colour for all it takes as it is
        shown = self._shown.get(name)
        if len(segments) == 0:
            if shown:
                self._shown.pop(name).remove()
        elif shown and np.array_equal(shown.points, np.asarray(segments, np.float32)) and same(shown, colour):
            return  # what the browser has already is not sent again
        elif shown and shown.colors.ndim == 1 and not isinstance(colour, np.ndarray):
            shown.points = np.asarray(segments, np.float32)
            if not same(shown, colour):
                shown.colors = np.asarray(colour, np.uint8)
        else:  # also where each end has a colour: points and colours must come as one
            self._shown[name] = self._api.add_line_segments(
                name, segments, colour, thickness=width, thickness_units=units
            )

    def drawer(self, colour: Colour, width: float) -> Callable[[str, np.ndarray], None]:
        """``draw`` with its colour and width in pixels chosen."""
        return lambda name, segments: self.draw(name, segments, colour, width)

    def recolour(self, under: str, colour: Colour) -> None:
        """Give everything whose name begins so one colour."""
        for name, shown in self._shown.items():
            if name.startswith(under):
                shown.colors = np.asarray(colour, np.uint8)


def same(shown: viser.LineSegmentsHandle, colour: Colour | np.ndarray) -> bool:
    return np.array_equal(shown.colors, np.asarray(colour, np.uint8))
