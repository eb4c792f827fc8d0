"""Trails: points that only get more, sent to the browser in pieces.

The browser's line and point nodes cannot grow; a change sends the whole node. So a trail is cut: chunks of
1,000 points are sent once, the points since then once per hundred, and only the last few every time. Of a
finished chunk of a line what is needed is kept: without a graphics card a browser draws some ten thousand
lines in a second. Beyond ``most`` chunks the oldest are joined, two into one, and thinned where they are too
many, so many hours cost no more than the first.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

CHUNK = 1_000  # points of a finished piece
TAIL = 100  # points of the piece that is sent on every update
MOST = 16  # finished pieces before the oldest are joined
STRIDE = 20  # points, 2 s of flight: at least so often one is kept, for its colour

Shape = Callable[[np.ndarray], np.ndarray]


def line(points: np.ndarray) -> np.ndarray:
    """(n, 3 + k) → (≤ n−1, 2, 3 + k) segments that join them; a NaN place breaks the line."""
    segments = np.stack([points[:-1], points[1:]], axis=1)
    return segments[np.isfinite(segments[..., :3]).all(axis=(1, 2))]


def shadow(points: np.ndarray) -> np.ndarray:
    """`line` on the ground below."""
    return line(points * (1, 1, 0))


def dots(points: np.ndarray) -> np.ndarray:
    """(n, 3) as they are."""
    return points


def drops(points: np.ndarray) -> np.ndarray:
    """(n, 3) → (n, 2, 3): from each straight down to the ground."""
    return np.stack([points, points * (1, 1, 0)], axis=1)


def sticks(points: np.ndarray) -> np.ndarray:
    """(n, 6) → (n, 2, 3): from the first place of each to the second."""
    return points.reshape(-1, 2, 3)


def needed(points: np.ndarray, within_m: float) -> np.ndarray:
    """Those of (n, 3 + k) points whose line is nowhere farther from all than that; cuts, NaN, stay."""
    cut = np.isnan(points[:, 0])
    keep = cut.copy()
    keep[:-1] |= cut[1:]
    keep[1:] |= cut[:-1]
    keep[::STRIDE] = keep[-1] = True
    todo = list(itertools.pairwise(np.flatnonzero(keep).tolist()))
    while todo:
        begin, end = todo.pop()
        if end - begin > 1 and _off(points[begin : end + 1, :3]) > within_m:
            middle = (begin + end) // 2
            keep[middle] = True
            todo += [(begin, middle), (middle, end)]
    return points[keep]


def _off(points: np.ndarray) -> float:
    """How far the farthest of (n, 3) points is from the straight line between the first and the last."""
    away = points[1:-1] - points[0]
    along = points[-1] - points[0]
    share = np.clip(away @ along / max(along @ along, 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(away - share[:, None] * along, axis=1).max())


class Trail:
    """A growing row of points of ``wide`` numbers each: station ENU in metres, then what goes with it.

    ``draw(name, segments)`` shows what ``shape`` makes of points, float32, under that name, in place of what
    was there; none at all take it away. ``within_m``: so far off may a line be drawn that is no longer new.
    """

    def __init__(
        self,
        name: str,
        shape: Shape,
        draw: Callable[[str, np.ndarray], None],
        wide: int = 3,
        *,
        most: int = MOST,
        within_m: float = 0.0,
    ):
        self._name, self._shape, self._draw, self._wide = name, shape, draw, wide
        self._most, self._within_m = most, within_m
        self._joint = (
            1 if shape in (line, shadow) else 0
        )  # a piece of a line ends on the next one's first point
        self._made = 0
        self._chunks: list[tuple[str, np.ndarray, int]] = []  # name, points, how often joined
        self._open: list[Sequence[float]] = []
        self._settled = 0
        self._dirty = False

    def add(self, point: Sequence[float]) -> None:
        self._open.append(point)
        self._dirty = True

    def cut(self) -> None:
        """The next point does not belong to the last one."""
        if self._open:
            self.add((np.nan,) * self._wide)

    def update(self, pending: Sequence[Sequence[float]] = ()) -> None:
        """Send what changed. ``pending`` are points that may still be taken back: they go with the tail."""
        while len(self._open) >= CHUNK + self._joint:
            self._finish()
        settled = max(0, len(self._open) - self._joint) // TAIL * TAIL
        if settled != self._settled:
            self._show("open", self._open[: settled + self._joint] if settled else [])
            self._settled = settled
        if self._dirty or pending:
            self._show("tail", [*self._open[settled:], *pending])
        self._dirty = bool(pending)

    def redraw(self) -> None:
        """Send everything once more, after the shape has changed."""
        for name, points, _ in self._chunks:
            self._show(name, points)
        self._settled, self._dirty = -1, True

    def clear(self) -> None:
        for name, _, _ in self._chunks:
            self._show(name, [])
        self._chunks, self._open, self._settled, self._dirty = [], [], 0, False
        self._show("open", [])
        self._show("tail", [])

    def points(self) -> np.ndarray:
        """(n, wide) all that is kept, NaN where the trail is cut."""
        pieces = [points[: len(points) - self._joint] for _, points, _ in self._chunks]
        return np.vstack([*pieces, np.reshape(self._open, (-1, self._wide))])

    def _finish(self) -> None:
        name, points = f"chunk{self._made}", np.array(self._open[: CHUNK + self._joint], np.float32)
        if self._within_m:
            points = needed(points, self._within_m)
        self._chunks.append((name, points, 0))
        self._show(name, points)
        self._made += 1
        self._open = self._open[CHUNK:]
        self._settled = -1
        if len(self._chunks) > self._most:
            self._join()

    def _join(self) -> None:
        levels = [level for _, _, level in self._chunks]
        pairs = [i for i in range(len(levels) - 1) if levels[i] == levels[i + 1]]
        # From the oldest on, everything to the same density before anything is thinned once more.
        i = next((i for i in pairs if levels[i] < levels[0]), pairs[0])
        (name, older, level), (gone, newer, _) = self._chunks[i : i + 2]
        points = np.vstack([older[: len(older) - self._joint], newer])
        if len(points) > CHUNK + self._joint:
            keep = np.isnan(points[:, 0])
            keep[::2] = True
            keep[-1] |= bool(self._joint)
            points = points[keep]
        self._chunks[i : i + 2] = [(name, points, level + 1)]
        self._show(gone, [])
        self._show(name, points)

    def _show(self, piece: str, points) -> None:
        segments = self._shape(np.reshape(points, (-1, self._wide)))
        self._draw(f"{self._name}/{piece}", segments.astype(np.float32, copy=False))
