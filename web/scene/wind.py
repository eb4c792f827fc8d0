"""The wind beside the aircraft: an arrow that points where the air goes."""

import numpy as np
import viser

from gcs.contract.messages import Wind
from web.look import colours
from web.scene.lines import Lines

LENGTH, ABOVE = 0.10, 0.10  # as shares of the camera's distance: clear of the aircraft's name


class Arrow:
    """Only where the flight has shown the wind: an arrow that is a guess would be believed."""

    def __init__(self, api: viser.SceneApi, lines: Lines, root: str):
        self._lines, self._root = lines, root
        self._label = api.add_label(f"{self._root}/wind/now/label", "", visible=False, anchor="top-center")

    def move(self, wind: Wind | None, aircraft: np.ndarray, distance_m: float) -> None:
        known = wind is not None and wind.known and wind.speed_mps > 0.0
        self._label.visible = known
        if wind is None or not known:
            self._lines.draw(f"{self._root}/wind/now/arrow", np.zeros((0, 2, 3)), colours.WIND, 3.0)
            return
        along = np.array([wind.e_mps, wind.n_mps, 0.0]) / wind.speed_mps
        middle = aircraft + np.array([0, 0, ABOVE * distance_m])
        self._lines.draw(
            f"{self._root}/wind/now/arrow", arrow(middle, LENGTH * distance_m * along), colours.WIND, 3.0
        )
        self._label.position = middle
        text = f"wind {wind.speed_mps:.1f} m/s"
        if self._label.text != text:
            self._label.text = text


def arrow(middle: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(3, 2, 3) segments of a level arrow, shaft and barbs; ``along`` (3,): its length and direction."""
    tip, tail = middle + along / 2, middle - along / 2
    aside = np.array([-along[1], along[0], 0.0])
    barbs = [tip - 0.3 * along + side * 0.15 * aside for side in (-1, 1)]
    return np.array([(tail, tip), (tip, barbs[0]), (tip, barbs[1])])
