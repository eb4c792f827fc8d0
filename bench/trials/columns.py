"""The table: what its columns are, and how several seeds become two numbers.

rms median p95 worst   position error of the newest state, m          beyond3/5  epochs beyond 3, 5 sigma, %
far_s                  longest time above 5 m, s                      nees       mean of position, 3 is right
..._smooth             the same of the best estimate                  nees_off   outside its 95 % band by
over_told              RMS over that of the same estimator without the labelled rows, newest and smoothed
sure5                  beyond 5 sigma and not ambiguous, %            refused    of all values, %
found                  outliers above 6 sigma refused, %              false      good values refused in 10,000
ins_refused            INS values refused, %                          resets     begun again
over_ekf               RMS over that of a nine-state EKF on the ground instruments told the labels
cv                     RMS of a constant-velocity EKF with a 3-sigma gate, m
misleading             epochs beyond the protection level and not ambiguous, %
level_h level_v        median protection level over the 95th percentile of the error
ambiguous              epochs, %       start_s  first state after the first row       cpu_s  of one run
"""

import numpy as np

PERCENT = {
    "beyond3", "beyond5", "beyond3_smooth", "beyond5_smooth", "found", "ins_refused", "misleading", "refused",
    "ambiguous", "known", "sure5",
}  # fmt: skip
BEST_HIGH = {"found", "known"}
SHORT = (
    "rms", "median", "p95", "worst", "far_s", "beyond3", "beyond5", "nees", "nees_off", "rms_smooth",
    "worst_smooth", "beyond3_smooth", "nees_smooth", "over_told", "over_told_smooth", "over_ekf", "cv",
    "resets", "found", "false", "ins_refused", "misleading", "level_h", "level_v", "ambiguous", "start_s",
    "cpu_s",
)  # fmt: skip
TITLES = {
    "beyond3": ">3s%", "beyond5": ">5s%", "rms_smooth": "rmsS", "worst_smooth": "worstS", "median": "med",
    "beyond3_smooth": ">3sS%", "nees_smooth": "neesS", "over_told": "/told", "over_told_smooth": "/toldS",
    "over_ekf": "/ekf", "ins_refused": "ins-%", "found": "found%", "misleading": "mislead%",
    "level_h": "plH", "level_v": "plV", "ambiguous": "amb%", "nees_off": "off", "resets": "rst",
    "known": "known%", "sure5": ">5s sure%",
}  # fmt: skip


def table(results: dict[str, list[dict]], wanted=SHORT) -> str:
    """Per name of ``results`` two lines, median and worst over its figures; then one over all."""
    everything = [one for many in results.values() for one in many]
    columns = [name for name in wanted if any(name in one for one in everything)]
    lines = [[" "] + [TITLES.get(name, name) for name in columns]]
    medians = []
    for name, many in results.items():
        middle = {c: _over(np.median, many, c) for c in columns}
        medians.append(middle)
        lines.append([name] + [_text(c, middle[c]) for c in columns])
        if len(many) > 1:
            lines.append(["  worst of " + str(len(many))] + [_text(c, _worst(many, c)) for c in columns])
    if len(results) > 1:
        lines.append(["ALL, median"] + [_text(c, _over(np.median, medians, c)) for c in columns])
        lines.append(["ALL, worst"] + [_text(c, _worst(everything, c)) for c in columns])
    width = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return "\n".join(
        "  ".join([line[0].ljust(width[0]), *(x.rjust(w) for x, w in zip(line[1:], width[1:], strict=True))])
        for line in lines
    )


def _values(many, column) -> list[float]:
    return [one[column] for one in many if column in one and not np.isnan(one[column])]


def _over(what, many, column) -> float:
    values = _values(many, column)
    return float(what(values)) if values else np.nan


def _worst(many, column) -> float:
    return _over(np.min if column in BEST_HIGH else np.max, many, column)


def _text(column: str, x: float) -> str:
    if np.isnan(x):
        return "-"
    x = 100.0 * x if column in PERCENT else x
    if column == "resets":
        return f"{x:.0f}"
    return f"{x:.3f}" if abs(x) < 1 else f"{x:.2f}" if abs(x) < 100 else f"{x:.3g}"
