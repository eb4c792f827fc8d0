"""One self-contained HTML page of tables and figures: it opens offline and asks nobody for anything."""

import re
from importlib.resources import files
from typing import Any, NamedTuple

import plotly.graph_objects as go
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs


class Sheet(NamedTuple):
    """A table as text. ``align`` has one letter a column: n for names, l for words, r for numbers,
    h for hashes."""

    title: str
    head: list[str]
    rows: list[list[str]]
    align: str
    note: str = ""


class Diagram(NamedTuple):
    """A figure, and in one sentence what to see in it."""

    title: str
    caption: str
    figure: go.Figure
    height: int = 420  # px


class Chapter(NamedTuple):
    """A part of the page."""

    title: str
    intro: str
    parts: list[Sheet | Diagram]


class Finding(NamedTuple):
    """What stands at the top."""

    word: str
    level: str  # good | bad | open
    reasons: list[str]


class Document(NamedTuple):
    """Everything on the page."""

    title: str
    subtitle: str
    facts: list[tuple[str, str]]
    verdict: Finding | None
    remarks: list[str] | None  # what the reader must judge himself; None: not asked for
    chapters: list[Chapter]
    footer: str


def render(document: Document) -> str:
    """The page as HTML."""
    here = files("gcs.report.basis")
    html, css, script = (
        (here / f"page.{kind}").read_text(encoding="utf-8") for kind in ("html", "css", "js")
    )
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["anchor"] = _anchor
    environment.tests["picture"] = lambda part: isinstance(part, Diagram)
    return environment.from_string(html).render(
        document=document,
        css=Markup(css),
        script=Markup(script),
        library=Markup(get_plotlyjs()),
        data=lambda picture: Markup(_data(picture.figure)),
    )


def _data(figure: go.Figure) -> str:
    """A figure as JSON that cannot end the script element it stands in."""
    return figure.to_json().replace("<", "\\u003c")


def _anchor(title: str) -> str:
    return re.sub("[^a-z0-9]+", "-", title.lower()).strip("-")


def number(value: Any, digits: int = 3) -> str:
    """A number for a table: significant digits, zeros among them, no exponent where it can be read without;
    – for none."""
    if value is None or value != value:
        return "–"
    if abs(value) in (0.0, float("inf")):
        return "0" if value == 0 else "∞"
    text = f"{value:#.{digits}g}".removesuffix(".")
    return f"{value:.0f}" if "e+" in text and abs(value) < 1e7 else text


def stated(value: float | None) -> str:
    """A number that somebody has stated, as he may have written it; – for none."""
    return "–" if value is None else f"{value:g}"
