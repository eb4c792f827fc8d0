"""Dots on the page, by name: drawn, changed or taken away with one call.

A browser draws a hundred thousand of them in the time of a few thousand lines. Their size is in metres, so it
follows how far away they are looked at from: ``resize``.
"""

import numpy as np
import viser

from web.look.colours import Colour

DOT = 0.0012  # size as a share of the distance: about two pixels
AMISS = 1.25  # ratio by which a size may be wrong before it is sent anew


class Clouds:
    """All dots of a page."""

    def __init__(self, api: viser.SceneApi, distance_m: float):
        self._api, self._size_m = api, DOT * distance_m
        self._shown: dict[str, viser.PointCloudHandle] = {}

    def draw(self, name: str, places: np.ndarray, colour: Colour) -> None:
        """Show (n, 3) places in place of what has that name; with n = 0 nothing is left."""
        shown = self._shown.get(name)
        if not len(places):
            if shown:
                self._shown.pop(name).remove()
        elif not shown or not np.array_equal(shown.points, np.asarray(places, np.float32)):
            self._shown[name] = self._api.add_point_cloud(
                name,
                np.asarray(places, np.float32),
                colour,
                point_size=self._size_m,
                point_shape="circle",
                precision="float32",  # half of it is off by a metre at 3 km
            )

    def recolour(self, under: str, colour: Colour) -> None:
        """Give everything whose name begins so one colour."""
        for name, shown in self._shown.items():
            if name.startswith(under):
                shown.colors = np.asarray(colour, np.uint8)

    def resize(self, distance_m: float) -> None:
        """Size everything for that distance."""
        if 1.0 / AMISS < DOT * distance_m / self._size_m < AMISS:
            return
        self._size_m = DOT * distance_m
        for shown in self._shown.values():
            shown.point_size = self._size_m
