"""What no threshold can decide: lines for the one who signs."""

import numpy as np

from gcs.contract.messages import VERDICTS
from gcs.report import judged
from gcs.report.basis import numbers
from gcs.report.basis.run import LINE, REFUSED, Run, is_one_of
from gcs.report.sources import clock
from gcs.report.trust import common_clock_s, percent

LISTED = 10  # of a kind; the rest are counted


def remarks(run: Run) -> list[str]:
    """All of them, what is missing or damaged first."""
    found = list(run.remarks)
    if run.summary and not run.summary.get("complete", True):
        found.append("The replay was stopped before the end of the flight.")
    if run.summary.get("height", {}).get("geoid_separation_from") == "unknown" and "ins" in run.heard:
        found.append("The geoid separation is not known: the INS height may be off by tens of metres.")
    if late_s := common_clock_s(run):
        fastest = float(numbers.horizontal(run.smoothed, ("ve_mps", "vn_mps")).max())
        found.append(
            f"No clock is taken as right, so the time of all is known to {1e3 * late_s:.0f} ms (1 sigma): "
            f"up to {late_s * fastest:.2g} m along the course at {fastest:.0f} m/s. Sigma and protection "
            "level contain it. It ends where one sensor's clock is right: leave clock out of its estimate."
        )
    lost = {name.replace("_", " "): n for name, n in run.summary.get("bus", {}).items() if n}
    if lost:
        found.append(f"Messages lost on the bus: {', '.join(f'{name} {n:,}' for name, n in lost.items())}.")
    if strangers := run.summary.get("unknown_sources"):
        found.append(f"Not of this station, and left out: {', '.join(strangers)}.")
    found += _of_the_track(run) + _of_the_sensors(run)
    counted = sum(
        sum(one.values())
        for channels in run.summary.get("verdicts", {}).values()
        for one in channels.values()
    )
    if run.summary and counted != len(run.values):
        found.append(
            f"verdicts.csv has {len(run.values):,} values, the summary counts {counted:,}: a file was "
            "changed."
        )
    return found


def _of_the_track(run: Run) -> list[str]:
    live, t, found = run.track, run.track["t_ns"], []
    doubt, bare = (
        numbers.time_share(t, live["ambiguous"] > 0),
        numbers.time_share(t, ~np.isfinite(live["protection_h_m"])),
    )
    if doubt > 0.001:
        found.append(
            f"For {percent(doubt)} % of the time another position fitted the measurements nearly as well."
        )
    if bare > 0.001:
        found.append(
            f"For {percent(bare)} % of the time there was no protection level: nothing would have shown a "
            "lie."
        )
    resets = run.summary.get("estimator", {}).get("resets", [])
    found += _some([f"The filter began again at {clock(one['t_ns'])}: {one['reason']}." for one in resets])
    pauses = numbers.gaps(t, least_s=numbers.LONGEST_STEP_S)
    found += _some([f"No state for {gap.seconds:.1f} s from {clock(gap.begin_ns)} on." for gap in pauses])
    if reckoned := run.summary.get("wind") and run.summary["wind"].get("states_reckoned"):
        found.append(
            f"{reckoned:,} states are dead reckoning by air data and wind; no measurement supports them."
        )
    return found


def _of_the_sensors(run: Run) -> list[str]:
    found = [
        f"{sensor.name}: no value came." for sensor in run.station.sensor if sensor.name not in run.heard
    ]
    for sensor in run.heard:
        values = run.of(sensor)
        for channel in np.unique(values["channel"][values["channel"] != LINE]).tolist():
            refused = is_one_of(values[values["channel"] == channel], REFUSED).mean()
            if refused > judged.EXPECTED:
                found.append(
                    f"{sensor} {judged.NAMES[channel]}: {100 * refused:.1f} % of the values are refused."
                )
        found += _invalid(run, sensor)
        if sensor != "ins":
            found += _noise(run, sensor)
    return found


def _invalid(run: Run, sensor: str) -> list[str]:
    """What could not be used at all: values with the most frequent reason, and lines without a value."""
    own = run.values[run.values["sensor"] == run.sensors.index(sensor)]
    lines = own["channel"] == LINE
    count = int(((own["verdict"] == VERDICTS.index("invalid")) & ~lines).sum())
    found = [f"{sensor}: {lines.sum():,} lines were no measurements."] if lines.any() else []
    if count:
        reasons = {key[2]: n for key, n in run.reasons.items() if key[:2] == (sensor, "invalid")}
        most = max(reasons, key=reasons.__getitem__, default="no reason is given")
        found.append(f"{sensor}: {count:,} values are invalid, most of them: {most}.")
    return found


def _some(lines: list[str]) -> list[str]:
    """The first LISTED, and how many more there are."""
    more = len(lines) - LISTED
    return lines if more <= 0 else [*lines[:LISTED], f"… and {more} more of these."]


def _noise(run: Run, sensor: str) -> list[str]:
    """Channels of an instrument whose noise is not what was stated, and large systematic errors."""
    own, found = run.summary.get("estimator", {}).get("sensors", {}).get(sensor, {}), []
    for channel, one in own.get("channels", {}).items():
        if one["nis_mean"] is not None and judged.says_of(one["nis_mean"], one["nis_band_95"]) in (
            "above",
            "below",
        ):
            found.append(
                f"{sensor} {channel}: the noise is {np.sqrt(one['nis_mean']):.2f} times what is stated."
            )
    for name, error in own.get("errors", {}).items():
        value, sigma, prior, unit = judged.in_degrees(error)
        if (
            error["observable"]
            and abs(value) > judged.SIGNIFICANT * max(sigma, 0.0)
            and abs(value) > 2.0 * prior
        ):
            found.append(
                f"{sensor} {name}: {value:.3g} {unit} too much, far more than was allowed for ({prior:.2g} "
                f"{unit})."
            )
    return found
