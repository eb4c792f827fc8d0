"""Two robust filters of the literature, as published, to compare with: no window, no second thought.

wolf   weighted-observation-likelihood filter, inverse multi-quadric weights (Duran-Martin et al. 2024,
       *Outlier-robust Kalman filtering through generalised Bayes*, ICML; arXiv 2405.05646): the noise R of a
       value with innovation v becomes R/w, w = 1/(1 + v²/(c² R)).
imm    two interacting filters, for calm flight and for manoeuvres (Blom & Bar-Shalom 1988; Bar-Shalom, Li,
       Kirubarajan 2001, 11.6.6), with a soft gate: beyond it the noise grows with v² (Huber's weight, as in
       Karlgaard & Schaub 2007), so that no value pulls more than one at the gate does.

Model, start and updates are the estimator's. Rows come in order of time; older ones get the verdict ``late``.
The papers say nothing about loss of lock: here a filter that has believed no position for a while, or has
heard nothing for longer, begins anew, and counts it.
"""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from filters.baselines.interacting import REASONS, Followed, Mixture, follow
from filters.models import motion, theodolite
from filters.models import state as models
from filters.models.motion import CORE
from filters.models.rows import (
    CHANNELS,
    DEWEIGHTED,
    ROW,
    TRACK,
    USED,
    VERDICT,
    Sensor,
    Step,
    joined,
    rehearsal,
)
from filters.models.settings import Settings
from filters.smoother import buffer, passes, proposals, status
from filters.smoother.integrity import report as reports

PSD_FACTORS = {"wolf": (1.0,), "imm": (0.1, 3.0)}  # times the estimator's densities, one filter each
START_NS = 1_000_000_000  # of rows, from which a first state is made


def make(method: str, sensors: Sequence[Sensor], settings: Settings) -> "Baseline":
    """One of PSD_FACTORS; of ``settings`` the motion, the INS errors and the height count."""
    return Baseline(sensors, settings, PSD_FACTORS[method], imq=method == "wolf")


class Stretch(NamedTuple):
    """What was filtered from one start on."""

    x: np.ndarray  # (n,) at the first row
    P: np.ndarray  # (n, n)
    rows: list[buffer.Rows]
    weight: list[np.ndarray]


