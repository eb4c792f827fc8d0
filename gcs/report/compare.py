"""Two courses of the same flight on one clock: how far they are apart, and whether the sigmas say so."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go

from gcs.contract.frames import Frame
from gcs.contract.messages import InputError
from gcs.report.basis import numbers
from gcs.report.basis.drawing import BEST, LEVEL, LIVE, RAW, line, sheet
from gcs.report.basis.page import Chapter, Diagram, Document, Sheet, number
from gcs.report.basis.run import Run
from gcs.report.sources import clock, utc

SIGMA = ("sigma_e_m", "sigma_n_m", "sigma_u_m")
PAUSE, PAUSE_S = 5.0, 0.5  # of usual intervals, and at least: a longer pause is not bridged
BEYOND = 3.0  # sigmas


class Course(NamedTuple):
    """Where something was, at n times in order; station ENU of the first one's origin."""

    name: str
    t_ns: np.ndarray  # (n,)
    place_m: np.ndarray  # (n, 3)
    velocity_mps: np.ndarray | None = None  # (n, 3)
    sigma_m: np.ndarray | None = None  # (n, 3); None: taken as exact
    protection_m: np.ndarray | None = None  # (n, 2) horizontally and in height


class Difference(NamedTuple):
    """The first minus the second, at the k times of the first that the second covers."""

    first: Course
    second: Course
    t_ns: np.ndarray  # (k,)
    enu_m: np.ndarray  # (k, 3)
    velocity_mps: np.ndarray  # (k, 3) of the first
    sigma_m: np.ndarray  # (k, 3) of the difference, ENU
    protection_m: np.ndarray  # (k, 2) of the first


def of_run(run: Run, frame: Frame, *, live: bool) -> Course:
    """The best estimate of a run, or what was known ``live``."""
    rows = run.track if live else run.smoothed
    place = frame.to_enu(rows["lat_deg"], rows["lon_deg"], rows["alt_m"])
    velocity, sigma, level = (
        np.column_stack([rows[name] for name in names])
        for names in (("ve_mps", "vn_mps", "vu_mps"), SIGMA, ("protection_h_m", "protection_v_m"))
    )
    name = f"{run.folder.name}, {'live' if live else 'best estimate'}"
    return Course(name, rows["t_ns"], place, velocity, sigma, level)


def of_truth(path: Path, truth: np.ndarray, frame: Frame) -> Course:
    """A truth file's rows with ``t_ns``, ``lat_deg``, ``lon_deg``, ``alt_m``."""
    truth = truth[np.argsort(truth["t_ns"], kind="stable")]
    return Course(path.name, truth["t_ns"], frame.to_enu(truth["lat_deg"], truth["lon_deg"], truth["alt_m"]))


def difference(first: Course, second: Course) -> Difference:
    """Raises InputError, one line, where the two have no time in common."""
    reach_s = (
        max(PAUSE_S, PAUSE * float(np.median(np.diff(second.t_ns))) * 1e-9) if len(second.t_ns) > 1 else 0.0
    )
    there = numbers.at_times(first.t_ns, second.t_ns, second.place_m, reach_s)
    both = np.isfinite(there).all(axis=1)
    if not both.any():
        spans = [f"{c.name} covers {utc(c.t_ns[0], 0)} to {utc(c.t_ns[-1], 0)}" for c in (first, second)]
        raise InputError(f"{', '.join(spans)} UTC: no time in common; name two of the same flight")
    t_ns, apart = first.t_ns[both], (first.place_m - there)[both]
    assert first.velocity_mps is not None
    assert first.sigma_m is not None
    assert first.protection_m is not None
    variance = first.sigma_m[both] ** 2
    if second.sigma_m is not None:
        variance = variance + numbers.at_times(t_ns, second.t_ns, second.sigma_m, reach_s) ** 2
    return Difference(
        first, second, t_ns, apart, first.velocity_mps[both], np.sqrt(variance), first.protection_m[both]
    )


def time_shift_s(found: Difference) -> float:
    """The shift of all clocks, in s, that explains most: least squares of the difference on the velocity."""
    power = float((found.velocity_mps**2).sum())
    return float((found.enu_m * found.velocity_mps).sum()) / power if power else 0.0


def shifted(found: Difference, shift_s: float) -> np.ndarray:
    """(k, 3) the difference in ENU without what a time shift makes of it."""
    return found.enu_m - shift_s * found.velocity_mps


def distances(found: Difference) -> Sheet:
    """Statistics of the difference."""
    level, whole = np.hypot(*found.enu_m[:, :2].T), np.linalg.norm(found.enu_m, axis=1)
    flight = numbers.along_across_up(found.enu_m, found.velocity_mps)
    kinds = dict(zip(("along", "across, to the right", "up"), flight.T, strict=True))
    shift_s = time_shift_s(found)
    left = np.linalg.norm(shifted(found, shift_s), axis=1)
    kinds |= {"horizontal": level, "in space": whole, f"in space, {1e3 * shift_s:+.1f} ms taken off": left}
    rows = []
    for name, x in kinds.items():
        known = np.isfinite(x)
        if not known.any():
            rows.append([name, *["–"] * 6])
            continue
        size = np.abs(x[known])
        worst = int(np.flatnonzero(known)[np.argmax(size)])
        rows.append(
            [
                name, number(float(np.median(x[known]))), number(float(np.sqrt(np.mean(x[known] ** 2)))),
                *(number(float(q)) for q in np.percentile(size, (95.0, 99.0))), number(float(x[worst])),
                clock(int(found.t_ns[worst])),
            ]
        )  # fmt: skip
    head = ["m", "median", "RMS", "95 %", "99 %", "worst", "at, UTC"]
    note = (
        f"{found.first.name} minus {found.second.name}, at {len(found.t_ns):,} of {len(found.first.t_ns):,} "
        "states. Along and across only above 1 m/s. Percentiles are of the size. The last line is what a "
        "shift of all clocks together does not explain; no measurement shows such a shift where every clock "
        "floats."
    )
    return Sheet("Differences", head, rows, "nrrrrrr", note)


