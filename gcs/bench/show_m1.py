"""The GA-BP-UKF paper: ours beside the paper's and the baselines'."""

import numpy as np

from gcs.bench.papers_report import Grid, Line

PAPER = {"bp-ekf": (31.5347, 12.1745, 18.8466, 9.7875), "ga-bp-ukf": (9.0323, 9.6778, 11.9063, 6.5939)}
PAPER_GRADIENT_M = {"adaptive kalman + wavelet": 4.0753, "ga-bp-ukf": 2.0552}
WAVELET = "adaptive kalman + wavelet"
HALF, RISE, INFERENCE_US, TRAINING_S = 0.5, 1.1, 3.0, 600.0
SAME = 1.005  # 1.00 to the digits asked for
KINDS = {"position_m": "position", "velocity_mps": "velocity", "acceleration_mps2": "acceleration"}


def lines(found: dict) -> list[Line]:
    """Rows 1 to 6 out of what `papers.measure_m1` found."""
    return [
        *_simulations(found["simulations"], found["start_known"]),
        *(_gradient(level, one) for level, one in found["smoothness"].items()),
        _starts(found["training_starts"]),
        *_network(found["network"]),
    ]


def grids(found: dict) -> list[Grid]:
    """The figures behind them."""
    columns = ("method", "mean absolute", "median flight", "RMSE", "RMSE with outliers", "ratio")
    simulations = [
        (name, *(f"{figure:.3f}" for figure in one.values())) for name, one in found["simulations"].items()
    ]
    known = [
        (f"{one['start_m']:.0f}", f"{one['ekf']:.3f}", f"{one['ukf']:.3f}", f"{one['ratio']:.3f}")
        for one in found["start_known"]
    ]
    starts = [
        (
            name,
            *(f"{figure:.3f}" for figure in one["after"]),
            *(f"{one[k]:.2f}" if k in one else "–" for k in KEPT),
        )
        for name, one in found["training_starts"].items()
    ]
    return [
        Grid("simulations 1 and 2: position error per axis, m", columns, simulations),
        Grid(
            "what hangs on the start: mean absolute error per axis, m, without networks",
            ("start known to, m", "EKF", "UKF", "ratio"),
            known,
        ),
        Grid(
            "starts of the training on what an EKF leaves: held-out error, sigma²",
            (
                "start",
                "best",
                "quarter",
                "median",
                "three quarters",
                "worst",
                "diversity left",
                "different parents",
            ),
            starts,
        ),
        *(_smoothness(level, one) for level, one in found["smoothness"].items()),
    ]


KEPT = ("diversity", "parents")


def _simulations(found: dict, known: list[dict]) -> list[Line]:
    ours, bp = found["ga-bp-ukf"], found["bp-ekf"]
    mae = {name: one["mae_m"] for name, one in found.items()}
    paper = {name: float(np.mean(of_four)) for name, of_four in PAPER.items()}
    tuned = {name: mae["ga-bp-ukf"] / mae[name] for name in ("ekf, tuned", "classic ukf, tuned")}
    ratios = ", ".join(f"{one['ratio']:.2f} at {one['start_m']:.0f} m" for one in known)
    return [
        Line(
            1,
            "simulation 1: mean absolute error to that of BP-EKF",
            f"{paper['ga-bp-ukf']:.2f} m to {paper['bp-ekf']:.2f} m: {paper['ga-bp-ukf'] / paper['bp-ekf']:.2f}",
            f"{mae['ga-bp-ukf']:.3f} m: {mae['ga-bp-ukf'] / mae['bp-ekf']:.2f}",
            f"BP-EKF {mae['bp-ekf']:.3f} m, EKF {mae['ekf']:.3f} m",
            f"≤ {HALF}",
            mae["ga-bp-ukf"] <= HALF * mae["bp-ekf"],
            f"UKF to EKF without networks, by how well the start is known: {ratios}.",
        ),
        Line(
            1,
            "the same with the network off",
            "",
            f"{mae['ga-bp-ukf, no network']:.3f} m: {mae['ga-bp-ukf, no network'] / mae['ekf']:.2f} of EKF",
            f"with all of the network's output {mae['ga-bp-ukf, full gain']:.3f} m",
            "stated",
            None,
            "The gain is the unscented transform's, not the network's: after a UKF nothing is left that it "
            "could predict, and its gain is set to about nothing.",
        ),
        Line(
            1,
            "the same against tuned filters",
            "",
            f"{tuned['classic ukf, tuned']:.2f} of a classic UKF, {tuned['ekf, tuned']:.2f} of an EKF",
            f"classic UKF {mae['classic ukf, tuned']:.3f} m, EKF {mae['ekf, tuned']:.3f} m",
            "whatever it is",
        ),
        Line(
            2,
            "simulation 2: RMSE with outliers to that without",
            "the others follow the outliers",
            f"{ours['rise']:.2f} ({ours['rmse_outliers_m']:.2f} m)",
            ", ".join(
                f"{name} {found[name]['rise']:.2f} ({found[name]['rmse_outliers_m']:.2f} m)"
                for name in ("bp-ekf", "ekf, tuned", "classic ukf, tuned")
            ),
            f"≤ {RISE}",
            ours["rise"] <= RISE,
            f"BP-EKF has {bp['rmse_m']:.2f} m without outliers already: a small rise of a large error.",
        ),
    ]


