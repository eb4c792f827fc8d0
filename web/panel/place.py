"""The position in the form that is wanted: East North Up, geodetic, or as an instrument has to point."""

from gcs.contract.messages import Scene, State
from web.look import html
from web.memory.geometry import look

LOCAL, GEODETIC = "East North Up", "latitude longitude"


def forms(scene: Scene) -> list[str]:
    """Every form there is: an instrument's name stands for its range, azimuth and elevation."""
    return [LOCAL, GEODETIC, *(instrument.name for instrument in scene.instruments)]


def text(scene: Scene, state: State, form: str) -> list[tuple[str, str]]:
    """Names and values with units, to be copied as they are."""
    if form == GEODETIC:
        return [
            ("latitude", f"{state.lat_deg:.7f}°"),
            ("longitude", f"{state.lon_deg:.7f}°"),
            ("ellipsoidal height", f"{state.alt_m:.2f} m"),
        ]
    if form == LOCAL:
        names = ("East", "North", "Up")
        return [(n, f"{v:.2f} m") for n, v in zip(names, state.position_enu_m, strict=True)]
    stand = next(one.position_enu_m for one in scene.instruments if one.name == form)
    range_m, azimuth_deg, elevation_deg = look(scene, stand, state.position_enu_m)
    return [
        ("range", f"{range_m:.1f} m"),
        ("true azimuth", f"{azimuth_deg:.4f}°"),
        ("elevation", f"{elevation_deg:.4f}°"),
    ]


def block(scene: Scene, state: State | None, form: str, *, old: bool) -> str:
    """The position in that form, a line each; a click copies."""
    if state is None:
        return html.block('<span class="quiet">no position yet</span>')
    shown = text(scene, state, form)
    rows = [[name, html.aged(html.copied(value), old=old)] for name, value in shown]
    whole = html.copied("  ".join(f"{name} {value}" for name, value in shown))
    return html.block(html.table(rows) + f'<div class="quiet" style="font-size:0.85em">{whole}</div>')
