"""The head of the panel: what to believe, what is wrong, where it is and how fast. Text in, HTML out."""

from datetime import UTC, datetime
from html import escape

from gcs.contract.messages import Scene, State, Wind
from web.look import colours, html
from web.look.colours import Colour
from web.look.html import aged, bar, clock, inked, table

STALE_S = 1.0  # older data are not live; the state comes ten times a second or more
OLD_S = 2.0  # the wind comes once a second
SAID = 3  # so many alarms are shown; the rest are counted


def badge(state: State | None, age_s: float, mode: str) -> tuple[str, Colour]:
    """What to believe of the picture, in one word. ``mode`` is LIVE, PAUSED, REPLAY …"""
    if mode.startswith(("PAUSED", "END", "BACK")):
        return mode, colours.INS
    if state is None:
        return "WAITING FOR DATA", colours.WARNING
    if age_s > STALE_S:
        return f"DATA {age_s:.1f} s OLD", colours.BAD
    if state.quality < 0:
        return "STATE FAILED", colours.BAD
    return mode, colours.GOOD


def head(scene: Scene, state: State | None, word: str, colour: Colour, tick: int) -> str:
    """Badge, vehicle and time of the data."""
    mark = f'<span class="badge" style="{html.filled(colour)}">{word}</span><b>{escape(scene.vehicle)}</b>'
    lost = f'<div class="lost" data-tick="{tick}">NO CONTACT WITH THE STATION</div>'
    if state is None:
        return html.block(f'{lost}{mark} <span class="quiet">{escape(scene.range)}</span>')
    day = datetime.fromtimestamp(state.t_ns // 1_000_000_000, UTC)
    where = f'<span class="quiet">{escape(scene.range)} · {day:%Y-%m-%d}</span>'
    utc = '<span class="quiet" style="font-size:0.5em">UTC</span>'
    return html.block(f'{lost}{mark} {where}<div class="clock">{clock(state.t_ns)} {utc}</div>')


def go(alarms: list[str], lies: list[str], *, demanded: bool) -> str:
    """May the flight go on: what is against it, or that nothing is."""
    rows = [bar(escape(text), colours.BAD) for text in alarms[:SAID]]
    if len(alarms) > SAID:
        rows.append(inked(f"and {len(alarms) - SAID} more", colours.BAD))
    rows += [bar(escape(text), colours.KIND["patch"]) for text in lies[:SAID]]
    if not rows and demanded:
        rows.append(bar("within all limits", colours.GOOD))
    elif not demanded:
        rows.append('<span class="quiet">no limit for the position is set: tab Limits</span>')
    return html.block("".join(rows))


def numbers(state: State | None, wind: Wind | None, *, old: bool) -> str:
    """The state in numbers; what is not of now is struck through."""
    if state is None:
        return FIRST
    speed = sum(v * v for v in state.velocity_enu_mps) ** 0.5

    def row(name: str, values: list[str]) -> list[str]:
        return [name, *(aged(value, old=old) for value in values)]

    rows = [
        row("position m", [f"{v:.1f}" for v in state.position_enu_m]),
        row("σ m", [f"{state.covariance[i] ** 0.5:.2f}" for i in (0, 2, 5)]),
        row("velocity m/s", [f"{v:.1f}" for v in state.velocity_enu_mps]),
    ]
    rest = [
        [aged(f"speed <b>{speed:.1f} m/s</b>", old=old), aged(f"height <b>{state.alt_m:.1f} m</b>", old=old)],
        [f"quality <b>{state.quality}</b>", f"resets <b>{state.reset_counter}</b>"],
        *air(wind, state.t_ns),
    ]
    return html.block(table(rows, ("", "East", "North", "Up")) + table(rest) + trust(state))


def trust(state: State) -> str:
    """How far the position can be trusted, in one line."""
    if state.protection_h_m is None or state.protection_v_m is None:
        text = inked("nothing bounds the error if one sensor lies", colours.WARNING)
    else:
        across, high = f"<b>{state.protection_h_m:.1f} m</b>", f"<b>{state.protection_v_m:.1f} m</b>"
        text = f"position holds within {across}, height within {high}, even if one sensor lies"
    doubt = inked("two positions fit the measurements: this may be the wrong one", colours.BAD)
    return f"<div>{text}</div>" + (f"<div>{doubt}</div>" if state.ambiguous else "")


def air(wind: Wind | None, t_ns: int) -> list[list[str]]:
    """The wind in one row at ``t_ns``: no number before the flight has shown it, no row without air data."""
    if wind is None:
        return []
    if not wind.known:
        return [["wind", inked("not known yet: turn the aircraft", colours.WARNING)]]
    age_s = (t_ns - wind.t_ns) / 1e9
    said = f"wind <b>{wind.speed_mps:.1f} m/s</b> from <b>{wind.from_deg:.0f}°</b>"
    old = age_s > OLD_S
    return [[aged(said, old=old), inked(f"{age_s:.0f} s old", colours.WARNING) if old else ""]]


FIRST = html.block("""<b>No data yet.</b> The page shows the flight as soon as the station knows where it is.
What has to be there:
<ol style="margin: 0.3em 0; padding-left: 1.4em">
<li>the vehicle's link: the tab Sensors shows <i>ins</i> with a rate</li>
<li>a bridge for every instrument: <code>gcs bridge KIND NAME --station …</code> on its machine</li>
<li>measurements that agree: one instrument with range, or two that see the target</li>
</ol>
<code>gcs doctor --station station.toml</code> checks ports, router and clock.""")
