"""The correction network of the GA-BP-UKF paper: how it begins, what it gains, what it costs."""

from bench.papers.show.report import Grid, Line

INFERENCE_US, TRAINING_S = 3.0, 600.0
SAME = 1.005  # 1.00 to the digits asked for
KINDS = {"position_m": "position", "velocity_mps": "velocity", "acceleration_mps2": "acceleration"}


def lines(found: dict) -> list[Line]:
    """Rows 4 to 6 out of what `papers.measure.m1` found."""
    network = found["network"]
    total = network["total"]
    ratios = (
        f"{name} {total[kind]['ratio']:.3f} (worst {total[kind]['worst']:.3f})"
        for kind, name in KINDS.items()
    )
    gain = Line(
        5,
        "error with the correction to that without, flights and geometries never seen",
        "",
        ", ".join(ratios),
        "off 1.000",
        "none worse than 1.00",
        max(one["worst"] for one in total.values()) < SAME,
        ""
        if network["installed"]
        else "It leaves the position as it is, so it is not installed: off by default.",
    )
    cost = Line(
        6,
        "one inference; the whole training",
        "",
        f"{network['inference_us']:.1f} µs ({network['compiled_us']:.2f} µs in compiled code); "
        f"{network['training_s']:.0f} s",
        "",
        f"≤ {INFERENCE_US:.0f} µs; ≤ {TRAINING_S / 60:.0f} min",
        network["inference_us"] <= INFERENCE_US and network["training_s"] <= TRAINING_S,
    )
    return [_starts(found["training_starts"]), gain, cost]


def grid(found: dict) -> Grid:
    """Trainings from each start."""
    rows = []
    for name, one in found["training_starts"].items():
        kept = (f"{one[key]:.2f}" if key in one else "–" for key in ("diversity", "parents"))
        rows.append((name, *(f"{figure:.3f}" for figure in one["after"]), *kept))
    quantiles = ("best", "quarter", "median", "three quarters", "worst")
    columns = ("start", *quantiles, "diversity left", "different parents")
    return Grid("trainings on what an EKF leaves: held-out error, sigma²", columns, rows)


def _starts(found: dict) -> Line:
    after = {}
    for name, one in found.items():
        best, _, median, _, worst = one["after"]
        after[name] = f"{median:.2f} ({best:.2f} … {worst:.2f})"
    left = {name: f"{found[name]['diversity']:.2f}" for name in ("improved", "classic")}
    parents = {name: f"{found[name]['parents']:.1f}" for name in left}
    return Line(
        4,
        "trainings: median (best … worst) held-out error, sigma²; diversity left, different parents",
        "the improved roulette keeps diversity",
        f"{after['improved']}; {left['improved']}, {parents['improved']}",
        f"classic {after['classic']}; {left['classic']}, {parents['classic']}; random {after['random']}; "
        f"no network {found['no network']['after'][2]:.2f}",
        "stated",
    )
