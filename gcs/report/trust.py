"""How far the result can be trusted: percentiles, the verdict against tolerances, and what to judge."""

from typing import NamedTuple

import numpy as np

from gcs.report.basis import geometry, numbers
from gcs.report.basis.page import Finding, Sheet, number, stated
from gcs.report.basis.run import Run
from gcs.report.sources import clock

EN = ("sigma_e_m", "sigma_n_m")


class Tolerance(NamedTuple):
    """What the test allows, m; None: not stated."""

    horizontal_m: float | None = None
    vertical_m: float | None = None


class Criterion(NamedTuple):
    """A number for each state that is held against a tolerance."""

    name: str
    t_ns: np.ndarray  # (n,)
    reached_m: np.ndarray  # (n,); NaN: there is none
    allowed_m: float | None
    decides: bool  # part of the verdict, or for information


def common_clock_s(run: Run) -> float:
    """1 sigma in s of the time that all sensors share; 0 where the clock of one of them is taken as right.

    A shift of all clocks together moves the track along itself and no measurement shows it: the published
    sigma contains it. So does every floating clock's own sigma: the smallest one bounds it.
    """
    sensors = run.summary.get("estimator", {}).get("sensors", {})
    floating = [sensors.get(sensor, {}).get("errors", {}) for sensor in run.heard]
    sigmas = [e["sigma"] for errors in floating for name, e in errors.items() if name in ("clock", "latency")]
    return min(sigmas, default=0.0) if len(sigmas) == len(run.heard) else 0.0


def criteria(run: Run, tolerance: Tolerance) -> list[Criterion]:
    """What is held against the tolerances: of the best estimate, and of what was known live."""
    best, live = run.smoothed, run.track
    h, v = tolerance
    level, height = numbers.horizontal(best, EN), best["sigma_u_m"]
    return [
        Criterion(
            "best estimate, horizontal, 95 %", best["t_ns"], numbers.DRMS_95 * level, h, True
        ),
        Criterion("best estimate, height, 95 %", best["t_ns"], numbers.NORMAL_95 * height, v, True),
        Criterion("live protection level, horizontal", live["t_ns"], live["protection_h_m"], h, False),
        Criterion("live protection level, height", live["t_ns"], live["protection_v_m"], v, False),
    ]  # fmt: skip


def within(criterion: Criterion) -> float:
    """Share of the time, 0 … 1, for which the tolerance is kept; without a number it is not."""
    assert criterion.allowed_m is not None
    return numbers.time_share(
        criterion.t_ns, np.nan_to_num(criterion.reached_m, nan=np.inf) <= criterion.allowed_m
    )


def tolerances(found: list[Criterion]) -> Sheet:
    """Each criterion with its worst moment."""
    rows = []
    for one in found:
        known = np.isfinite(one.reached_m)
        worst = int(np.argmax(np.where(known, one.reached_m, -np.inf))) if known.any() else None
        kept = None if one.allowed_m is None else within(one)
        rows.append(
            [
                one.name, stated(one.allowed_m), "–" if kept is None else percent(kept),
                "–" if worst is None else number(one.reached_m[worst]),
                "–" if worst is None else clock(int(one.t_ns[worst])),
                percent(numbers.time_share(one.t_ns, known)),
                "not stated" if kept is None else ("met" if kept == 1.0 else "not met"),
            ]
        )  # fmt: skip
    head = [
        "criterion",
        "tolerance, m",
        "kept, % of time",
        "worst, m",
        "at, UTC",
        "known, % of time",
        "verdict",
    ]
    note = (
        "The best estimate's numbers come from its own sigma: 2 √(σE² + σN²), which covers 95 to 98 %, and "
        "1.96 σU. The protection level bounds the error of what was known live although any one sensor lies, "
        "at a risk of 1e-5; it is told for information, because the best estimate has all data and later "
        "ones too."
    )
    return Sheet("Tolerances", head, rows, "nrrrrrn", note)