class Baseline:
    """The interface of `FixedLagSmoother`: step, finish, smooth, report."""

    def __init__(self, sensors: Sequence[Sensor], settings: Settings, factors: Sequence[float], *, imq: bool):
        self.sensors = tuple(sensors)
        self.model = models.build(sensors, settings.ins_bias_sigma_m, settings.ins_bias_tau_s)
        self._height = settings.height_m, settings.height_sigma_m
        psd = np.repeat([settings.jerk_psd, settings.gust_psd], 2)
        usual = np.ones(len(self.model.prior) - CORE)
        self._psd = motion.densities(psd, usual)
        self._psds = np.stack([motion.densities(factor * psd, usual) for factor in factors])
        self._imq = imq
        self._waiting = np.zeros(0, ROW)
        self._mixture: Mixture | None = None
        self._newest_ns = self._now_ns = np.iinfo(np.int64).min
        self._stretches: list[Stretch] = []
        self._resets: list[dict] = []
        self._tally = np.zeros((len(sensors), len(CHANNELS), 3))

    def warm_up(self) -> None:
        """Compile everything, or fetch it from the cache, before the first measurement."""
        twin = copy.deepcopy(self)
        twin.step(rehearsal(self.sensors))
        twin.finish()
        twin.smooth()

    def step(self, rows: np.ndarray) -> Step:
        """Take in ``rows`` (n,) ROW in order of time."""
        late = rows["t_ns"] < self._newest_ns
        tracks, verdicts = [], [_refused(rows[late], status.TOO_OLD)]
        rows = rows[~late]
        self._newest_ns = max(self._newest_ns, rows["t_ns"].max(initial=self._newest_ns))
        while True:
            if self._mixture is None:
                self._waiting = np.concatenate([self._waiting, rows])
                verdicts.append(self._begin())
                if self._mixture is None:
                    break
                rows, self._waiting = self._waiting, self._waiting[:0]
            if not len(rows):
                break
            count, track, judged = self._follow(rows)
            tracks.append(track)
            verdicts.append(judged)
            rows = rows[count:]
        return Step(joined(tracks, TRACK), np.zeros(0, TRACK), joined(verdicts, VERDICT))

    def finish(self) -> Step:
        """Nothing is left to decide; what still waits for a start has none."""
        waiting, self._waiting = self._waiting, self._waiting[:0]
        return Step(np.zeros(0, TRACK), np.zeros(0, TRACK), _refused(waiting, status.NO_STATE))

    def smooth(self) -> np.ndarray:
        """Forward and backward over each stretch with the weights given at first sight, (k,) TRACK."""
        parts, n = [], len(self.model.prior)
        for number, stretch in enumerate(self._stretches):
            if not stretch.rows:
                continue
            rows = buffer.Rows(*(np.concatenate(column) for column in zip(*stretch.rows, strict=True)))
            end, x, P = len(rows.t), stretch.x.copy(), stretch.P.copy()
            own = buffer.outcome(end)
            own.weight[:], own.noise[:] = np.concatenate(stretch.weight), rows.stated
            out, work, unused = (
                passes.trace(end, n, end),
                models.scratch(n),
                passes.scores(n),
            )
            densities, r, N = self._psd[None], np.zeros(n), np.zeros((n, n))
            passes.forward(self.model, rows, own, densities, x, P, rows.t[0], end, out, work)
            passes.backward(self.model, rows, own, densities, end, out, r, N, unused, work)
            first = buffer.epochs(rows.t)
            parts.append(publish(rows.t[first], out.x[first], out.P[first], number))
        return joined(parts, TRACK)

    def report(self) -> dict:
        """As `FixedLagSmoother.report`."""
        x, P = (self._mixture.x[0], self._mixture.P[0]) if self._mixture else (np.zeros(0), np.zeros((0, 0)))
        return reports.report(self.sensors, self.model, x, P, self._tally, self._resets)

    def _begin(self) -> np.ndarray:
        """Start from the first START_NS that have a fix; verdicts on older rows, which get no state."""
        refused = []
        while len(self._waiting) and np.ptp(self._waiting["t_ns"]) >= START_NS:
            t = self._waiting["t_ns"]
            first = t <= t[0] + START_NS
            found = proposals.candidates(
                self.model, columns(self.model, self._waiting[first], self._height[0]), *self._height
            )
            if not found:
                refused.append(_refused(self._waiting[first], status.NO_STATE))
                self._waiting = self._waiting[~first]
                continue
            self._lock_on(*_middle(found), int(t[0]))
            break
        return joined(refused, VERDICT)

    def _lock_on(self, x: np.ndarray, P: np.ndarray, t_ns: int) -> None:
        """Begin at ``t_ns`` from ``x`` (n,), ``P`` (n, n)."""
        m = len(self._psds)
        self._stretches.append(Stretch(x, P, [], []))
        many = (np.repeat(part[None], m, axis=0) for part in (x, P))
        self._mixture = Mixture(*many, np.full(m, 1.0 / m), np.array([t_ns, 0]))
        self._now_ns = t_ns

    def _follow(self, new: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Filter ``new`` (k,) ROW until the lock is lost: (rows taken, their TRACK, their VERDICT)."""
        rows, n, k = columns(self.model, new, self._height[0]), len(self.model.prior), len(new)
        judged = Followed(*np.zeros((4, k)), np.zeros((k, n)), np.zeros((k, n, n)))
        count, epochs, lost = follow(
            self.model, rows, self._now_ns, self._psds, self._imq, self._mixture, judged,
            passes.trace(1, n, 1), models.scratch(n),
        )  # fmt: skip
        number = len(self._stretches) - 1
        if lost:
            self._resets.append({"t_ns": int(rows.t[count]), "reason": REASONS[lost]})
            self._mixture = None
        done = buffer.Rows(*(column[:count] for column in rows))
        weight = judged.weight[:count]
        verdicts = np.zeros(count, VERDICT)
        if count:
            self._now_ns = int(done.t[-1])
            self._stretches[-1].rows.append(done)
            self._stretches[-1].weight.append(weight)
            where, used = (done.sensor, done.channel), weight >= 0.5
            np.add.at(self._tally[..., 0], where, used)
            np.add.at(self._tally[..., 1], where, np.where(used, judged.nis[:count], 0.0))
            np.add.at(self._tally[..., 2], where, ~used)
            verdicts["id"], verdicts["final"] = new["id"][:count], True
            verdicts["weight"], verdicts["sigma"] = weight, judged.sigma[:count]
            verdicts["predicted"] = done.value - judged.residual[:count]
            verdicts["verdict"] = np.where(used, USED, DEWEIGHTED)
            verdicts["reason"] = np.where(used, status.NONE, status.INNOVATION)
        last = np.flatnonzero(np.diff(done.t, append=done.t[-1:] + 1))
        return count, publish(done.t[last], judged.x[:epochs], judged.P[:epochs], number), verdicts


def columns(model: models.Model, rows: np.ndarray, height_m: float = np.nan) -> buffer.Rows:
    """(k,) ROW as the passes read them; ``height_m`` of the target, NaN: not known beforehand."""
    t, sensor, channel, value = (
        np.ascontiguousarray(rows[f]) for f in ("t_ns", "sensor", "channel", "value")
    )
    stated = np.where(rows["sigma"] > 0.0, rows["sigma"] ** 2, model.variance[sensor, channel])
    out = buffer.Rows(t, sensor, channel, value, stated, np.full((len(t), 3), np.nan))
    theodolite.places(out, model.offset, model.rotation, model.is_ins, height_m, 0)
    return out


def _middle(found: list) -> tuple[np.ndarray, np.ndarray]:
    """The candidate of `proposals.candidates` that is nearest to all others."""
    place = np.array([x[:3] for _, x, _ in found])
    away = np.linalg.norm(place[:, None] - place, axis=2).sum(axis=1)
    return found[int(np.argmin(away))][1:]


def _refused(rows: np.ndarray, reason: int) -> np.ndarray:
    return buffer.refusals(rows, np.full(len(rows), reason))


def publish(t_ns: np.ndarray, x: np.ndarray, P: np.ndarray, resets: int) -> np.ndarray:
    """(k,) TRACK of states ``x`` (k, ≥9), ``P`` (k, ≥9, ≥9) after so many ``resets``."""
    track = np.zeros(len(t_ns), TRACK)
    track["t_ns"], track["x"], track["P"], track["quality"] = t_ns, x[:, :CORE], P[:, :CORE, :CORE], 100
    track["reset_counter"] = resets
    track["protection_h_m"] = track["protection_v_m"] = np.nan
    return track
