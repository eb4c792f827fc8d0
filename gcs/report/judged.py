"""Tables of what was done with the values, and what that says of each sensor."""

import numpy as np

from gcs.contract.messages import CHANNELS, VERDICTS
from gcs.report.basis import numbers
from gcs.report.basis.page import Sheet, number, stated
from gcs.report.basis.run import ACCEPTED, LINE, REFUSED, Run, is_one_of, sigmas_off
from gcs.report.sources import clock

NAMES = (*CHANNELS, "line")
REASONS_LISTED = 25
SIGNIFICANT = 3.0  # sigmas from zero
FACTORS = 0.8, 1.25  # of the stated sigma: nearer to one, no instrument's noise is known beforehand
EXPECTED = 0.05  # share of refused values that radars show


def counts(run: Run) -> Sheet:
    """How many values by verdict, and the longest row of refused ones."""
    rows = []
    given = [k for k, n in enumerate(np.bincount(run.values["verdict"], minlength=len(VERDICTS))) if n]
    for sensor in run.heard:
        values = run.of(sensor)
        everything = run.values[run.values["sensor"] == run.sensors.index(sensor)]
        for channel in np.unique(everything["channel"]).tolist():
            of_all = np.bincount(
                everything["verdict"][everything["channel"] == channel], minlength=len(VERDICTS)
            )
            own = values[values["channel"] == channel]
            run_of = numbers.longest_run(own["t_ns"], is_one_of(own, REFUSED))
            refused = of_all[[VERDICTS.index(name) for name in REFUSED]].sum() / max(of_all.sum(), 1)
            rows.append(
                [
                    sensor, NAMES[channel], f"{of_all.sum():,}",
                    *(f"{of_all[k]:,}" if of_all[k] else "·" for k in given),
                    f"{100 * refused:.1f}", *_stretch(run_of),
                ]
            )  # fmt: skip
    head = [
        "sensor",
        "channel",
        "all",
        *(VERDICTS[k] for k in given),
        "refused, %",
        "longest run",
        "lasts, s",
        "from, UTC",
    ]
    note = (
        "Nothing that came in is missing here. Refused are isolated outliers and patches; a run is one of "
        "refused values without an accepted one between. A line is one that was no measurement."
    )
    if absent := [name for k, name in enumerate(VERDICTS) if k not in given]:
        note += f" No value is {' or '.join(absent)}."
    return Sheet("Values by verdict", head, rows, "nn" + "r" * (len(head) - 2), note)


def _stretch(run: numbers.Streak | None) -> list[str]:
    if run is None:
        return ["·", "·", "·"]
    return [str(run.length), number((run.last_ns - run.first_ns) * 1e-9), clock(run.first_ns)]


def reasons(run: Run) -> Sheet:
    """Why values were not simply used."""
    found = run.reasons.most_common()
    rows = [[*key, f"{n:,}"] for key, n in found[:REASONS_LISTED]]
    left = sum(n for _, n in found[REASONS_LISTED:])
    note = f"{left:,} values more have reasons of their own: verdicts.csv." if left else ""
    return Sheet("Reasons", ["sensor", "verdict", "reason", "values"], rows, "nnlr", note)


def errors(run: Run) -> Sheet:
    """The systematic errors at the end of the flight."""
    rows = []
    for sensor, own in run.summary.get("estimator", {}).get("sensors", {}).items():
        for name, error in own["errors"].items():
            value, sigma, prior, unit = in_degrees(error)
            times = abs(value) / sigma if sigma > 0 else float("nan")
            if not error["observable"]:
                says = "this flight does not show it"
            else:
                says = "significant" if times >= SIGNIFICANT else "not different from zero"
            rows.append(
                [sensor, name, number(value), number(sigma, 2), stated(prior), unit, f"{times:.1f}", says]
            )
    head = ["sensor", "error", "value", "1 sigma", "before, 1 sigma", "unit", "sigmas from zero", "says"]
    note = (
        "What the instrument reads too much. Significant from three sigmas on. "
        "Shown is what the flight has narrowed to half of what was allowed before it."
    )
    return Sheet("At the end of the flight", head, rows, "nnrrrlrl", note)


def in_degrees(error: dict) -> tuple[float, float, float, str]:
    """Value, sigma, prior sigma and unit of a reported error, angles in degrees."""
    scale, unit = (np.degrees(1.0), "°") if error["unit"] == "rad" else (1.0, error["unit"])
    return scale * error["value"], scale * error["sigma"], scale * error["prior_sigma"], unit


def consistency(run: Run) -> Sheet:
    """Whether each channel is as noisy as it says, and its residuals have no memory."""
    rows = []
    reported = run.summary.get("estimator", {}).get("sensors", {})
    for sensor in run.heard:
        values = run.of(sensor)
        for channel in np.unique(values["channel"]).tolist():
            if channel == LINE:
                continue
            accepted = values[(values["channel"] == channel) & is_one_of(values, ACCEPTED)]
            white = numbers.whiteness(sigmas_off(accepted))
            nis = reported.get(sensor, {}).get("channels", {}).get(NAMES[channel], {})
            mean, band = nis.get("nis_mean"), nis.get("nis_band_95")
            rows.append(
                [
                    sensor, NAMES[channel], f"{len(accepted):,}", number(mean),
                    "–" if band is None else f"{band[0]:.3f} to {band[1]:.3f}", says_of(mean, band),
                    number(None if mean is None else np.sqrt(mean), 2),
                    "–" if white is None else f"{white.lag1:+.3f}",
                    "–" if white is None else f"± {white.band:.3f}",
                    memory_of(white),
                ]
            )  # fmt: skip
    head = [
        "sensor", "channel", "accepted", "NIS", "95 % band", "says", "noise / stated", "lag-1 correlation",
        "95 % band", "says",
    ]  # fmt: skip
    note = (
        "NIS is the mean squared innovation over its variance, of used values as they came: 1 if the stated "
        "noise is true; the band is that of independent values. The correlation is that of neighbouring "
        "residuals (value minus what all other values say, before and after, in its own sigma). Above its "
        "band something slow is not modelled: a zero error, a clock, a drift. Below it a value's own "
        "neighbours are what predicts it best, which is no fault. What an INS reports is the output of a "
        "filter: its position is allowed a slow error, so its NIS is far below 1 and its residuals have a "
        "memory."
    )
    return Sheet("Consistency and whiteness", head, rows, "nnrrrnrrrn", note)


def says_of(mean: float | None, band: list[float] | None) -> str:
    """What a mean NIS says of the stated noise."""
    if mean is None or band is None:
        return "–"
    if band[0] <= mean <= band[1]:
        return "inside"
    near = FACTORS[0] <= np.sqrt(mean) <= FACTORS[1]
    side = "above" if mean > band[1] else "below"
    return f"{side}, slightly" if near else side


def memory_of(white: numbers.Whiteness | None) -> str:
    """What a lag-1 correlation says."""
    if white is None:
        return "–"
    if abs(white.lag1) <= white.band:
        return "white"
    return "slow error" if white.lag1 > 0 else "no slow error"
