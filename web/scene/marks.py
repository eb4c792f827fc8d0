"""The outliers as one viewer sees them: small shapes by kind, of one size on the screen wherever they are.

A mark's size in metres follows its distance from this viewer's eye, so every viewer has marks of their own.
A node cannot grow, a change sends it whole: full pieces are sent once, and later only when the eye has moved.
They are lines: the browser draws thousands of these, while solids by the dozen halve its pace.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import viser

from web.look import colours
from web.memory.claims import Claim
from web.memory.flight import SeenFlight

PIECE = 200  # marks of a finished piece
MARK_PX, RATE_PX = 7.0, 4.0  # size on the screen; where only a rate is refused the place stands: smaller
LINE_PX = 1.3
AMISS = 1.25  # ratio by which a size may be wrong before it is sent anew


def cross() -> np.ndarray:
    """(3, 2, 3): three bars through one point, a cross from every side. Shapes are one unit wide."""
    return np.stack([-0.5 * np.eye(3), 0.5 * np.eye(3)], axis=1)


def box() -> np.ndarray:
    """(12, 2, 3): the edges of a cube."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    rims = [
        np.stack([np.column_stack([c, np.full(4, z)]) for c in (square, np.roll(square, -1, axis=0))], axis=1)
        for z in (-1, 1)
    ]
    posts = np.stack([np.column_stack([square, np.full(4, z)]) for z in (-1, 1)], axis=1)
    return 0.35 * np.concatenate([*rims, posts])


def hoops() -> np.ndarray:
    """(16, 2, 3): two rings across one another, hollow from every side."""
    angles = np.linspace(0, 2 * np.pi, 9)
    level = 0.5 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(9)])
    return np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in (level, level[:, [2, 0, 1]])])


SHAPES = {"isolated": cross(), "patch": box(), "invalid": hoops()}


class Eye(NamedTuple):
    """Where a viewer looks from, station ENU in metres, and how much of the sight a pixel takes."""

    place: np.ndarray
    pixel_rad: float


class Piece:
    """Marks of one kind, one node."""

    def __init__(self, api: viser.SceneApi, name: str, kind: str, claims: Sequence[Claim], eye: Eye):
        self._shape = SHAPES[kind]
        self.places = np.array([claim.position for claim in claims])
        self.pixels = np.array([MARK_PX if claim.misplaced else RATE_PX for claim in claims])
        self._sizes = sizes_m(self.places, self.pixels, eye)
        self._node = api.add_line_segments(
            name, self._segments(), colours.KIND[kind], thickness=LINE_PX, thickness_units="screen"
        )

    def resize(self, eye: Eye) -> None:
        sizes = sizes_m(self.places, self.pixels, eye)
        ratio = sizes / self._sizes
        if np.any((ratio > AMISS) | (ratio < 1.0 / AMISS)):
            self._sizes = sizes
            self._node.points = self._segments()

    def remove(self) -> None:
        self._node.remove()

    def _segments(self) -> np.ndarray:
        """(n · lines of the shape, 2, 3)."""
        grown = self._sizes[:, None, None, None] * self._shape
        return (self.places[:, None, None] + grown).reshape(-1, 2, 3).astype(np.float32)


class Marks:
    """All outliers of a flight, for one viewer."""

    def __init__(self, api: viser.SceneApi, flight: SeenFlight):
        self._api, self._flight, self._root = api, flight, flight.root
        self._pieces: dict[str, list[tuple[int, Piece]]] = {kind: [] for kind in SHAPES}  # number of its last
        self._open: dict[str, list[Claim]] = {kind: [] for kind in SHAPES}
        self._tails: dict[str, tuple[list[Claim], Piece]] = {}
        self._seen = 0  # outliers taken so far, counted from the flight's first
        self._made = 0

    def update(self, eye: Eye) -> None:
        self._take_new(eye)
        pending = [c for c in self._flight.claims.pending() if c.kind in SHAPES and c.position]
        for kind in SHAPES:
            self._show_tail(kind, [*self._open[kind], *(c for c in pending if c.kind == kind)], eye)
        for piece in self.pieces():
            piece.resize(eye)

    def pieces(self) -> list[Piece]:
        sealed = [piece for pieces in self._pieces.values() for _, piece in pieces]
        return sealed + [piece for _, piece in self._tails.values()]

    def clear(self) -> None:
        for piece in self.pieces():
            piece.remove()
        for kind in SHAPES:
            self._pieces[kind].clear()
            self._open[kind].clear()
        self._tails.clear()
        self._seen = 0

    def _take_new(self, eye: Eye) -> None:
        first = self._flight.outliers_before
        for number in range(max(self._seen, first), first + len(self._flight.outliers)):
            claim = self._flight.outliers[number - first]
            held = self._open[claim.kind]
            held.append(claim)
            if len(held) == PIECE:
                self._made += 1
                name = f"{self._root}/outliers/{claim.kind}-{self._made}"
                self._pieces[claim.kind].append((number, Piece(self._api, name, claim.kind, held, eye)))
                held.clear()
        self._seen = first + len(self._flight.outliers)
        for pieces in self._pieces.values():
            while pieces and pieces[0][0] < first:  # the flight keeps them no more
                pieces.pop(0)[1].remove()

    def _show_tail(self, kind: str, claims: list[Claim], eye: Eye) -> None:
        before = self._tails.get(kind)
        if before and before[0] == claims:
            return
        if before:
            del self._tails[kind]
            if not claims:
                before[1].remove()
        if claims:
            self._tails[kind] = (
                claims,
                Piece(self._api, f"{self._root}/outliers/{kind}-tail", kind, claims, eye),
            )


def sizes_m(places: np.ndarray, pixels: np.ndarray, eye: Eye) -> np.ndarray:
    """(n,) sizes in metres of what takes so many pixels (n,) at (n, 3) places."""
    return np.maximum(pixels * eye.pixel_rad * np.linalg.norm(places - eye.place, axis=1), 1e-3)
