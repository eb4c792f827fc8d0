"""Figures of how sure it is: sigma, protection, separation, systematic errors, geometry, availability."""

import numpy as np
import plotly.graph_objects as go

from gcs.report import trust
from gcs.report.basis import geometry, numbers
from gcs.report.basis.drawing import BEST, LEVEL, LIVE, colour_of, limit, line, sheet
from gcs.report.basis.page import Diagram
from gcs.report.basis.run import REFUSED, Run, is_one_of
from gcs.report.trust import EN, Tolerance

SPAN_BINS = 240  # pieces of time in which a sensor's share of refused values is told
CROSSING_STEPS = 1_500
FEW_DECADES = 30.0  # ratio of the largest to the least, below which a decade is marked inside, too
LEAST_M = 0.01  # of a separation, on a logarithmic axis: what is less means nothing
BEGINS = 0.15  # of the flight, from which on the band of a systematic error is shown in full


def sigma(run: Run, tolerance: Tolerance) -> Diagram:
    """Sigma and protection level over the flight."""
    figure = sheet(2, ["horizontal, m", "height, m"])
    live, best = run.track, run.smoothed
    t, tb = run.seconds(live["t_ns"]), run.seconds(best["t_ns"])
    for row, (end, axis) in enumerate((("h", "horizontal"), ("v", "vertical")), 1):
        line(figure, t, live[f"protection_{end}_m"], "protection level, live", LEVEL, row, connectgaps=False)
        own, late = (numbers.horizontal(x, EN) if end == "h" else x["sigma_u_m"] for x in (live, best))
        line(figure, t, own, "1 sigma, live", LIVE, row)
        line(figure, tb, late, "1 sigma, best estimate", BEST, row)
        allowed_m = getattr(tolerance, f"{axis}_m")
        limit(figure, allowed_m, row)
        shown = np.concatenate([live[f"protection_{end}_m"], own, late, [allowed_m or np.nan]])
        figure.update_yaxes(type="log", dtick=_log_step(shown), row=row, col=1)
    caption = (
        "Logarithmic. Where the protection level is missing nobody else was there to bound a lie; where it "
        "is far above sigma one sensor carries the solution, or disagrees with the rest."
    )
    return Diagram("Sigma and protection level over time", caption, figure, 520)