def consistency(found: Difference) -> Sheet:
    """Whether the stated sigmas and protection levels cover the difference."""
    both = [x / found.sigma_m for x in (found.enu_m, shifted(found, time_shift_s(found)))]
    rows = []
    for k, axis in enumerate("ENU"):
        shares = (f"{100 * np.mean(np.abs(off[:, k]) > BEYOND):.2f} %" for off in both)
        rows.append([f"{axis} beyond {BEYOND:g} sigma", *shares, "0.27 %"])
    rows.append(["NEES, mean", *(number(float(np.mean((off**2).sum(axis=1)))) for off in both), "3"])
    sizes = np.hypot(*found.enu_m[:, :2].T), np.abs(found.enu_m[:, 2])
    for name, size, level in zip(("horizontal", "height"), sizes, found.protection_m.T, strict=True):
        has = np.isfinite(level)
        share = f"{100 * np.mean(size[has] > level[has]):.3f} % of {has.sum():,}" if has.any() else "–"
        rows.append(
            [f"{name} beyond protection level", share, "–", "0.001 %" if has.any() else "there is none"]
        )
    exact = found.second.sigma_m is None
    note = (
        "The second is taken as exact. "
        if exact
        else "The sigmas of both are added as if they were independent; two runs of the same data are not. "
    )
    note += "NEES is the squared difference over its variance, summed over the axes. "
    note += "Only the live state has a protection level."
    return Sheet("Consistency", ["", "found", "time shift taken off", "expected"], rows, "nrrr", note)


def document(found: Difference) -> Document:
    """The page's content."""
    first, second = found.first, found.second
    start, end = int(found.t_ns[0]), int(found.t_ns[-1])
    facts = [
        ("First", first.name),
        ("Second", second.name),
        ("In common from, UTC", utc(start)),
        ("to, UTC", utc(end)),
        ("States compared", f"{len(found.t_ns):,}"),
    ]
    parts: list[Sheet | Diagram] = [
        distances(found),
        consistency(found),
        _over_time(found),
        _size(found),
        _plan(found),
    ]
    return Document(
        title="Comparison",
        subtitle=f"{first.name} minus {second.name}. Times in figures are seconds since {utc(start)} UTC.",
        facts=facts,
        verdict=None,
        remarks=None,
        chapters=[Chapter("How far they are apart", "", parts)],
        footer="Made by gcs compare. This file holds everything it shows and asks no network.",
    )


def _over_time(found: Difference) -> Diagram:
    figure = sheet(3, ["E, m", "N, m", "U, m"])
    t = (found.t_ns - found.t_ns[0]) * 1e-9
    for k in range(3):
        line(figure, t, found.enu_m[:, k], "difference", LIVE, k + 1)
        for sign in (1.0, -1.0):
            line(figure, t, sign * BEYOND * found.sigma_m[:, k], "± 3 sigma", RAW, k + 1, width=1, dash="dot")
        reach = 1.2 * max(np.abs(found.enu_m[:, k]).max(), 3.0 * float(np.median(found.sigma_m[:, k])))
        figure.update_yaxes(range=[-reach, reach], row=k + 1, col=1)
    caption = "It should stay inside the band; where it does not, one of the two is surer than it may be."
    return Diagram("Difference over time", caption, figure, 560)


def _size(found: Difference) -> Diagram:
    figure = sheet(2, ["horizontal, m", "height, m"])
    t = (found.t_ns - found.t_ns[0]) * 1e-9
    sizes = np.hypot(*found.enu_m[:, :2].T), np.abs(found.enu_m[:, 2])
    for row, (size, level) in enumerate(zip(sizes, found.protection_m.T, strict=True), 1):
        line(figure, t, size, "difference", LIVE, row)
        if np.isfinite(level).any():
            line(figure, t, level, "protection level", LEVEL, row)
    caption = "Where the first is a live state: the protection level should never be crossed."
    return Diagram("Size of the difference", caption, figure, 440)


def _plan(found: Difference) -> Diagram:
    figure = sheet(1, ["N, m"], time=False)
    begin, end = found.t_ns[0], found.t_ns[-1]
    for course, colour, width in ((found.second, RAW, 4), (found.first, BEST, 1.5)):
        place = course.place_m[(course.t_ns >= begin) & (course.t_ns <= end)]
        east, north = place[numbers.thin(3_000, *place.T), :2].T.astype(np.float32)
        style = {"color": colour, "width": width}
        figure.add_trace(go.Scatter(x=east, y=north, mode="lines", name=course.name, line=style))
    figure.update_xaxes(title_text="E, m")
    figure.update_yaxes(scaleanchor="x")
    return Diagram("Both from above", "The thin line should lie on the thick one.", figure, 560)
