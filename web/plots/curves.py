"""What the plots show: columns out of what the page keeps. At most ``MOST`` points each, no drawing."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from web.look import colours
from web.look.colours import Colour
from web.memory.flight import SeenFlight
from web.memory.residuals import RESIDUAL, row

MOST = 400
CLIP = 10.0  # sigmas: what is farther off is drawn at the edge
LEVELS = (-CLIP, -3.0, 0.0, 3.0, CLIP)  # a good value is beyond 3 once in 370; the filter has no hard gate
GROUPS = (("e", "n", "u"), ("ve", "vn", "vu"), ("ae", "an", "au"))  # channels of a sensor that share a plot
RESIDUALS, TRACK, TRUST, ERRORS = (
    "residuals in σ",
    "height and speed",
    "sigma and protection",
    "zero errors, clocks",
)
CHOICES = (RESIDUALS, TRACK, TRUST, ERRORS)
LINE, DOTS, MARKS, BAND = "line", "dots", "marks", "band"  # a band lies between this curve and the next
UNITS = {"m": (1.0, "m"), "deg": (1.0, "°"), "s": (1e3, "ms"), "m/s": (1.0, "m/s")}
PALETTE: tuple[Colour, ...] = ((32, 128, 224), (0, 158, 115), (214, 140, 0), (204, 100, 180))


class Curve(NamedTuple):
    """One curve of a plot."""

    label: str
    colour: Colour
    style: str
    y: np.ndarray  # (n,), NaN: nothing at this time; a line and a band have no NaN but at the ends


class Plot(NamedTuple):
    """Curves over one row of times."""

    title: str
    x_s: np.ndarray  # (n,) seconds of flight
    curves: list[Curve]
    y_range: tuple[float, float] | None = None  # None: as the data need it
    log: bool = False
    levels: tuple[float, ...] = ()  # where lines go across; none: as it comes


def plots(choice: str, flight: SeenFlight, from_ns: int, to_ns: int) -> list[Plot]:
    """The plots of one choice over that time."""
    make = {RESIDUALS: _residuals, TRACK: _track, TRUST: _trust, ERRORS: _errors}[choice]
    made = make(flight, from_ns, to_ns)
    return [plot for plot in made if len(plot.x_s) >= 2]


def residuals(flight: SeenFlight, sensor: str, channels: Sequence[str], from_ns: int, to_ns: int) -> Plot:
    """Accepted residuals by channel, and all refused ones."""
    columns = [_column(flight, sensor, channel, from_ns, to_ns) for channel in channels]
    times, refused = _union(columns)
    kept = thinned(len(times), refused)
    times = times[kept]
    curves = []
    for column, channel, colour in zip(columns, channels, PALETTE, strict=False):
        good = column[column["kind"] == 0]
        curves.append(
            Curve(channel.replace("_", " "), colour, DOTS, _at(times, good["t_ns"], good["sigmas"]))
        )
    rows = np.concatenate([column[column["kind"] > 0] for column in columns])
    curves.append(Curve("refused", colours.OUTLIER, MARKS, _at(times, rows["t_ns"], rows["sigmas"])))
    return Plot(sensor, _seconds(flight, times), curves, (-CLIP - 1.0, CLIP + 1.0), levels=LEVELS)


def reach(plot: Plot) -> tuple[float, float]:
    """What the y axis has to show, to round numbers; the browser chooses badly where a value is missing."""
    if plot.y_range:
        return plot.y_range
    values = np.concatenate([curve.y for curve in plot.curves])
    values = values[np.isfinite(values)]
    if plot.log:
        values = values[values > 0.0]
    if not len(values):
        return 0.1, 1.0
    low, high = float(values.min()), float(values.max())
    if plot.log:
        return 10.0 ** math.floor(math.log10(low)), 10.0 ** (math.floor(math.log10(high)) + 1)
    step = 10.0 ** math.floor(math.log10(max(high - low, 1e-6)))
    return step * math.floor(low / step), step * (math.floor(high / step) + 1)


def few(rows: np.ndarray, most: int) -> np.ndarray:
    """Every k-th of the rows, so that at most ``most`` are left."""
    return rows[:: max(1, -(-len(rows) // most))] if most else rows[:0]


def thinned(n: int, wanted: np.ndarray) -> np.ndarray:
    """Indices of at most ``MOST`` of n, in order: the wanted ones (n,) bool first, then every k-th."""
    first, rest = np.flatnonzero(wanted), np.flatnonzero(~wanted)
    first = few(first, MOST)
    room = MOST - len(first)
    rest = few(rest, room)
    return np.sort(np.concatenate([first, rest]))


def _residuals(flight: SeenFlight, from_ns: int, to_ns: int) -> list[Plot]:
    found = []
    for sensor in [*colours.of_sensors(flight.scene)]:
        known = flight.residuals.channels(sensor)
        groups = GROUPS if sensor == "ins" else (tuple(known),)
        for group in groups:
            shown = [channel for channel in group if channel in known]
            if shown:
                plot = residuals(flight, sensor, shown, from_ns, to_ns)
                found.append(
                    plot._replace(title=f"{sensor} {'/'.join(shown)}" if sensor == "ins" else sensor)
                )
    return found


def _track(flight: SeenFlight, from_ns: int, to_ns: int) -> list[Plot]:
    """Height and speed, raw against fused."""
    fused = flight.newest.between(from_ns, to_ns)
    if not len(fused):
        return []
    named = colours.of_sensors(flight.scene)
    raw = {
        name: flight.residuals.raw(name, from_ns, to_ns)
        for name in flight.residuals.sensors()
        if name in named
    }
    each = max(1, MOST // (len(raw) + 1))
    fused = few(fused, each)
    raw = {name: few(rows[rows["kind"] == 0], each) for name, rows in raw.items()}
    times = np.unique(np.concatenate([fused["t_ns"], *(rows["t_ns"] for rows in raw.values())]))
    speed = np.linalg.norm(fused["velocity_enu_mps"], axis=1)
    x_s, found = _seconds(flight, times), []
    heights = {name: rows["place_m"][:, 2] for name, rows in raw.items()}
    speeds = {name: rows["speed_mps"] for name, rows in raw.items()}
    for title, of_each, of_state in (
        ("height above the origin, m", heights, fused["position_enu_m"][:, 2]),
        ("speed, m/s", speeds, speed),
    ):
        curves = [
            Curve(name, named[name], DOTS, _at(times, raw[name]["t_ns"], values))
            for name, values in of_each.items()
            if np.isfinite(values).any()
        ]
        curves.append(Curve("fused", colours.FILTERED, LINE, np.interp(times, fused["t_ns"], of_state)))
        found.append(Plot(title, x_s, curves))
    return found


def _trust(flight: SeenFlight, from_ns: int, to_ns: int) -> list[Plot]:
    rows = flight.newest.between(from_ns, to_ns)
    rows = few(rows, MOST)
    variance = rows["covariance"]
    across, high = np.sqrt(variance[:, 0] + variance[:, 2]), np.sqrt(variance[:, 5])
    x_s = _seconds(flight, rows["t_ns"])
    bound = [
        Curve("held across", PALETTE[2], DOTS, rows["protection_h_m"]),
        Curve("held in height", PALETTE[3], DOTS, rows["protection_v_m"]),
    ]
    sigma = [Curve("σ across", PALETTE[0], LINE, across), Curve("σ height", PALETTE[1], LINE, high)]
    nis = [
        Curve("NIS", PALETTE[0], DOTS, rows["nis"].astype(float)),
        Curve("as it should be", colours.GROUND, LINE, np.ones(len(rows))),
    ]
    return [
        Plot("sigma and protection level, m", x_s, [*sigma, *bound], log=True),
        Plot("NIS of accepted values, last second", x_s, nis, (0.0, 4.0)),
    ]


def _errors(flight: SeenFlight, from_ns: int, to_ns: int) -> list[Plot]:
    """One plot a quantity, a curve with its 1-sigma band for every sensor."""
    if flight.health is None:
        return []
    wanted: dict[str, list[tuple[str, str]]] = {}
    for sensor, health in flight.health.sensors.items():
        for name, error in health.errors.items():
            unit = UNITS[error.unit][1]
            title = f"clock, {unit}" if name in ("clock", "latency") else f"{name} zero, {unit}"
            wanted.setdefault(title, []).append((sensor, name))
    named = colours.of_sensors(flight.scene)
    found = []
    for title, keys in sorted(wanted.items(), key=lambda item: (item[1][0][0] == "ins", item[0])):
        columns = {key: flight.errors[key].between(from_ns, to_ns) for key in keys}
        times = np.unique(np.concatenate([column["t_ns"] for column in columns.values()]))
        times = few(times, MOST)
        curves = []
        for (sensor, name), column in columns.items():
            factor = UNITS[flight.health.sensors[sensor].errors[name].unit][0]
            colour = named.get(sensor, colours.GROUND)
            value = factor * _at(times, column["t_ns"], column["value"])
            sigma = factor * _at(times, column["t_ns"], column["sigma"])
            curves += [
                Curve("", colour, BAND, value + sigma),
                Curve("", colour, BAND, value - sigma),
                Curve(sensor, colour, LINE, value),
            ]
        found.append(Plot(title, _seconds(flight, times), curves))
    return found


def _column(flight: SeenFlight, sensor: str, channel: str, from_ns: int, to_ns: int) -> np.ndarray:
    """(n,) RESIDUAL of that time, those that may still be revised too, clipped for drawing."""
    settled = flight.residuals.of(sensor, channel, from_ns, to_ns)
    refused = settled["kind"] > 0  # an hour is thinned before anything costs time
    settled = np.concatenate([few(settled[refused], MOST), few(settled[~refused], 2 * MOST)])
    settled = settled[np.argsort(settled["t_ns"], kind="stable")]
    pending = [
        row(claim, claim.verdicts[channel])
        for claim in flight.claims.pending()
        if claim.sensor == sensor and channel in claim.verdicts and from_ns <= claim.t_ns <= to_ns
    ]
    column = np.concatenate([settled, np.array(pending, RESIDUAL)])
    column["sigmas"] = np.clip(column["sigmas"], -CLIP, CLIP)
    return column


def _union(columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) all times, and which of them have a refused value."""
    rows = np.concatenate(columns)
    times = np.unique(rows["t_ns"])
    return times, np.isin(times, rows["t_ns"][rows["kind"] > 0])


def _at(times: np.ndarray, t_ns: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n,) the values at exactly those times, NaN elsewhere."""
    out = np.full(len(times), np.nan)
    at = np.searchsorted(times, t_ns)
    inside = at < len(times)
    hit = np.zeros(len(t_ns), bool)
    hit[inside] = times[at[inside]] == t_ns[inside]
    out[at[hit]] = y[hit]
    return out


def _seconds(flight: SeenFlight, t_ns: np.ndarray) -> np.ndarray:
    return (t_ns - flight.span_ns[0]) / 1e9
