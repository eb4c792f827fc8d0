"""The screening paper: ours beside the paper's; alone, and joined with the trajectory filter."""

from bench.papers.m3.screening import NOISE_M, OURS, OURS_OF, PAPER, Score
from bench.papers.show.report import Grid, Line

FALSE, IN_RUNS, JOINED = 5, 0.856, 0.99
SMALL = (
    "The paper does not say how large its outliers are. The threshold is 4.8 σ of one value: less would "
    "raise false alarms, and noise brings one of eight outliers of 6 σ below it."
)
ONE_NOISE = (
    f"The trajectory filter is told one noise for a record whose noise is {NOISE_M[0]:g} m near and "
    f"{NOISE_M[1]:g} m far: too strict far away, and blind to small outliers near."
)


def lines(found: dict) -> list[Line]:
    """Row 7 out of what `papers.measure.m3` found."""
    return [*map(_alone, found["alone"]), *map(_joined, found["joined"])]


def grids(found: dict) -> list[Grid]:
    """The paper's four methods and ours; its own figures in brackets."""
    return [_grid(one) for one in found["alone"]]


def _alone(found: dict) -> Line:
    scores = {method: Score(**one) for method, one in found["scores"].items()}
    ours = scores.pop(OURS)
    met = ours.false_alarms <= FALSE and ours.isolated == 1.0 and ours.in_runs >= IN_RUNS
    return Line(
        7,
        f"screening alone, {found['case']}: false alarms, isolated, in runs found",
        _said(PAPER[OURS_OF]),
        _said(ours),
        "; ".join(f"{method} {_said(one)}" for method, one in scores.items()),
        f"≤ {FALSE}, 100 %, ≥ {IN_RUNS:.1%}",
        met,
        "" if met else SMALL,
    )


def _joined(found: dict) -> Line:
    false, isolated, in_runs = found["either"]
    return Line(
        7,
        f"joined with the trajectory filter, {found['case']}, {found['seeds']} records",
        "asked for, not done",
        _said((0, false, isolated, in_runs)),
        f"the trajectory filter alone {_said((0, *found['trajectory']))}; "
        f"joined with the main job's five-point screening {_said((0, *found['five_point']))}",
        f"≥ {JOINED:.0%} in runs",
        in_runs >= JOINED,
        ONE_NOISE,
    )


def _said(score: tuple) -> str:
    _, false, isolated, in_runs = score
    return f"{false:g}, {isolated:.2%}, {in_runs:.2%}".replace(".00%", "%").replace("%", " %")


def _grid(found: dict) -> Grid:
    rows = []
    for method, one in found["scores"].items():
        ours = Score(**one)
        said = [*(f"{count:g}" for count in ours[:2]), *(f"{share:.2%}" for share in ours[2:])]
        if method in PAPER:
            count, false, isolated, in_runs = PAPER[method]
            paper = (f"{count}", f"{false}", f"{isolated:.1%}", f"{in_runs:.1%}")
            said = [f"{a} ({b})" for a, b in zip(said, paper, strict=True)]
        rows.append((method, *said))
    columns = ("method", "restarts", "false alarms", "isolated found", "in runs found")
    return Grid(f"screening one range, {found['case']}: ours (the paper's)", columns, rows)
