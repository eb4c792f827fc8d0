"""How far the state shown is from the other course, in operators' words."""

from html import escape

from gcs.contract.messages import State
from web.look import html
from web.memory.other import OtherTrack


def block(other: OtherTrack | None, state: State | None, *, old: bool) -> str:
    """Along, across and up at the time shown; nothing where there is no other course."""
    if other is None:
        return ""
    head = f"<div>from <b>{escape(other.name)}</b></div>"
    off = other.apart(state) if state else None
    if off is None:
        return html.block(f'{head}<span class="quiet">it does not say where it was at this time</span>')
    rows = [
        ["along", _metres(off.along, "ahead", "behind")],
        ["across", _metres(off.across, "to the right", "to the left")],
        ["up", _metres(off.up, "above", "below")],
        ["in space", f"{off.whole:.2f} m"],
    ]
    return html.block(head + html.table([[name, html.aged(value, old=old)] for name, value in rows]))


def _metres(off: float | None, more: str, less: str) -> str:
    return "–" if off is None else f"{abs(off):.2f} m {more if off >= 0.0 else less}"
