"""Figures of the flight itself: where it went, how it moved, its wind."""

import numpy as np
import plotly.graph_objects as go

from gcs.contract.messages import CHANNELS
from gcs.report.basis import geometry, numbers
from gcs.report.basis.drawing import BEST, LIVE, RAW, colour_of, dots, line, sheet
from gcs.report.basis.page import Diagram
from gcs.report.basis.run import ACCEPTED, REFUSED, Run, is_one_of

ENU = ("e_m", "n_m", "u_m")
STEPS = 900  # of the replay
ROOM = 0.25  # around the flight, as a share of it
PLAN_MARKS = 400  # misplaced claims of one instrument in a picture


def plan(run: Run) -> Diagram:
    """From above, with the instruments and what they wrongly claimed."""
    figure = sheet(1, ["N, m"], time=False)
    best = _thinned(run.smoothed)
    figure.add_trace(_path(best, "best estimate", BEST))
    figure.add_trace(_path(_thinned(run.track), "live", LIVE, dash="dot", width=1))
    low, high = _box(run)
    left_out = 0
    for sensor in run.station.sensor:
        t_ns, where = geometry.claims(run, sensor.name, REFUSED)
        inside = ((where[:, :2] > low[:2]) & (where[:, :2] < high[:2])).all(axis=1)
        left_out += int((~inside).sum())
        where, t = where[inside], run.seconds(t_ns[inside])
        at = numbers.sample(PLAN_MARKS, where[:, 0])
        style = (colour_of(sensor.name, run.sensors), "x-thin", 7)
        text = np.array([f"{sensor.name}, {s:.2f} s" for s in t[at]])
        dots(
            figure, where[at, 0], where[at, 1], f"{sensor.name}, refused", style, text=text, hoverinfo="text"
        )
    offsets = {s.name: run.frame.place_sensor(s)[0] for s in run.station.sensor}
    if offsets:
        colours = [colour_of(name, run.sensors) for name in offsets]
        figure.add_trace(
            go.Scatter(
                x=[o[0] for o in offsets.values()], y=[o[1] for o in offsets.values()], text=list(offsets),
                mode="markers+text", textposition="top center", name="instruments",
                marker={"symbol": "triangle-up", "size": 11, "color": colours},
            )
        )  # fmt: skip
    figure.update_xaxes(title_text="E, m", range=[low[0], high[0]])
    figure.update_yaxes(scaleanchor="x", range=[low[1], high[1]])
    caption = (
        "The track from above. Crosses are places that an instrument claimed with a range or an angle that "
        "was refused; they should lie off the track and in no one direction."
    )
    if left_out:
        caption += f" {left_out:,} more lie outside the picture."
    return Diagram("Plan view", caption, figure, 620)


def replay(run: Run) -> Diagram:
    """The flight in three dimensions, with a time slider."""
    best = _thinned(run.smoothed)
    low, high = _box(run)
    figure = go.Figure()
    figure.add_trace(_path3(best, "best estimate", BEST, 4))
    ground = best.copy()
    ground["u_m"] = low[2]
    figure.add_trace(_path3(ground, "on the ground", RAW, 1))
    for sensor in run.station.sensor:
        where = geometry.claims(run, sensor.name, REFUSED)[1]
        where = where[((where > low) & (where < high)).all(axis=1)]
        at = numbers.sample(PLAN_MARKS, where[:, 0])
        _scatter3(
            figure,
            where[at],
            f"{sensor.name}, refused",
            colour_of(sensor.name, run.sensors),
            "circle-open",
            3,
        )
    for sensor in run.station.sensor:
        offset = run.frame.place_sensor(sensor)[0]
        _scatter3(figure, offset[None], sensor.name, colour_of(sensor.name, run.sensors), "diamond", 6)
    t_ns = np.linspace(run.smoothed["t_ns"][0], run.smoothed["t_ns"][-1], STEPS).astype(np.int64)
    where = geometry.positions(run, t_ns)
    known = np.isfinite(where).all(axis=1)
    t_ns, where = t_ns[known], np.round(where[known], 2)
    _scatter3(figure, where[-1:], run.station.vehicle.name, "#e43c14", "circle", 7)
    axes = {
        f"{axis}axis": {"title": {"text": f"{name}, m"}, "range": [low[k], high[k]], "showbackground": False}
        for k, (axis, name) in enumerate(zip("xyz", "ENU", strict=True))
    }
    path = {"t": np.round(run.seconds(t_ns), 2).tolist(), "trace": len(figure.data) - 1}
    path |= {axis: where[:, k].tolist() for k, axis in enumerate("xyz")}
    figure.update_layout(
        template=go.layout.Template(), paper_bgcolor="rgba(0,0,0,0)",
        margin={"l": 0, "r": 0, "t": 30, "b": 0},
        scene={"aspectmode": "data", "camera": {"eye": {"x": -0.9, "y": -1.5, "z": 0.9}}} | axes,
        legend={"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom"}, meta={"replay": path},
    )  # fmt: skip
    caption = (
        "Play, or drag the slider: the red point is the vehicle by the best estimate. Drag to turn the "
        "picture, scroll to come near."
    )
    return Diagram("The flight in three dimensions", caption, figure, 600)


