"""Tables of what went in: files and their hashes, gaps, clocks, station, settings."""

import hashlib
import platform
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from gcs import __version__
from gcs.contract.messages import INSTRUMENT_CHANNELS
from gcs.report.basis import numbers
from gcs.report.basis.page import Sheet, number, stated
from gcs.report.basis.run import Run

GAPS_LISTED = 30


def utc(t_ns: int, digits: int = 3) -> str:
    """A time for a table, UTC."""
    seconds, rest = divmod(int(t_ns), 10**9)
    text = datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S")
    return f"{text}.{rest // 10 ** (9 - digits):0{digits}d}" if digits else text


def clock(t_ns: int) -> str:
    """The time of day of a time, UTC."""
    return utc(t_ns)[11:]


def inputs(run: Run) -> Sheet:
    """Every file that the run was made of, as it was hashed when it was read."""
    read = run.summary.get("inputs", {})
    rows = [[role, one["file"], f"{one['bytes']:,}", one["sha256"]] for role, one in read.items()]
    note = "The hash tells whether a file is still the one that was replayed."
    if not rows:
        note = "The run names no file: it was live, did not end, or is of a version that kept no hashes."
    return Sheet("Inputs", ["input", "file", "bytes", "SHA-256"], rows, "nlrh", note)


def outputs(run: Run) -> Sheet:
    """The run folder's own files, but no report, hashed now."""
    there = sorted(path for path in run.folder.iterdir() if path.is_file() and path.suffix != ".html")
    rows = [[path.name, f"{path.stat().st_size:,}", _sha256(path)] for path in there]
    return Sheet(
        "Files of this run", ["file", "bytes", "SHA-256"], rows, "nrh", "As they were read for this report."
    )


def feeds(run: Run) -> Sheet:
    """Rate and gaps of each sensor."""
    rows = []
    for sensor in run.heard:
        values = run.of(sensor)
        found = numbers.gaps(values["t_ns"])
        pace = run.summary.get("pace", {}).get(sensor, {})
        longest = max(found, key=lambda gap: gap.seconds, default=None)
        rows.append(
            [
                sensor, f"{len(values):,}", number(pace.get("rate_hz")), str(len(found)),
                number(longest.seconds if longest else None), clock(longest.begin_ns) if longest else "–",
                number(sum(gap.seconds for gap in found)) if found else "–",
            ]
        )  # fmt: skip
    head = ["sensor", "values", "rate, Hz", "gaps", "longest, s", "from, UTC", "all together, s"]
    note = (
        "A gap is longer than five usual intervals, and longer than 0.5 s. The INS sends its channels at "
        "rates of their own."
    )
    return Sheet("Feeds and their gaps", head, rows, "nrrrrrr", note)


def gap_list(run: Run) -> Sheet:
    """Every gap, the longest ones where there are many."""
    found = [(gap, sensor) for sensor in run.heard for gap in numbers.gaps(run.of(sensor)["t_ns"])]
    shown = sorted(found, key=lambda one: -one[0].seconds)[:GAPS_LISTED]
    rows = [
        [sensor, clock(gap.begin_ns), clock(gap.end_ns), number(gap.seconds)]
        for gap, sensor in sorted(shown, key=lambda one: one[0].begin_ns)
    ]
    note = f"The longest {GAPS_LISTED} of {len(found)}." if len(found) > GAPS_LISTED else ""
    return Sheet("Gaps", ["sensor", "last before, UTC", "first after, UTC", "s"], rows, "nrrr", note)


def clocks(run: Run) -> Sheet:
    """How each source's time became UTC, and what its clock was found to be off."""
    rows = []
    log = run.summary.get("log") or {}
    for k, boot in enumerate(log.get("boots", []), 1):
        span = "boot time {} to {} s".format(*(number(s, 6) for s in boot["boot_s"]))
        how = f"{span}, clock {boot['clock']}, drift {number(boot['drift_ppm'])} ppm"
        rows.append([f"ins, boot {k}", how, "–", "–"])
    for name, error in _clock_errors(run):
        seen = "" if error["observable"] else " (the flight does not show it)"
        rows.append([name, f"estimated{seen}", number(1e3 * error["value"]), number(1e3 * error["sigma"])])
    for sensor in run.station.sensor:
        late = {channel: s for channel, s in sensor.latency_by_channel.items() if s}
        if late:
            delays = ", ".join(f"{channel} {1e3 * s:g} ms" for channel, s in late.items())
            rows.append([sensor.name, f"known latency, taken off: {delays}", "–", "–"])
    note = (
        "Valid time = stamp − offset. Where all clocks float, only their differences can be seen; their "
        "common shift is that most sensors agree on."
    )
    return Sheet("Clocks", ["source", "how", "offset, ms", "1 sigma, ms"], rows, "nlrr", note)


