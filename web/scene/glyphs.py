"""Small solids that stand for things: aircraft, theodolite, radar. One unit high or wide, scaled when shown.

A solid is (vertices (n, 3) float, faces (m, 3) int).
"""

import numpy as np
from numpy.typing import ArrayLike

Solid = tuple[np.ndarray, np.ndarray]
HEAD = 0.9  # where theodolite and radar look from, above their feet


def aircraft() -> Solid:
    """Nose along +x, left wing along +y, up along +z; wing span 1."""
    outline = np.array(
        [
            *[(0.50, 0, 0), (0.14, 0.05, 0), (-0.10, 0.50, 0), (-0.18, 0.50, 0), (-0.10, 0.05, 0)],
            *[(-0.36, 0.04, 0), (-0.48, 0.18, 0), (-0.54, 0.18, 0), (-0.48, 0, 0)],
        ]
    )
    right = outline[-2:0:-1] * (1, -1, 1)
    rim = np.vstack([outline, right])
    thick = np.array([0, 0, 0.02])
    top, bottom = rim + thick, rim - thick
    ridge = np.array([[0.1, 0, 0.09], [0.1, 0, -0.06]])
    n = len(rim)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = [
        np.column_stack([i, j, np.full(n, 2 * n)]),
        np.column_stack([n + j, n + i, np.full(n, 2 * n + 1)]),
        np.column_stack([i, n + i, j]),
        np.column_stack([j, n + i, n + j]),
    ]
    fin = np.array([[-0.30, 0, 0.03], [-0.54, 0, 0.03], [-0.56, 0, 0.24], [-0.46, 0, 0.24]])
    return merge((np.vstack([top, bottom, ridge]), np.vstack(faces)), (fin, np.array([[0, 1, 2], [0, 2, 3]])))


def theodolite() -> Solid:
    """A tripod with a telescope on top, its feet on the ground."""
    feet = [(0.3 * np.cos(a), 0.3 * np.sin(a), 0.0) for a in np.radians([90, 210, 330])]
    legs = [bar(foot, (0, 0, 0.68), 0.035) for foot in feet]
    return merge(*legs, bar((0, 0, 0.64), (0, 0, 0.86), 0.12), bar((-0.2, 0, 0.9), (0.24, 0, 0.9), 0.09))


def radar() -> Solid:
    """A mast with a dish that looks up."""
    rim, deep = 0.32, np.array([0.0, 0.0, 0.75])
    look = np.array([0.0, -0.6, 0.8])
    side, up = np.array([1.0, 0, 0]), np.cross(look, [1.0, 0, 0])
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)[:, None]
    edge = deep + 0.22 * look + rim * (np.cos(angles) * side + np.sin(angles) * up)
    i, j = np.arange(16), (np.arange(16) + 1) % 16
    dish = (np.vstack([edge, deep]), np.column_stack([i, j, np.full(16, 16)]))
    feet = [(0.25 * np.cos(a), 0.25 * np.sin(a), 0.0) for a in np.radians([90, 210, 330])]
    legs = [bar(foot, (0, 0, 0.35), 0.04) for foot in feet]
    return merge(*legs, bar((0, 0, 0.3), deep, 0.06), dish, bar(deep, deep + 0.42 * look, 0.025))


def bar(start: ArrayLike, end: ArrayLike, radius: float) -> Solid:
    """A six-sided bar from ``start`` to ``end``."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, (0, 0, 1) if abs(axis[2]) < 0.9 else (1, 0, 0))
    side /= np.linalg.norm(side)
    angles = np.linspace(0, 2 * np.pi, 6, endpoint=False)[:, None]
    ring = radius * (np.cos(angles) * side + np.sin(angles) * np.cross(axis, side))
    i, j = np.arange(6), (np.arange(6) + 1) % 6
    caps = [(0, k, k + 1) for k in range(1, 5)]
    faces = [
        np.column_stack([i, j, 6 + i]),
        np.column_stack([j, 6 + j, 6 + i]),
        np.array(caps)[:, ::-1],
        np.array(caps) + 6,
    ]
    return np.vstack([start + ring, end + ring]), np.vstack(faces)


def merge(*solids: Solid) -> Solid:
    offsets = np.cumsum([0, *[len(vertices) for vertices, _ in solids]])
    return (
        np.vstack([vertices for vertices, _ in solids]),
        np.vstack([faces + offset for (_, faces), offset in zip(solids, offsets, strict=False)]),
    )
