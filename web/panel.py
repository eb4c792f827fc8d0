"""The panel beside the picture: state, sensors, legend, events. Text in, HTML out."""

import json
from datetime import UTC, datetime
from html import escape

from gcs.contract.messages import Event, Health, Scene, SensorHealth, State, Wind
from web import colours
from web.colours import Colour, css

STALE_S = 1.0  # older data are not live; the state comes ten times a second or more
LOST_S = 3.0  # the browser says so itself when the station has been silent for so long
LATE_SHARE, BAD_SHARE = 0.05, 0.20  # outlier share that turns amber, red
OLD_S = 2.0  # a sensor silent for longer turns red

# The last rule works without us: every update restarts the animation, so it ends only when updates stop.
STYLE = f"""<style>
.gcs {{ padding: 0.4em 0.9em; font-size: 0.8em; line-height: 1.45; font-variant-numeric: tabular-nums; }}
.gcs table {{ width: 100%; border-collapse: collapse; }}
.gcs td, .gcs th {{ text-align: right; padding: 0.05em 0 0.05em 0.6em; font-weight: normal; }}
.gcs td, .gcs th, .gcs .word {{ white-space: nowrap; }}
.gcs th {{ opacity: 0.6; font-size: 0.9em; }}
.gcs td:first-child, .gcs th:first-child {{ text-align: left; padding-left: 0; }}
.gcs .clock {{ font-size: 1.9em; font-weight: 600; line-height: 1.2; }}
.gcs .badge {{ float: right; color: white; font-weight: 600; padding: 0.25em 0.7em; border-radius: 0.4em; }}
.gcs .quiet {{ opacity: 0.6; }}
.gcs .swatch {{ display: inline-block; width: 0.75em; height: 0.75em; border-radius: 50%;
  margin-right: 0.5em; }}
.gcs .lost {{ height: 0; overflow: hidden; color: white; background: {css(colours.BAD)}; font-weight: 600;
  text-align: center; border-radius: 0.4em; animation: gcs-lost 0.1s {LOST_S}s forwards; }}
@keyframes gcs-lost {{ to {{ height: 1.8em; line-height: 1.8em; }} }}
</style>"""

# A track that passes through three sightings, for the browser's tab.
ICON = (
    "data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'>"
    f"<path d='M2 27Q16 25 30 4' fill='none' stroke='{css(colours.FILTERED)}' stroke-width='4'/>"
    f"<g fill='{css(colours.INSTRUMENTS[0])}'>"
    "<circle cx='9' cy='22' r='4'/><circle cx='18' cy='20' r='4'/><circle cx='26' cy='8' r='4'/></g></svg>"
)


def title(scene: Scene) -> str:
    """Names the browser's tab: viser's page has another name, and runs no script but an image's error."""
    name, icon = json.dumps(f"{scene.range} · {scene.vehicle}"), json.dumps(ICON)
    act = f"document.title = {name}; document.querySelector('link[rel=icon]').href = {icon}"
    return f'<img src="data:," alt="" style="display: none" onerror="{escape(act)}">'


