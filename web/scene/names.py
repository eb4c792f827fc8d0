"""The names on the ground, north and the kilometres, as one viewer sees them: where nothing is in the way."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import viser

from gcs.contract.messages import Scene, State
from web.scene.aircraft import SIZE
from web.scene.ground import NORTH_M

NORTH = "N"
PLACES = {  # station ENU, metres; where two would touch, the first is shown
    NORTH: (0.0, NORTH_M + 80.0, 0.0),
    "1 km E": (1000.0, 0.0, 0.0),
    "1 km N": (0.0, 1000.0, 0.0),
    "1 km W": (-1000.0, 0.0, 0.0),
    "1 km S": (0.0, -1000.0, 0.0),
}
NAME_PX, LETTER_PX, HIGH_PX = (48.0, 20.0), 8.0, 20.0  # such a name with some room; a letter of any other
MOST_PLACES, SHARES = 3_000, (0.0, 0.25, 0.5, 0.75)  # of a track that are looked at, and between two of them
FIGURE_PX = (40.0, 40.0)  # an instrument's


class Lens(NamedTuple):
    """How one viewer sees the picture."""

    pixels: Callable[[np.ndarray], np.ndarray]  # (n, 3) station ENU → (n, 2) from the upper left, NaN behind
    size_px: tuple[int, int]
    pixel_rad: float


class Boxes(NamedTuple):
    """Upright rectangles on the picture, in pixels."""

    middles: np.ndarray  # (n, 2)
    sizes: np.ndarray  # (n, 2)


class GroundNames:
    """One viewer's: what is in the way depends on where he looks from."""

    def __init__(self, api: viser.SceneApi, root: str):
        self._labels = [
            api.add_label(
                f"{root}/names/{text.replace(' ', '-')}",
                text,
                position=place,
                font_screen_scale=1.0 if text == NORTH else 0.8,
                anchor="center-center",
                visible=False,
            )
            for text, place in PLACES.items()
        ]

    def update(self, lens: Lens, drawn: np.ndarray, things: Boxes) -> None:
        """Show those that are whole and touch neither ``drawn`` (m, 2), in pixels, nor ``things``."""
        seen = free(lens.pixels(np.array([*PLACES.values()])), lens.size_px, drawn, things)
        for label, shown in zip(self._labels, seen, strict=True):
            if label.visible != shown:
                label.visible = shown


def free(middles: np.ndarray, size_px: tuple[int, int], points: np.ndarray, things: Boxes) -> list[bool]:
    """Which names with (n, 2) middles are whole and touch neither (m, 2) points, things nor a name before."""
    half = np.array(NAME_PX) / 2
    found: list[bool] = []
    for number, middle in enumerate(middles):
        whole = bool(np.all((middle > half) & (middle < np.array(size_px) - half)))  # NaN is not
        crossed = np.any(np.all(np.abs(points - middle) < half, axis=1))
        covered = np.any(np.all(np.abs(things.middles - middle) < half + things.sizes / 2, axis=1))
        others = middles[:number][found]
        beside = np.any(np.all(np.abs(others - middle) < 2 * half, axis=1))
        found.append(whole and not (crossed or covered or beside))
    return found


def drawn(track: np.ndarray, outliers: Sequence[np.ndarray], lens: Lens) -> np.ndarray:
    """(m, 2) pixels of a track (n, 3), of its shadow on the ground, and of outliers (k, 3) each."""
    some = track[:: max(1, len(track) // MOST_PLACES)]
    lines = [lens.pixels(places) for places in (some, some * (1, 1, 0))]
    between = [line[:-1] + share * np.diff(line, axis=0) for line in lines for share in SHARES]
    return np.concatenate([*between, *(lens.pixels(places) for places in outliers)])


def things(scene: Scene, state: State | None, called: str, lens: Lens) -> Boxes:
    """The instruments with their names below them, and the aircraft with its own above."""
    feet = np.array([one.position_enu_m for one in scene.instruments]).reshape(-1, 3)
    seen = lens.pixels(feet)
    middles = [seen - np.array([0.0, FIGURE_PX[1] / 2]), seen + np.array([0.0, HIGH_PX / 2])]
    sizes: list[Sequence[tuple[float, float]]] = [
        [FIGURE_PX] * len(feet),
        [_of_name(one.name) for one in scene.instruments],
    ]
    if state:
        place = lens.pixels(np.array([state.position_enu_m]))
        span_px = SIZE / lens.pixel_rad
        middles += [place, place - (0.0, (span_px + HIGH_PX) / 2)]
        sizes += [[(span_px, span_px)], [_of_name(called)]]
    return Boxes(np.concatenate(middles), np.array([size for some in sizes for size in some]).reshape(-1, 2))


def hanging(text: str, place: np.ndarray, lens: Lens) -> Boxes:
    """A label whose upper left corner is at a place (3,)."""
    size = np.array([_of_name(text)])
    return Boxes(lens.pixels(place[None]) + size / 2, size)


def together(*some: Boxes) -> Boxes:
    return Boxes(*(np.concatenate(parts) for parts in zip(*some, strict=True)))


def _of_name(text: str) -> tuple[float, float]:
    return LETTER_PX * (len(text) + 1), HIGH_PX
