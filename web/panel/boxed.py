"""What is told of the outliers in a box."""

from html import escape

from web.look import colours
from web.look.html import block, inked, table
from web.memory.boxed import Boxed
from web.memory.lies import UNITS


def story(found: Boxed) -> str:
    """How many there are and of how many measurements; by sensor and channel how many and how far off."""
    count = len(found.outliers)
    if not count:
        return block(f"no outlier in the box, of {found.measured} measurements there")
    share = f"{count / max(found.measured, count):.1%}"
    head = (
        f"<div>{inked(f'{count} outliers', colours.OUTLIER)} in the box, <b>{share}</b> of "
        f"{max(found.measured, count)} measurements there</div>"
    )
    rows = [
        [
            escape(one.sensor),
            one.channel.replace("_", " "),
            str(one.values),
            f"{one.share:.0%}",
            _number(one.sigmas, "σ", ".1f"),
            _number(one.off, UNITS[one.channel], ".3g"),
        ]
        for one in found.channels
    ]
    names = ("sensor", "channel", "n", "share", "mean", "mean off")
    note = '<div class="quiet">share: of that sensor\'s measurements in the box</div>'
    return block(head + table(rows, names) + note)


def _number(value: float, unit: str, form: str) -> str:
    return "–" if value != value else f"{value:+{form}} {unit}"