def verdict(run: Run, found: list[Criterion]) -> Finding:
    """The best estimate against the tolerances; open where none is stated or the run did not end."""
    decisive = [one for one in found if one.decides and one.allowed_m is not None]
    if not decisive:
        return Finding(
            "No tolerance stated", "open",
            ["State what the test allows: gcs report DIR --tolerance-h METRES --tolerance-v METRES."],
        )  # fmt: skip
    reasons = [
        f"{one.name}: {percent(within(one))} % of the time within {stated(one.allowed_m)} m, worst "
        f"{number(np.nanmax(one.reached_m))} m at {clock(int(one.t_ns[np.nanargmax(one.reached_m)]))}"
        for one in decisive
    ]
    if not run.summary.get("complete", bool(run.summary)):
        return Finding("Open: the run did not end", "open", reasons)
    met = all(within(one) == 1.0 for one in decisive)
    return Finding("Within tolerance" if met else "Not within tolerance", "good" if met else "bad", reasons)


def percentiles(run: Run) -> Sheet:
    """Of sigma, protection level and what later data changed."""
    best, live = run.smoothed, run.track
    apart = separation(run)
    kinds = [
        ("best estimate, σ horizontal", best["t_ns"], numbers.horizontal(best, EN)),
        ("best estimate, σ height", best["t_ns"], best["sigma_u_m"]),
        ("live, σ horizontal", live["t_ns"], numbers.horizontal(live, EN)),
        ("live, σ height", live["t_ns"], live["sigma_u_m"]),
        ("live, protection level horizontal", live["t_ns"], live["protection_h_m"]),
        ("live, protection level height", live["t_ns"], live["protection_v_m"]),
        ("live − best estimate, horizontal", live["t_ns"], np.hypot(apart[:, 0], apart[:, 1])),
        ("live − best estimate, height", live["t_ns"], np.abs(apart[:, 2])),
    ]
    rows = []
    for name, t_ns, metres in kinds:
        known = np.isfinite(metres)
        if not known.any():
            rows.append([name, "–", "–", "–", "–", "–"])
            continue
        worst = int(np.nanargmax(np.where(known, metres, -np.inf)))
        levels = np.percentile(metres[known], numbers.LEVELS)
        rows.append([name, *(number(x) for x in levels), number(metres[worst]), clock(int(t_ns[worst]))])
    head = ["m", *(f"{level:.0f} %" for level in numbers.LEVELS), "worst", "at, UTC"]
    note = "Over the states. σ horizontal is √(σE² + σN²). Sigma is no bound against a sensor that lies."
    return Sheet("Sigma and protection level", head, rows, "nrrrrr", note)


def shares(run: Run) -> Sheet:
    """For which part of the time something held."""
    live, t = run.track, run.track["t_ns"]
    pauses = numbers.gaps(t, least_s=numbers.LONGEST_STEP_S)
    rows = [
        [
            "ambiguous: another position fitted nearly as well",
            percent(numbers.time_share(t, live["ambiguous"] > 0)),
        ],
        ["no protection level", percent(numbers.time_share(t, ~np.isfinite(live["protection_h_m"])))],
        ["quality −1: failed", percent(numbers.time_share(t, live["quality"] < 0))],
    ]
    rows += [
        [
            "pauses without a state, all together",
            f"{sum(gap.seconds for gap in pauses):.1f} s in {len(pauses)}",
        ]
    ]
    rows += [["new starts of the filter", str(int(live["reset_counter"].max()))]]
    return Sheet("Shares of the time", ["live state", "% of time"], rows, "lr")


def separation(run: Run) -> np.ndarray:
    """(n, 3) live minus best estimate in m, ENU, at the live states."""
    live = np.column_stack([run.track[name] for name in ("e_m", "n_m", "u_m")])
    return live - geometry.positions(run, run.track["t_ns"])


def percent(share: float) -> str:
    """Never 100 for less than everything, never 0 for more than nothing."""
    text = f"{100 * share:.2f}"
    if text == "100.00":
        return "100" if share == 1.0 else "99.99"
    return "< 0.01" if text == "0.00" and share > 0 else text