def _broken(t_ns: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and values (n,), with a NaN in each pause, so that no line is drawn across it."""
    after = np.flatnonzero(np.diff(t_ns) * 1e-9 > numbers.longest_s(t_ns)) + 1
    return np.insert(t_ns, after, t_ns[after]), np.insert(y, after, np.nan)


def _log_step(values: np.ndarray) -> int | str:
    """Plotly's ``dtick`` of a logarithmic axis: whole decades, or 1, 2, 5 where there would be hardly any."""
    values = values[np.isfinite(values) & (values > 0.0)]
    return "D2" if not len(values) or values.max() / values.min() < FEW_DECADES else 1


def without_each(run: Run) -> Diagram | None:
    """How far the live state would move without each of the sensors; None where the run has none of it."""
    if not len(run.apart):
        return None
    figure, t = sheet(2, ["horizontal, m", "height, m"]), run.seconds(run.track["t_ns"])
    for row, (end, axis) in enumerate((("h", "horizontal"), ("v", "vertical")), 1):
        level = run.track[f"protection_{end}_m"]
        line(figure, t, level, "protection level, live", LIVE, row, dash="dot", connectgaps=False)
        shown = [level]
        for k in np.unique(run.apart["sensor"]).tolist():
            own, sensor = run.apart[run.apart["sensor"] == k], run.sensors[k]
            metres = np.maximum(own[f"{axis}_m"], LEAST_M)
            t_ns, metres = _broken(own["t_ns"], metres)
            line(figure, run.seconds(t_ns), metres, f"without {sensor}", colour_of(sensor, run.sensors), row)
            shown.append(metres)
        figure.update_yaxes(type="log", dtick=_log_step(np.concatenate(shown)), row=row, col=1)
    caption = (
        "How far the state would have moved, as all was known then, without this one sensor. A high line: "
        "the others alone say something else, so the state rests on this sensor, whether it lies or not. A "
        "sensor that is refused moves nothing: where one line stays low while others rise, these outvote "
        "it. Logarithmic, from 1 cm on, four times a second. A sensor has no line before it was heard, and "
        "where without it there would be no state."
    )
    return Diagram("Leave-one-sensor-out separation", caption, figure, 520)


def separation(run: Run) -> Diagram:
    """What later data changed, in m and in its own sigma."""
    apart, t = trust.separation(run), run.seconds(run.track["t_ns"])
    off = separation_sigmas(run, apart)
    figure = sheet(2, ["live − best, m", "in sigmas"])
    for k, (name, colour) in enumerate((("E", LIVE), ("N", BEST), ("U", LEVEL))):
        line(figure, t, apart[:, k], name, colour, 1)
        line(figure, t, off[:, k], name, colour, 2)
    figure.update_yaxes(range=[-6, 6], row=2, col=1)
    known = np.isfinite(off).all(axis=1)
    beyond = (np.abs(off[known]) > 3.0).mean() if known.any() else float("nan")
    caption = (
        "Forward against forward-and-backward. Below: in units of √(σ²live − σ²best), which is what the "
        f"difference of a filter and its smoother should be; beyond ±3 are {100 * beyond:.1f} % (0.3 % if "
        "every assumption held)."
    )
    return Diagram("Newest minus smoothed", caption, figure, 520)


def separation_sigmas(run: Run, apart: np.ndarray) -> np.ndarray:
    """(n, 3) separation in its own 1-sigma: its variance is P_filter − P_smoother (Mayne 1966)."""
    names = ("sigma_e_m", "sigma_n_m", "sigma_u_m")
    best = geometry.best(run, names, run.track["t_ns"])
    live = np.column_stack([run.track[name] for name in names])
    variance = live**2 - best**2
    with np.errstate(invalid="ignore"):
        return np.where(variance > (0.05 * live) ** 2, apart / np.sqrt(np.maximum(variance, 1e-12)), np.nan)


def systematic(run: Run) -> list[Diagram]:
    """Zero errors and clocks of each instrument over time, with 3 sigma; none where they were not kept."""
    out = []
    for sensor in run.heard:
        names = [name for name in dict.fromkeys(e.error for e in run.errors if e.sensor == sensor)]
        shown = [name for name in names if name not in ("ve", "vn", "vu")]
        if not shown:
            continue
        figure = sheet(len(shown), [f"{name}, {_unit(name)}" for name in shown])
        for row, name in enumerate(shown, 1):
            own = [e for e in run.errors if e.sensor == sensor and e.error == name]
            t = run.seconds(np.array([e.t_ns for e in own], np.int64))
            value, spread = (np.array([getattr(e, f) for e in own]) for f in ("value", "sigma"))
            colour = colour_of(sensor, run.sensors)
            line(figure, t, value, "value", colour, row)
            line(figure, t, value + 3 * spread, "± 3 sigma", colour, row, width=1, dash="dot")
            line(figure, t, value - 3 * spread, "± 3 sigma", colour, row, width=1, dash="dot")
            late = t >= t[-1] * BEGINS
            reach = max(np.abs(value).max(), (np.abs(value) + 3 * spread)[late].max())
            figure.update_yaxes(range=[-1.1 * reach, 1.1 * reach], row=row, col=1)
        caption = (
            "What it reads too much, as it was known then. The value should settle inside its band; one that "
            "wanders on is no constant error. The band of the first moments is wider than the picture."
        )
        out.append(Diagram(f"Systematic errors of {sensor}", caption, figure, 130 + 130 * len(shown)))
    return out


def availability(run: Run) -> Diagram:
    """When each sensor spoke, and how much of it was refused."""
    figure = sheet(1, [""])
    edges = np.linspace(run.start_ns, run.end_ns, SPAN_BINS + 1)
    width = (edges[1] - edges[0]) * 1e-9
    centre = run.seconds(0.5 * (edges[1:] + edges[:-1]))
    shares = []
    for sensor in run.heard:
        values = run.of(sensor)
        there, _ = np.histogram(values["t_ns"], edges)
        wrong, _ = np.histogram(values["t_ns"][is_one_of(values, REFUSED)], edges)
        shares.append(np.where(there > 0, 100.0 * wrong / np.maximum(there, 1), np.nan))
    figure.add_trace(
        go.Heatmap(
            x=np.asarray(centre, np.float32), y=run.heard, z=np.asarray(shares, np.float32), zmin=0, zmax=50,
            ygap=6, colorscale=[[0, BEST], [0.1, "#b8c400"], [0.4, "#e69f00"], [1, "#e43c14"]],
            colorbar={"title": {"text": "refused, %"}, "thickness": 12}, hoverongaps=False,
            hovertemplate="%{y}, %{x:.1f} s: %{z:.1f} %% refused<extra></extra>".replace("%%", "%"),
        )
    )  # fmt: skip
    figure.update_yaxes(autorange="reversed", showgrid=False)
    caption = (
        f"Each bar is a sensor, in pieces of {width:.2g} s: empty where nothing came, green where all was "
        "taken, red where half or more was refused."
    )
    return Diagram("Availability", caption, figure, 140 + 44 * len(run.heard))


def crossing(run: Run) -> Diagram | None:
    """The geometry of the instruments; None where there is none."""
    if not run.station.sensor:
        return None
    step_s = max((run.end_ns - run.start_ns) * 1e-9 / CROSSING_STEPS, 0.1)
    found = geometry.crossing(run, step_s)
    figure = sheet(3, ["crossing, °", "a fix, m", "dilution"])
    t = run.seconds(found.t_ns)
    line(figure, t, found.angle_deg, "best crossing angle", LIVE, 1)
    line(figure, t, found.horizontal_m, "horizontal, 1 sigma", BEST, 2)
    line(figure, t, found.height_m, "height, 1 sigma", LEVEL, 2)
    line(figure, t, found.dilution, "dilution", LIVE, 3)
    figure.update_yaxes(range=[0, 90], row=1, col=1)
    figure.update_yaxes(rangemode="tozero", row=2, col=1)
    figure.update_yaxes(rangemode="tozero", row=3, col=1)
    caption = (
        "Of the instruments that spoke in that second. Best crossing: the angle between two lines of sight "
        "that is nearest to 90°. A fix: what one measurement of each gives by the stated noise alone, "
        "without filter and INS. Dilution: the sigma of that fix over the width of the narrowest line of "
        "sight."
    )
    return Diagram("Crossing geometry", caption, figure, 560)


def _unit(name: str) -> str:
    if name in ("clock", "latency"):
        return "s"
    return "°" if name in ("azimuth", "elevation") else "m"
