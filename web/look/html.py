"""Pieces of the panel's text: HTML out of words, numbers and colours."""

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape

from gcs.contract.messages import Scene
from web.look import colours
from web.look.colours import Colour, css

LOST_S = 3.0  # the browser says so itself when the station has been silent for so long

# A band has no name: without the rule for .u-series the legend would call each of its edges "Value".
# The last rule works without us: every update restarts the animation, so it ends only when updates stop.
STYLE = f"""<style>
.gcs {{ padding: 0.4em 0.9em; font-size: 0.8em; line-height: 1.45; font-variant-numeric: tabular-nums; }}
.gcs table {{ width: 100%; border-collapse: collapse; }}
.gcs td, .gcs th {{ text-align: right; padding: 0.05em 0 0.05em 0.5em; font-weight: normal; }}
.gcs td, .gcs th, .gcs .word {{ white-space: nowrap; }}
.gcs th {{ opacity: 0.7; font-size: 0.9em; }}
.gcs td:first-child, .gcs th:first-child {{ text-align: left; padding-left: 0; }}
.gcs td.wide {{ white-space: normal; text-align: left; }}
.gcs .clock {{ font-size: 1.7em; font-weight: 600; line-height: 1.2; }}
.gcs .badge {{ float: right; font-weight: 600; padding: 0.2em 0.6em; border-radius: 0.4em; }}
.gcs .bar {{ font-weight: 600; padding: 0.1em 0.6em; border-radius: 0.4em; margin: 0.15em 0; }}
.gcs .quiet {{ opacity: 0.7; }}
.gcs .old {{ opacity: 0.65; text-decoration: line-through; }}
.gcs .copy {{ cursor: copy; border-bottom: 1px dotted; }}
.gcs .swatch {{ display: inline-block; width: 0.75em; height: 0.75em; border-radius: 50%;
  margin-right: 0.4em; }}
:root {{ --mantine-color-dimmed: {css(colours.LABEL[False])} !important; }}
:root[data-mantine-color-scheme=dark] {{ --mantine-color-dimmed: {css(colours.LABEL[True])} !important; }}
:root[data-mantine-color-scheme=dark] [role=tab][aria-selected=true], [data-mantine-color-scheme=dark]
  [role=tab][aria-selected=true] * {{ color: {css(colours.CHOSEN_DARK)} !important; }}
.mantine-Slider-markLabel {{ color: var(--mantine-color-dimmed) !important; }}
.u-series:has(.u-marker[style*="{colours.BAND}"]) {{ display: none; }}
.gcs .lost {{ height: 0; overflow: hidden; color: white; background: {css(colours.BAD)}; font-weight: 600;
  text-align: center; border-radius: 0.4em; animation: gcs-lost 0.1s {LOST_S}s forwards; }}
@keyframes gcs-lost {{ to {{ height: 1.8em; line-height: 1.8em; margin-bottom: 0.4em; }} }}
</style>"""

# A track that passes through three sightings, for the browser's tab.
ICON = (
    "data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'>"
    f"<path d='M2 27Q16 25 30 4' fill='none' stroke='{css(colours.FILTERED)}' stroke-width='4'/>"
    f"<g fill='{css(colours.INSTRUMENTS[0])}'>"
    "<circle cx='9' cy='22' r='4'/><circle cx='18' cy='20' r='4'/><circle cx='26' cy='8' r='4'/></g></svg>"
)
COPY = "getSelection().selectAllChildren(this);document.execCommand('copy')"


def title(scene: Scene) -> str:
    """Names the browser's tab: viser's page has another name, and runs no script but an image's error."""
    name, icon = json.dumps(f"{scene.range} · {scene.vehicle}"), json.dumps(ICON)
    act = f"document.title = {name}; document.querySelector('link[rel=icon]').href = {icon}"
    return f'<img src="data:," alt="" style="display: none" onerror="{escape(act)}">'


def block(content: str) -> str:
    return f'{STYLE}<div class="gcs">{content}</div>'


def table(rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table of cells that are HTML already."""
    top = "<tr>" + "".join(f"<th>{cell}</th>" for cell in head) + "</tr>" if head else ""
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>{top}{body}</table>"


def copied(text: str) -> str:
    """Text that a click copies."""
    return f'<span class="copy" title="click to copy" onclick="{COPY}">{escape(text)}</span>'


def inked(text: str, colour: Colour | None) -> str:
    """Bold in a colour, mixed with the page's ink so that it reads on the light and on the dark page."""
    if not colour:
        return text
    return f'<b style="color:color-mix(in srgb, {css(colour)} 65%, currentColor)">{text}</b>'


def aged(text: str, *, old: bool) -> str:
    """A number that is not of now is struck through."""
    return f'<span class="old">{text}</span>' if old else text


def bar(text: str, colour: Colour) -> str:
    return f'<div class="bar" style="{filled(colour)}">{text}</div>'


def filled(colour: Colour) -> str:
    """The style of words on that ground."""
    return f"background:{css(colour)};color:{css(colours.words_on(colour))}"


def swatch(colour: Colour) -> str:
    return f'<span class="swatch" style="background:{css(colour)}"></span>'


def clock(t_ns: int) -> str:
    """Time of day UTC, tenths of a second."""
    moment = datetime.fromtimestamp(t_ns // 1_000_000_000, UTC)
    return f"{moment:%H:%M:%S}.{t_ns // 100_000_000 % 10}"