def clock(t_ns: int) -> str:
    """Time of day UTC, tenths of a second."""
    moment = datetime.fromtimestamp(t_ns // 1_000_000_000, UTC)
    return f"{moment:%H:%M:%S}.{t_ns // 100_000_000 % 10}"


def badge(state: State | None, age_s: float, mode: str) -> tuple[str, Colour]:
    """What to believe of the picture, in one word. ``mode`` is LIVE, PAUSED, REPLAY …"""
    if state is None:
        return "WAITING FOR DATA", colours.WARNING
    if mode in ("PAUSED", "END"):
        return mode, colours.INS
    if age_s > STALE_S:
        return f"DATA {age_s:.1f} s OLD", colours.BAD
    if state.quality < 0:
        return "STATE FAILED", colours.BAD
    return mode, colours.GOOD


def status(scene: Scene, state: State | None, wind: Wind | None, word: str, colour: Colour, tick: int) -> str:
    head = f'<span class="badge" style="background:{css(colour)}">{word}</span><b>{escape(scene.vehicle)}</b>'
    lost = f'<div class="lost" data-tick="{tick}">NO CONTACT WITH THE STATION</div>'
    if state is None:
        return f'{STYLE}<div class="gcs">{head} <span class="quiet">{escape(scene.range)}</span>{lost}</div>'
    speed = sum(v * v for v in state.velocity_enu_mps) ** 0.5
    east, north, up = state.position_enu_m
    sigma = [state.covariance[i] ** 0.5 for i in (0, 2, 5)]
    day = datetime.fromtimestamp(state.t_ns // 1_000_000_000, UTC)
    where = f'<span class="quiet">{escape(scene.range)} · {day:%Y-%m-%d}</span>'
    return f"""{STYLE}<div class="gcs">{head} {where}{lost}
<div class="clock">{clock(state.t_ns)} <span class="quiet" style="font-size:0.5em">UTC</span></div>
<table><tr><th></th><th>East</th><th>North</th><th>Up</th></tr>
<tr><td>position m</td><td>{east:.1f}</td><td>{north:.1f}</td><td>{up:.1f}</td></tr>
<tr><td>σ m</td>{"".join(f"<td>{s:.2f}</td>" for s in sigma)}</tr>
<tr><td>velocity m/s</td>{"".join(f"<td>{v:.1f}</td>" for v in state.velocity_enu_mps)}</tr></table>
<table><tr><td>{state.lat_deg:.6f}° {state.lon_deg:.6f}°</td><td>height {state.alt_m:.1f} m</td></tr>
<tr><td>speed <b>{speed:.1f} m/s</b></td>
<td>quality <b>{state.quality}</b> · resets <b>{state.reset_counter}</b></td></tr>
{air(wind, state.t_ns)}{doubt(state)}</table></div>"""


def doubt(state: State) -> str:
    """How far the position can be trusted, in a line each; nothing where the station does not say."""
    lines = []
    if state.ambiguous:
        lines.append(inked("two positions fit the measurements: this may be the wrong one", colours.BAD))
    if state.protection_h_m is not None and state.protection_v_m is not None:
        across, high = f"<b>{state.protection_h_m:.1f} m</b>", f"<b>{state.protection_v_m:.1f} m</b>"
        lines.append(f"position holds within {across}, height within {high}, even if one sensor lies")
    return "".join(f'<tr><td colspan="2" style="white-space:normal">{line}</td></tr>' for line in lines)


def air(wind: Wind | None, t_ns: int) -> str:
    """The wind in one line at ``t_ns``; nothing where there are no air data."""
    if wind is None:
        return ""
    age_s = (t_ns - wind.t_ns) / 1e9
    how = "known" if wind.known else inked("not yet known", colours.WARNING)
    old = f" · {inked(f'{age_s:.0f} s old', colours.WARNING)}" if age_s > OLD_S else ""
    said = f"wind <b>{wind.speed_mps:.1f} m/s</b> from <b>{wind.from_deg:.0f}°</b>"
    return f"<tr><td>{said}</td><td>{how}{old}</td></tr>"


def sensors(scene: Scene, health: Health | None, state: State | None) -> str:
    if health is None:
        return f'{STYLE}<div class="gcs quiet">no sensor has reported yet</div>'
    named = colours.of_sensors(scene)
    rows = []
    for name, sensor in sorted(health.sensors.items(), key=lambda item: [*named, item[0]].index(item[0])):
        age_s = state.age_s.get(name, sensor.age_s) if state else sensor.age_s
        word, colour = condition(sensor, age_s)
        rows.append(
            f"<tr><td>{swatch(named.get(name, colours.GROUND))}{escape(name)}</td>"
            f"<td>{sensor.rate_hz:.1f}</td>"
            f"<td>{'–' if age_s is None else f'{age_s:.1f}'}</td>"
            f"<td>{inked(f'{sensor.outlier_share:.1%}', share_colour(sensor.outlier_share))}</td>"
            f"<td>{sensor.latency_s * 1e3:.0f}</td><td>{inked(word, colour)}</td></tr>"
        )
    head = "<tr><th>sensor</th><th>Hz</th><th>age s</th><th>outliers</th><th>delay ms</th><th></th></tr>"
    behind = f"measurements wait {health.queue_age_s:.1f} s to be taken in"
    queue = inked(behind, colours.BAD) if health.queue_age_s > STALE_S else ""
    return f'{STYLE}<div class="gcs"><table>{head}{"".join(rows)}</table>{queue}</div>'


def condition(sensor: SensorHealth, age_s: float | None) -> tuple[str, Colour]:
    """A sensor in one word; ``age_s`` of its newest measurement, None before the first."""
    if not sensor.alive:
        return "gone", colours.BAD
    if age_s is None:
        return "waiting", colours.WARNING
    return ("silent", colours.BAD) if age_s > OLD_S else ("ok", colours.GOOD)


def legend(scene: Scene, sigma_factor: int) -> str:
    named = colours.of_sensors(scene)
    lines = [("filtered", colours.FILTERED), ("smoothed", colours.SMOOTHED)]
    words = [f'<span style="color:{css(c)}">▬</span> {name}' for name, c in lines]
    words += [
        f'<b style="color:{css(colours.OUTLIER)}">✕</b> outlier',
        f"{swatch(colours.OUTLIER)}rate outlier",
    ]
    words += [f"{swatch(colour)}{escape(name)}" for name, colour in named.items()]
    words += [f"3σ ×{sigma_factor}"]
    return (
        STYLE
        + '<div class="gcs">'
        + " &nbsp; ".join(f'<span class="word">{word}</span>' for word in words)
        + "</div>"
    )


def events(latest: list[Event], skipped: int) -> str:
    tint = {"warning": colours.WARNING, "error": colours.BAD}
    rows = [
        f'<div><span class="quiet">{clock(e.t_ns)}</span> {inked(escape(e.text), tint.get(e.level))}</div>'
        for e in reversed(latest)
    ]
    if skipped:
        rows.insert(
            0, inked(f"the view skipped {skipped} messages: data come faster than it draws", colours.WARNING)
        )
    return f'{STYLE}<div class="gcs">{"".join(rows) or "none yet"}</div>'


def share_colour(share: float) -> Colour | None:
    return colours.BAD if share > BAD_SHARE else colours.WARNING if share > LATE_SHARE else None


def inked(text: str, colour: Colour | None) -> str:
    return f'<b style="color:{css(colour)}">{text}</b>' if colour else text


def swatch(colour: Colour) -> str:
    return f'<span class="swatch" style="background:{css(colour)}"></span>'
