"""The report of the papers' bench: one table of what must be shown, pictures, the figures behind them."""

from html import escape
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from rich.table import Table

COLUMNS = ("", "what", "the paper", "ours", "baselines", "target", "met")
MET = {True: "yes", False: "NO", None: "–"}
STYLE = """
body { font: 15px/1.5 sans-serif; color: #333; max-width: 1100px; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse; margin: 1em 0 2em; font-size: 13px; line-height: 1.35 }
th, td { border: 1px solid #ccc; padding: 4px 8px; text-align: left; vertical-align: top }
th { background: #f3f3f3 } caption { text-align: left; font-weight: bold; padding: 4px 0 }
.yes { color: #1a7f37 } .NO { color: #d1352b; font-weight: bold } .note { color: #555 }
figure { margin: 2em 0 } img { max-width: 100% } figcaption { color: #555 }
"""


class Line(NamedTuple):
    """One figure that must be shown."""

    row: int  # of the requirements
    what: str
    paper: str
    ours: str
    baselines: str
    target: str
    met: bool | None = None  # None where there is nothing to meet, or nothing was measured
    note: str = ""


class Grid(NamedTuple):
    """The figures behind some lines."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]


class Drawn(NamedTuple):
    """One picture of the report."""

    name: str  # of its file, without ending
    figure: Figure
    caption: str


def terminal(lines: list[Line]) -> Table:
    """The lines as one table, then their notes in its caption."""
    notes = dict.fromkeys(f"{line.row}: {line.note}" for line in lines if line.note)
    table = Table(
        title="the three papers",
        title_justify="left",
        caption="\n".join(notes),
        caption_justify="left",
        show_lines=True,
    )
    for heading in COLUMNS:
        table.add_column(heading)
    for line in lines:
        met = f"[red]{MET[line.met]}[/red]" if line.met is False else MET[line.met]
        table.add_row(str(line.row), *line[1:6], met)
    return table


def write(folder: Path, head: str, lines: list[Line], pictures: list[Drawn], grids: list[Grid]) -> Path:
    """``report.html`` and its pictures, PNG, into ``folder``."""
    cells = []
    for one in pictures:
        one.figure.savefig(folder / f"{one.name}.png")
    for line in lines:
        note = f'<br><span class="note">{escape(line.note)}</span>' if line.note else ""
        body = [str(line.row), escape(line.what) + note, *map(escape, line[2:6])]
        cells.append(f'{_row("td", body)[:-5]}<td class="{MET[line.met]}">{MET[line.met]}</td></tr>')
    shown = (
        f'<figure><img src="{one.name}.png" alt="{escape(one.caption)}">'
        f"<figcaption>{escape(one.caption)}</figcaption></figure>"
        for one in pictures
    )
    page = [
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>The three papers</title>',
        f"<style>{STYLE}</style><h1>The three papers</h1><p>{escape(head)}</p>",
        f"<table>{_row('th', COLUMNS)}{''.join(cells)}</table>",
        "<h2>Pictures</h2>",
        *shown,
        "<h2>Figures</h2>",
        *map(_grid, grids),
        "</html>\n",
    ]
    path = folder / "report.html"
    path.write_text("\n".join(page), encoding="utf-8")
    return path


def _grid(grid: Grid) -> str:
    rows = "".join(_row("td", map(escape, row)) for row in grid.rows)
    head = _row("th", map(escape, grid.columns))
    return f"<table><caption>{escape(grid.title)}</caption>{head}{rows}</table>"


def _row(tag: str, cells) -> str:
    return "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in cells) + "</tr>"
