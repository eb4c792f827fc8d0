"""The outliers as one viewer sees them: small solids by kind, of one size on the screen wherever they are.

A mark's size in metres follows its distance from this viewer's eye, so every viewer has marks of their own.
A node cannot grow, a change sends it whole: full pieces are sent once, and later only their sizes, when the
eye has moved.
"""

from collections.abc import Sequence

import numpy as np
import viser

from web.look import colours
from web.memory.claims import Claim
from web.memory.flight import SeenFlight
from web.scene import glyphs

PIECE = 200  # marks of a finished piece
MARK_PX, RATE_PX = 7.0, 4.0  # size on the screen; where only a rate is refused the place stands: smaller
AMISS = 1.25  # ratio by which a size may be wrong before it is sent anew
SHAPES = {"isolated": glyphs.jack(), "patch": glyphs.cube(), "invalid": glyphs.ring()}


class Piece:
    """Marks of one kind, one node."""

    def __init__(self, api: viser.SceneApi, name: str, kind: str, claims: Sequence[Claim]):
        self.places = np.array([claim.position for claim in claims])
        self.pixels = np.array([MARK_PX if claim.misplaced else RATE_PX for claim in claims])
        self._sizes = np.ones(len(claims))
        vertices, faces = SHAPES[kind]
        self._node = api.add_batched_meshes_simple(
            name,
            vertices,
            faces,
            np.tile((1.0, 0.0, 0.0, 0.0), (len(claims), 1)),
            self.places,
            batched_scales=np.full(len(claims), 1e-3, np.float32),
            batched_colors=colours.KIND[kind],
            flat_shading=True,
            lod="off",
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def resize(self, eye: np.ndarray, pixel_rad: float) -> None:
        sizes = sizes_m(self.places, self.pixels, eye, pixel_rad)
        ratio = sizes / self._sizes
        if np.any((ratio > AMISS) | (ratio < 1.0 / AMISS)):
            self._sizes = sizes
            self._node.batched_scales = sizes.astype(np.float32)

    def remove(self) -> None:
        self._node.remove()


class Marks:
    """All outliers of a flight, for one viewer."""

    def __init__(self, api: viser.SceneApi, flight: SeenFlight):
        self._api, self._flight = api, flight
        self._pieces: dict[str, list[tuple[int, Piece]]] = {kind: [] for kind in SHAPES}  # number of its last
        self._open: dict[str, list[Claim]] = {kind: [] for kind in SHAPES}
        self._tails: dict[str, tuple[list[Claim], Piece]] = {}
        self._seen = 0  # outliers taken so far, counted from the flight's first
        self._made = 0

    def update(self, eye: np.ndarray, pixel_rad: float) -> None:
        self._take_new()
        pending = [c for c in self._flight.claims.pending() if c.kind in SHAPES and c.position]
        for kind in SHAPES:
            self._show_tail(kind, [*self._open[kind], *(claim for claim in pending if claim.kind == kind)])
        for piece in self.pieces():
            piece.resize(eye, pixel_rad)

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

    def _take_new(self) -> None:
        first = self._flight.outliers_before
        for number in range(max(self._seen, first), first + len(self._flight.outliers)):
            claim = self._flight.outliers[number - first]
            held = self._open[claim.kind]
            held.append(claim)
            if len(held) == PIECE:
                self._made += 1
                name = f"/world/outliers/{claim.kind}-{self._made}"
                self._pieces[claim.kind].append((number, Piece(self._api, name, claim.kind, held)))
                held.clear()
        self._seen = first + len(self._flight.outliers)
        for pieces in self._pieces.values():
            while pieces and pieces[0][0] < first:  # the flight keeps them no more
                pieces.pop(0)[1].remove()

    def _show_tail(self, kind: str, claims: list[Claim]) -> None:
        before = self._tails.get(kind)
        if before and before[0] == claims:
            return
        if before:
            del self._tails[kind]
            if not claims:
                before[1].remove()
        if claims:
            self._tails[kind] = claims, Piece(self._api, f"/world/outliers/{kind}-tail", kind, claims)


def sizes_m(places: np.ndarray, pixels: np.ndarray, eye: np.ndarray, pixel_rad: float) -> np.ndarray:
    """(n,) sizes in metres of what takes so many pixels (n,) at (n, 3) places."""
    return np.maximum(pixels * pixel_rad * np.linalg.norm(places - eye, axis=1), 1e-3)
