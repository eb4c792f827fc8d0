"""All vehicles of the page, the worst first: a row each with its state of health."""

import time
from collections.abc import Callable, Mapping
from html import escape
from typing import NamedTuple

import viser

from web.look import colours
from web.look.colours import Colour
from web.look.handles import by_hand
from web.look.html import block, inked, table
from web.memory.flight import SeenFlight
from web.panel.limits import OperatorLimits, alarms
from web.panel.status import badge

FAILED, WAITING, ALARMED, FINE = range(4)  # the worst first
RANK = {colours.BAD: FAILED, colours.WARNING: WAITING}


class Condition(NamedTuple):
    """How one vehicle does."""

    rank: int
    name: str
    word: str
    colour: Colour
    quality: int | None  # None: no state yet
    why: str  # "": nothing is against it


def condition(name: str, flight: SeenFlight | None, limits: OperatorLimits) -> Condition:
    """How a live flight does; none: its station has not been heard."""
    if flight is None:
        return Condition(WAITING, name, "NO STATION", colours.WARNING, None, "its station has not been heard")
    age_s = time.monotonic() - flight.arrived_s
    word, colour = badge(flight.state, age_s, "LIVE")
    quality = flight.state.quality if flight.state else None
    found = alarms(limits, flight.state, flight.health) if flight.state else []
    why = found[0] + (f" and {len(found) - 1} more" if len(found) > 1 else "") if found else ""
    return Condition(RANK.get(colour, ALARMED if found else FINE), name, word, colour, quality, why)


def ordered(found: list[Condition]) -> list[Condition]:
    """The worst first; equals by name, so that rows do not jump about."""
    return sorted(found, key=lambda one: (one.rank, one.name))


def worst(flights: Mapping[str, SeenFlight], limits: OperatorLimits) -> str:
    """Which vehicle a new page shows."""
    return ordered([condition(*item, limits) for item in flights.items()])[0].name


def rows(found: list[Condition], chosen: str) -> str:
    """A table of the vehicles, the chosen one marked."""
    body = []
    for one in ordered(found):
        name = f"<b>▸ {escape(one.name)}</b>" if one.name == chosen else escape(one.name)
        tint = colours.WARNING if one.rank == ALARMED else one.colour
        quality = "–" if one.quality is None else str(one.quality)
        body.append([name, inked(escape(one.word), tint), quality])
    reasons = "".join(
        f'<div class="quiet">{escape(one.name)}: {escape(one.why)}</div>' for one in ordered(found) if one.why
    )
    return block(table(body, ("vehicle", "", "quality")) + reasons)


class Fleet:
    """The table and the choice of one viewer; hidden where there is one vehicle only."""

    def __init__(self, gui: viser.GuiApi, chosen: str, choose: Callable[[str], None]):
        self._table = gui.add_html("", visible=False)
        self._choice = gui.add_dropdown("vehicle", (chosen,), visible=False)
        by_hand(self._choice, choose)

    def update(self, flights: Mapping[str, SeenFlight | None], limits: OperatorLimits, chosen: str) -> None:
        """``flights`` by vehicle; one whose station has not been heard has none, and cannot be chosen."""
        if len(flights) < 2:
            return
        self._table.content = rows([condition(*item, limits) for item in flights.items()], chosen)
        names = tuple(name for name, flight in flights.items() if flight)
        if self._choice.options != names:
            self._choice.options = names
        self._table.visible = self._choice.visible = True