def _clock_errors(run: Run) -> list[tuple[str, dict]]:
    sensors = run.summary.get("estimator", {}).get("sensors", {})
    return [
        (s, e)
        for s, own in sensors.items()
        for name, e in own["errors"].items()
        if name in ("clock", "latency")
    ]


def log_damage(run: Run) -> Sheet | None:
    """What was wrong with the flight log; None without one."""
    log = run.summary.get("log")
    if not log:
        return None
    rows = [
        [name.replace("_", " "), _plain(value)]
        for name, value in log.items()
        if name not in ("boots", "systems") and value is not None
    ]
    return Sheet(
        "Flight log", ["", ""], sorted(rows), "nl", "Good frames were used; what was not is counted."
    )


def site(run: Run) -> Sheet:
    """Where everything stands."""
    origin = [f"{run.frame.lat_deg:.7f}", f"{run.frame.lon_deg:.7f}", f"{run.frame.alt_m:.2f}"]
    said = "stated" if run.station.range.origin else "the flight's first position"
    rows = [["origin", said, *origin, "0.00", "0.00", "0.00"]]
    for sensor in run.station.sensor:
        offset, _ = run.frame.place_sensor(sensor)
        at = sensor.position
        rows.append(
            [
                sensor.name, sensor.kind, f"{at.lat_deg:.7f}", f"{at.lon_deg:.7f}", f"{at.alt_m:.2f}",
                *(f"{x:.2f}" for x in offset),
            ]
        )  # fmt: skip
    height = run.summary.get("height", {}).get("geoid_separation_from", "not stated")
    separation = {
        "receiver": "the receiver's own", "station file": "the station file's",
        "unknown": "not known, so taken as zero",
    }.get(height, height)  # fmt: skip
    note = (
        "Datum: WGS84, heights above the ellipsoid; local frame East-North-Up at the origin. Geoid "
        f"separation of the INS height: {separation}."
    )
    head = ["", "what", "latitude, °", "longitude, °", "height, m", "E, m", "N, m", "U, m"]
    return Sheet("Station, datum and geoid", head, rows, "nnrrrrrr", note)


def instruments(run: Run) -> Sheet:
    """What was said of each instrument before the flight."""
    rows = []
    for sensor in run.station.sensor:
        noise = sensor.sigma_by_channel
        rows.append(
            [
                sensor.name, *(stated(noise.get(channel)) for channel in INSTRUMENT_CHANNELS),
                f"{sensor.tilt_deg.east:g} / {sensor.tilt_deg.north:g}", f"{sensor.orientation_deg:g}",
                sensor.refraction, ", ".join(sensor.estimate) or "nothing",
            ]
        )  # fmt: skip
    head = [
        "instrument", "σ range, m", "σ azimuth, °", "σ elevation, °", "σ range rate, m/s", "tilt E / N, °",
        "orientation, °", "refraction", "estimated",
    ]  # fmt: skip
    return Sheet("Instruments as stated", head, rows, "nrrrrrrll")


def settings(run: Run) -> Sheet:
    """Every setting that steered the run, and the versions."""
    chosen = run.summary.get("settings", {})
    software = run.summary.get("software", {})
    rows = [["software", f"{software.get('name', 'gcs')} {software.get('version', 'not stated')}"]]
    rows += [["report made by", f"gcs {__version__}, Python {platform.python_version()}"]]
    rows += [["method", str(chosen.get("method", "not stated"))]]
    rows += [["learned correction", "on" if chosen.get("learned_correction") else "off"]]
    station = msgspec.to_builtins(run.station)
    for section in ("vehicle", "ins", "align", "screening", "filter"):
        rows += [
            [f"{section}.{name}", _plain(value)]
            for name, value in station[section].items()
            if value is not None
        ]
    return Sheet("Settings and versions", ["setting", "value"], rows, "nl", "All others are in station.toml.")


def _plain(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_plain(x)}" for name, x in value.items()) or "none"
    return f"{value:,}" if isinstance(value, int) else str(value)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
