"""How often a sensor speaks, and its gaps, in memory that does not grow with the flight."""

from collections import Counter

import numpy as np

GAP, GAP_S = 5.0, 0.5  # a pause of so many usual intervals, and of at least so long, is a gap
GRAIN_NS = 100_000  # intervals are told apart by this: a clock's jitter then makes some hundred of them


class Pace:
    """The intervals between the measurements of one sensor, counted by length."""

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self._steps: Counter[int] = Counter()  # length in grains → how many
        self._longest_ns = 0

    def take(self, t_ns: np.ndarray) -> None:
        """Note valid times (n,) int64, the next ones; what is older than those before is left out."""
        for t in sorted(t_ns.tolist()):
            step_ns = 0 if self._newest_ns is None else t - self._newest_ns
            if step_ns > 0:
                self._longest_ns = max(self._longest_ns, step_ns)
                self._steps[(step_ns + GRAIN_NS // 2) // GRAIN_NS] += 1
            if step_ns > 0 or self._newest_ns is None:
                self._newest_ns = t

    def report(self) -> dict:
        """For the summary: usual rate, gaps, the longest of all intervals."""
        if not self._steps:
            return {"rate_hz": 0.0, "gaps": 0, "longest_gap_s": 0.0}
        lengths, counts = np.array(sorted(self._steps.items())).T
        steps_s = np.maximum(lengths, 1) * GRAIN_NS / 1e9
        usual_s = float(steps_s[np.searchsorted(np.cumsum(counts), 0.5 * counts.sum())])
        gaps = int(counts[steps_s > max(GAP * usual_s, GAP_S)].sum())
        return {"rate_hz": 1.0 / usual_s, "gaps": gaps, "longest_gap_s": self._longest_ns / 1e9}