def motion(run: Run) -> Diagram:
    """Height, speed and acceleration."""
    figure = sheet(4, ["height, m", "speed, m/s", "climb, m/s", "acceleration, m/s²"])
    ins = run.of("ins")
    up = ins[(ins["channel"] == CHANNELS.index("u")) & is_one_of(ins, ACCEPTED)]
    if len(up):
        line(figure, run.seconds(up["t_ns"]), up["value"] + run.frame.alt_m, "INS", RAW, 1, width=3)
    for rows, name, colour in ((run.track, "live", LIVE), (run.smoothed, "best estimate", BEST)):
        t, rows = _with_breaks(run, rows)
        size = np.sqrt(rows["ae_mps2"] ** 2 + rows["an_mps2"] ** 2 + rows["au_mps2"] ** 2)
        level = np.hypot(rows["ve_mps"], rows["vn_mps"])
        height = rows["u_m"] + run.frame.alt_m
        for row, y in enumerate((height, level, rows["vu_mps"], size), 1):
            line(figure, t, y, name, colour, row)
    caption = (
        "Height over the origin's level plane plus the origin's, level speed, climb and the size of the "
        "acceleration. Live and best estimate should lie on each other; a step in one of them is an event."
    )
    return Diagram("Height, speed and acceleration", caption, figure, 760)


def ins_minus_fused(run: Run) -> Diagram | None:
    """What the autopilot said of its place against the best estimate; None without an INS."""
    values = run.of("ins")
    columns = [values[values["channel"] == CHANNELS.index(c)] for c in "enu"]
    t_ns = columns[0]["t_ns"]
    for column in columns[1:]:
        t_ns = np.intersect1d(t_ns, column["t_ns"])
    if not len(t_ns):
        return None
    own = np.column_stack([c["value"][np.searchsorted(c["t_ns"], t_ns)] for c in columns])
    away = numbers.along_across_up(own - geometry.positions(run, t_ns), geometry.velocities(run, t_ns))
    figure = sheet(3, ["along, m", "across, m", "up, m"])
    for row in range(3):
        line(figure, run.seconds(t_ns), away[:, row], "INS − best estimate", RAW, row + 1)
    medians = ", ".join(
        f"{name} {_median(away[:, k]):+.2f} m"
        for k, name in enumerate(("along", "across to the right", "up"))
    )
    caption = (
        f"Medians: {medians}. A difference along the course that grows with speed is a delay of the "
        "autopilot, one that stays is its position or height error. There is no along or across below 1 m/s."
    )
    return Diagram("INS minus best estimate", caption, figure, 560)


def wind(run: Run) -> Diagram | None:
    """Mean wind over time; None without one."""
    mean = run.wind
    if mean is None or not len(mean):
        return None
    known = mean[mean["known"] > 0]
    figure = sheet(2, ["speed, m/s", "from, °"])
    for row, name in enumerate(("speed_mps", "from_deg"), 1):
        if np.isfinite(mean[f"own_{name}"]).any():
            line(figure, run.seconds(mean["t_ns"]), _unwound(mean[f"own_{name}"], row), "autopilot", RAW, row)
        line(figure, run.seconds(known["t_ns"]), _unwound(known[name], row), "found", BEST, row)
    caption = (
        "Mean wind out of air data and the cleaned velocity, from where the flight has shown it; beside it "
        "what the autopilot believes."
    )
    return Diagram("Wind", caption, figure, 420)


def _median(x: np.ndarray) -> float:
    return float(np.nanmedian(x)) if np.isfinite(x).any() else float("nan")


def _unwound(values: np.ndarray, row: int) -> np.ndarray:
    """A direction (second row) without the step at north."""
    known = np.isfinite(values)
    if row == 2 and known.any():
        values = values.copy()
        values[known] = np.unwrap(values[known], period=360.0)
    return values


def _with_breaks(run: Run, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times in s and rows, with a NaN where there was no state, or the filter began again."""
    new = np.diff(rows["reset_counter"]) != 0
    longest_ns = numbers.longest_s(rows["t_ns"]) * 1e9  # a slow log has states farther apart than others
    at = np.flatnonzero((np.diff(rows["t_ns"]) > longest_ns) | new) + 1
    broken = np.insert(rows, at, rows[at])
    places = at + np.arange(len(at))
    for name in rows.dtype.names or ():
        if broken.dtype[name].kind == "f":
            broken[name][places] = np.nan
    return run.seconds(broken["t_ns"]), broken


def _thinned(rows: np.ndarray) -> np.ndarray:
    return rows[numbers.thin(3_000, *(rows[name] for name in ENU))]


def _box(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,) of what is shown: flight and instruments, with room around."""
    flown = np.column_stack([run.smoothed[name] for name in ENU])
    places = [run.frame.place_sensor(s)[0] for s in run.station.sensor]
    all_of = np.vstack([flown, *(place[None] for place in places)])
    low, high = all_of.min(axis=0), all_of.max(axis=0)
    room = np.maximum(ROOM * (high - low), 20.0)
    return low - room * (1.0, 1.0, 0.2), high + room


def _path(rows: np.ndarray, name: str, colour: str, dash: str = "solid", width: float = 2) -> go.Scatter:
    style = {"color": colour, "width": width, "dash": dash}
    x, y = (np.asarray(rows[axis], np.float32) for axis in ("e_m", "n_m"))
    return go.Scatter(x=x, y=y, mode="lines", name=name, line=style, hoverinfo="skip")


def _path3(rows: np.ndarray, name: str, colour: str, width: float) -> go.Scatter3d:
    x, y, z = (np.asarray(rows[axis], np.float32) for axis in ENU)
    return go.Scatter3d(
        x=x, y=y, z=z, mode="lines", name=name, line={"color": colour, "width": width}, hoverinfo="skip"
    )


def _scatter3(figure: go.Figure, where: np.ndarray, name: str, colour: str, symbol: str, size: int) -> None:
    x, y, z = np.asarray(where, np.float32).T
    marker = {"color": colour, "symbol": symbol, "size": size}
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, mode="markers", name=name, marker=marker))