def _gradient(level: str, found: dict) -> Line:
    (ours, *_, our_error, _, _), (theirs, *_, their_error, _, _) = (
        found[name]["median"] for name in ("ga-bp-ukf", WAVELET)
    )
    truth, smoothed = found["truth"]["median"][0], found["ga-bp-ukf, smoothed"]["median"]
    met = ours <= HALF * theirs and our_error <= their_error
    note = ""
    if not met and truth > HALF * theirs:
        note = (
            f"The flight itself moves by {truth:.4f} m a step, {truth / theirs:.2f} of the baseline's figure: a "
            "ratio below that is lag. The figure measures noise only where the target hardly moves."
        )
    paper = PAPER_GRADIENT_M["ga-bp-ukf"], PAPER_GRADIENT_M[WAVELET]
    return Line(
        3,
        f"mean gradient of the range, {level}",
        f"{paper[0]:.4f} m to {paper[1]:.4f} m: {paper[0] / paper[1]:.2f}",
        f"{ours:.4f} m: {ours / theirs:.2f}; true error {our_error:.3f} m (smoothed {smoothed[0]:.4f}, {smoothed[3]:.3f} m)",
        f"Kalman + wavelet {theirs:.4f} m; true error {their_error:.3f} m; the truth's own {truth:.4f} m",
        f"≤ {HALF} at no larger error",
        met,
        note,
    )


def _starts(found: dict) -> Line:
    after = {name: one["after"] for name, one in found.items()}
    low, _, middle, _, high = after["improved"]
    others = ", ".join(
        f"{name} {after[name][2]:.2f} ({after[name][0]:.2f} … {after[name][4]:.2f})"
        for name in ("classic", "random")
    )
    kept = {name: (found[name]["diversity"], found[name]["parents"]) for name in ("improved", "classic")}
    return Line(
        4,
        "held-out error after training, sigma²: median (best … worst); diversity left, different parents",
        "improved roulette keeps diversity",
        f"{middle:.2f} ({low:.2f} … {high:.2f}); {kept['improved'][0]:.2f}, {kept['improved'][1]:.1f}",
        f"{others}; classic {kept['classic'][0]:.2f}, {kept['classic'][1]:.1f}; no network {after['no network'][2]:.2f}",
        "stated",
    )


def _network(found: dict) -> list[Line]:
    total = found["total"]
    ratios = ", ".join(
        f"{name} {total[kind]['ratio']:.3f} (worst {total[kind]['worst']:.3f})"
        for kind, name in KINDS.items()
    )
    return [
        Line(
            5,
            "error with the correction to that without, flights and geometries never seen",
            "",
            ratios,
            "off 1.000",
            "none worse than 1.00",
            max(one["worst"] for one in total.values()) < SAME,
            ""
            if found["installed"]
            else "It does not improve the position, so it is not installed: the correction is off by default.",
        ),
        Line(
            6,
            "one inference, µs; the whole training",
            "",
            f"{found['inference_us']:.1f} µs as the filter calls it ({found['compiled_us']:.2f} µs compiled); {found['training_s']:.0f} s",
            "",
            f"≤ {INFERENCE_US:.0f} µs; ≤ {TRAINING_S / 60:.0f} min",
            found["inference_us"] <= INFERENCE_US and found["training_s"] <= TRAINING_S,
        ),
    ]


def _smoothness(level: str, found: dict) -> Grid:
    columns = (
        "method",
        "gradient range m",
        "azimuth °",
        "elevation °",
        "error range m",
        "azimuth °",
        "elevation °",
        "lost",
    )
    rows = [
        (name, *(f"{figure:.4f}" for figure in one["median"]), str(one["lost"]))
        for name, one in found.items()
    ]
    return Grid(f"mean gradient and true RMS error, {level} flight, medians", columns, rows)
