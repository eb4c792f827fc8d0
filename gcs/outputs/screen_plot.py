"""A picture of a screened feed: SVG that any browser opens, offline."""

from html import escape
from typing import NamedTuple

import numpy as np

WIDTH, HEIGHT, LEFT, TOP = 1000, 180, 90, 40  # px; of one panel, and the room around them
INK, TRACE, FAULT = "#333", "#2a6fb0", "#d1352b"
ROOM = 0.15  # of the cleaned channel's span, above and below it


class Panel(NamedTuple):
    """One channel of n values."""

    name: str
    cleaned: np.ndarray  # (n,)
    values: np.ndarray  # (n,) as measured
    outlier: np.ndarray  # (n,) bool


def picture(title: str, t_s: np.ndarray, panels: list[Panel]) -> str:
    """The cleaned channels as lines and the outliers as dots, those out of the picture at its edge."""
    height = TOP + len(panels) * (HEIGHT + TOP)
    body = [f'<text x="{LEFT}" y="16" font-size="15">{escape(title)}</text>']
    for place, panel in enumerate(panels):
        body += _panel(t_s, panel, TOP + place * (HEIGHT + TOP))
    body.append(
        f'<text x="{LEFT + WIDTH}" y="{height - TOP / 3:.0f}" text-anchor="end">{t_s[-1]:.0f} s</text>'
    )
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {LEFT + WIDTH + 20} {height}" '
            f'font-family="sans-serif" font-size="12" fill="{INK}">',
            '<rect width="100%" height="100%" fill="white"/>',
            *body,
            "</svg>\n",
        ]
    )


def _panel(t_s: np.ndarray, panel: Panel, top: float) -> list[str]:
    low, high = np.nanmin(panel.cleaned), np.nanmax(panel.cleaned)
    room = ROOM * (high - low) or 1.0
    low, high = low - room, high + room
    x = LEFT + WIDTH * (t_s - t_s[0]) / max(t_s[-1] - t_s[0], 1e-9)

    def down(values):
        return top + HEIGHT * np.clip((high - values) / (high - low), 0.0, 1.0)

    out = [
        f'<rect x="{LEFT}" y="{top}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#bbb"/>',
        f'<text x="{LEFT}" y="{top - 5}">{panel.name}: {np.count_nonzero(panel.outlier)} outliers</text>',
        f'<text x="{LEFT - 6}" y="{top + 12}" text-anchor="end">{high:.5g}</text>',
        f'<text x="{LEFT - 6}" y="{top + HEIGHT}" text-anchor="end">{low:.5g}</text>',
        f'<path d="{_trace(x, down(panel.cleaned))}" fill="none" stroke="{TRACE}"/>',
    ]
    dots = zip(x[panel.outlier].tolist(), down(panel.values[panel.outlier]).tolist(), strict=True)
    return out + [f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="2" fill="{FAULT}"/>' for cx, cy in dots]


def _trace(x: np.ndarray, y: np.ndarray) -> str:
    """Path through the lowest and the highest point of every pixel: as it looks with all points."""
    known = np.isfinite(y)
    x, y = x[known], y[known]
    pixel = x.astype(int)
    first = np.flatnonzero(np.diff(pixel, prepend=-1))
    low, high = np.minimum.reduceat(y, first), np.maximum.reduceat(y, first)
    points = (
        f"{column} {a:.1f}L{column} {b:.1f}" for column, a, b in zip(pixel[first], low, high, strict=True)
    )
    return "M" + "L".join(points)
