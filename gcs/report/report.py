"""The report of one run: what stands on its page, and in which order."""

from gcs.report import certainty, flight, judged, remarks, residuals, sources, trust
from gcs.report.basis.page import Chapter, Diagram, Document, Sheet
from gcs.report.basis.run import Run
from gcs.report.sources import clock, utc
from gcs.report.trust import Tolerance

Parts = list[Sheet | Diagram | None]
EVENTS_LISTED = 60
WITHOUT_EACH = (
    "The largest separation of the live state from the states without each one of the sensors is inside the "
    "protection level. What the best estimate is without one of them: replay without its --feed into another "
    "folder, and hold the two against each other with gcs compare."
)


def document(run: Run, tolerance: Tolerance) -> Document:
    """The page's content."""
    found = trust.criteria(run, tolerance)
    seconds = (run.end_ns - run.start_ns) * 1e-9
    return Document(
        title=f"Flight report {run.station.range.name} / {run.station.vehicle.name}",
        subtitle=f"{utc(run.start_ns, 0)} UTC. Times in figures are seconds since the first state.",
        facts=_facts(run, seconds),
        verdict=trust.verdict(run, found),
        remarks=remarks.remarks(run),
        chapters=_on_one_time(_chapters(run, tolerance, found), run, seconds),
        footer="Made by gcs report from the run folder alone; it asks no network.",
    )


def _facts(run: Run, seconds: float) -> list[tuple[str, str]]:
    refused = sum(n for (_, verdict, _), n in run.reasons.items() if verdict in ("isolated", "patch"))
    return [
        ("First state, UTC", utc(run.start_ns)),
        ("Last state, UTC", utc(run.end_ns)),
        ("Duration", f"{seconds:.1f} s"),
        ("States, live / best estimate", f"{len(run.track):,} / {len(run.smoothed):,}"),
        ("Values that came in", f"{len(run.values):,} of {len(run.heard)} sensors"),
        ("Refused as outliers", f"{refused:,} ({100 * refused / max(len(run.values), 1):.2f} %)"),
        ("Method", str(run.summary.get("settings", {}).get("method", "not stated"))),
        ("Run folder", str(run.folder)),
    ]


def _chapters(run: Run, tolerance: Tolerance, found: list[trust.Criterion]) -> list[Chapter]:
    result: Parts = [trust.tolerances(found), trust.percentiles(run), trust.shares(run)]
    shown: Parts = [flight.plan(run), flight.replay(run), flight.motion(run)]
    sure: Parts = [
        certainty.sigma(run, tolerance),
        certainty.without_each(run),
        certainty.separation(run),
        certainty.crossing(run),
    ]
    given: Parts = [
        sources.inputs(run),
        sources.feeds(run),
        sources.gap_list(run),
        certainty.availability(run),
    ]
    clocks: Parts = [sources.clocks(run), sources.log_damage(run)]
    done: Parts = [judged.counts(run), judged.reasons(run), judged.consistency(run), *residuals.figures(run)]
    errors: Parts = [judged.errors(run), *certainty.systematic(run), flight.ins_minus_fused(run)]
    air: Parts = [flight.wind(run), _wind(run), _resets(run), _events(run)]
    stated: Parts = [sources.site(run), sources.instruments(run), sources.settings(run), sources.outputs(run)]
    return [
        _chapter("Result", [*result, *shown]),
        _chapter("How sure it is", sure, WITHOUT_EACH),
        _chapter("What went in", [*given, *clocks]),
        _chapter("What was done with it", done),
        _chapter("Systematic errors", errors),
        _chapter("Wind and events", air),
        _chapter("Station and settings", stated),
    ]


def _chapter(title: str, parts: Parts, intro: str = "") -> Chapter:
    """With what there is of the ``parts``."""
    return Chapter(title, intro, [part for part in parts if part is not None])


def _on_one_time(chapters: list[Chapter], run: Run, seconds: float) -> list[Chapter]:
    """All figures over time begin and end together."""
    begin_s = min(0.0, float(run.seconds(run.smoothed["t_ns"][:1])[0]))
    for part in (part for chapter in chapters for part in chapter.parts):
        if isinstance(part, Diagram) and part.figure.layout.meta.get("time"):
            part.figure.update_xaxes(range=[begin_s, seconds])
    return chapters


def _wind(run: Run) -> Sheet:
    wind = run.summary.get("wind") or {}
    rows = []
    for name, key in (("found, median", "median"), ("autopilot's own, median", "autopilot_median")):
        if one := wind.get(key):
            rows.append([name, f"{one['speed_mps']:.1f} m/s from {one['from_deg']:.0f}°"])
    if wind:
        rows.append(["known for", f"{100 * wind['known_share']:.0f} % of the time"])
        rows.append(["true airspeed over the measured one", f"{wind['airspeed_scale']:.3f}"])
    return Sheet("Mean wind", ["", ""], rows, "nl", "" if rows else "No air data came.")


def _resets(run: Run) -> Sheet:
    resets = run.summary.get("estimator", {}).get("resets", [])
    rows = [[clock(one["t_ns"]), one["reason"]] for one in resets]
    note = "Never draw or differentiate across one." if rows else ""
    return Sheet("New starts of the filter", ["UTC", "why"], rows, "nl", note)


def _events(run: Run) -> Sheet:
    shown = run.events[:EVENTS_LISTED]
    rows = [[clock(t_ns), level, text] for t_ns, level, text in shown]
    more = len(run.events) - len(shown)
    note = f"{more:,} more are in events.csv." if more else "As the operator was told."
    return Sheet("Events", ["UTC", "level", "what"], rows, "nnl", note)
