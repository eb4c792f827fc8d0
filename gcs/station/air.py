"""Air data beside the loop: the wind, and the way on by air data plus wind when every position is lost.

    air data, track ──► wind, learnt from the cleaned velocity
                   └──► track without the rows that only coast, with dead-reckoned ones instead

Everything follows from the data's own times, so a flight cut into other pieces gives the same.
"""

from collections import deque

import numpy as np

from filters.models.rows import TRACK
from filters.wind import wind as winds
from gcs.contract.messages import AIR, Event, Wind

LOST_NS = 2_000_000_000  # without position or velocity for so long, accelerations alone carry no farther
FRESH_NS = 1_000_000_000  # a velocity older than this teaches the wind nothing; nor do older air data carry
KEPT_NS = 3_000_000_000  # what is remembered: more than LOST_NS, so that reckoning begins at the last fix
PERIOD_NS = 1_000_000_000  # of the message
RECKONED_QUALITY = 10.0  # at best, of 100
HALF_QUALITY_M = 10.0
VELOCITY_VAR, ACCELERATION_VAR = 1.0, 9.0  # gusts (m/s)², turns (m/s²)²; both beside the wind's own
BARO_SIGMA_M, BARO_DRIFT_MPS = 1.0, 0.05  # of a height carried on by the barometer
NEEDED = ("airspeed_mps", "alt_msl_m", "roll_deg", "pitch_deg", "yaw_deg")


class Air:
    """One aircraft's air data. Says nothing and changes nothing where there are none."""

    def __init__(self):
        self._waiting = self._flown = np.empty(0, AIR)
        self._recent: deque[np.ndarray] = deque()  # (k,) TRACK, in the order of time
        self._estimator: winds.WindEstimator | None = None
        self._reckoning: winds.DeadReckoning | None = None
        self._last = 0, 0.0, np.zeros(2)  # of the reckoning: t ns, height m, position east and north m
        self._wind_ns = self._emitted_ns = self._sampled_ns = 0
        self._history: list[Wind] = []
        self._reckoned = 0

    def enter(self, samples: np.ndarray) -> None:
        """Take (n,) AIR in any order; what is not finite is no air data."""
        good = np.isfinite([samples[name] for name in NEEDED]).all(axis=0)
        waiting = np.concatenate([self._waiting, samples[good]])
        self._waiting = waiting[np.argsort(waiting["t_ns"], kind="stable")]

    def step(self, track: np.ndarray, upto_ns: int) -> tuple[np.ndarray, list[Wind | Event]]:
        """One turn, up to ``upto_ns``, with the estimator's new rows (k,) TRACK.

        Returns the track that goes out, and the messages about wind and dead reckoning.
        """
        due = int(np.searchsorted(self._waiting["t_ns"], upto_ns, side="right"))
        samples, self._waiting = self._waiting[:due], self._waiting[due:]
        if not len(samples) and self._reckoning is None:
            self._keep(track)
            return track, []
        recent = _newest(np.concatenate([np.empty(0, TRACK), *self._recent]))
        known, flown = np.concatenate([recent, track]), np.concatenate([self._flown, samples])
        begin, out = len(recent), []
        messages: list[Wind | Event] = []
        at = np.searchsorted(known["t_ns"], samples["t_ns"], side="right")
        for sample, end in zip(samples, at.tolist(), strict=True):
            if end > begin:
                out.append(self._pass(known[begin:end]))
                begin = end
            if end and sample["t_ns"] > self._sampled_ns:
                out.append(self._take(sample, known[:end], flown, messages))
                self._sampled_ns = int(sample["t_ns"])
        out.append(self._pass(known[begin:]))
        self._flown = _newest(flown)
        self._keep(track)
        return np.concatenate(out), messages

    def report(self) -> dict | None:
        """For the summary; None without air data."""
        if self._estimator is None:
            return None
        known = [wind for wind in self._history if wind.known]
        own = [
            _en(wind.own_speed_mps, wind.own_from_deg)
            for wind in known
            if wind.own_speed_mps is not None and wind.own_from_deg is not None
        ]
        return {
            "median": _median([(wind.e_mps, wind.n_mps) for wind in known]),
            "autopilot_median": _median(own),
            "known_share": len(known) / len(self._history) if self._history else 0.0,
            "airspeed_scale": float(self._estimator.wind.airspeed_scale),
            "states_reckoned": self._reckoned,
        }

    def _keep(self, track: np.ndarray) -> None:
        """Remember (k,) TRACK for as long as it may be asked for."""
        if len(track):
            self._recent.append(track)
        while self._recent and self._recent[0]["t_ns"][-1] <= self._recent[-1]["t_ns"][-1] - KEPT_NS:
            self._recent.popleft()

    def _pass(self, rows: np.ndarray) -> np.ndarray:
        """The estimator's own rows, less those for which there are reckoned ones."""
        if self._reckoning is not None:
            coasting = rows["t_ns"] - rows["fixed_ns"] > LOST_NS
            rows = rows[~coasting | (rows["t_ns"] - self._sampled_ns > FRESH_NS)]
        if len(rows):
            self._emitted_ns = int(rows["t_ns"][-1])
        return rows

    def _take(self, sample, known: np.ndarray, flown: np.ndarray, messages: list) -> np.ndarray:
        """One sample, with the rows (k,) TRACK up to it; returns the reckoned row, or none."""
        state, t_ns = known[-1], int(sample["t_ns"])
        fixed_ns = int(state["fixed_ns"] or state["t_ns"])
        if t_ns - fixed_ns > LOST_NS:
            return self._reckon(sample, known, flown, fixed_ns, messages)
        if self._reckoning is not None:
            self._reckoning = None
            messages.append(Event(t_ns=t_ns, level="info", text="position is back: dead reckoning ends"))
        if t_ns - fixed_ns <= FRESH_NS:
            if self._estimator is None:
                self._estimator = winds.WindEstimator(coordinated=bool(sample["coordinated"]))
            since_s = (t_ns - int(state["t_ns"])) * 1e-9
            velocity = state["x"][3:6] + since_s * state["x"][6:9]
            self._estimator.step(t_ns, *_through_air(sample), velocity)
            if t_ns // PERIOD_NS > self._wind_ns // PERIOD_NS:
                self._wind_ns = t_ns
                self._history.append(_message(self._estimator.wind, sample))
                messages.append(self._history[-1])
        return known[:0]

    def _reckon(self, sample, known, flown, fixed_ns: int, messages: list) -> np.ndarray:
        """Carry on from the last fix. Not from the ground: there the airspeed is noise."""
        t_ns, estimator = int(sample["t_ns"]), self._estimator
        if estimator is None:
            return known[:0]
        if self._reckoning is None:
            if _through_air(sample)[0] < estimator.settings.least_mps:
                return known[:0]
            anchor = known[np.searchsorted(known["t_ns"], fixed_ns) :][0]
            self._reckoning = self._begin(estimator, anchor, flown, t_ns)
            text = "no position or velocity for 2 s: dead reckoning by air data and wind"
            messages.append(Event(t_ns=t_ns, level="warning", text=text))
        before_ns, height_m, position = self._last
        after, covariance = self._reckoning.step(t_ns, *_through_air(sample))
        dt_s = (t_ns - before_ns) * 1e-9
        up_mps = (sample["alt_msl_m"] - height_m) / dt_s
        self._last = t_ns, float(sample["alt_msl_m"]), after
        if t_ns <= self._emitted_ns:
            return known[:0]
        self._emitted_ns, self._reckoned = t_ns, self._reckoned + 1
        velocity = (*((after - position) / dt_s), up_mps)
        return self._row(t_ns, after, covariance, velocity, estimator.wind.covariance)

    def _begin(
        self, estimator: winds.WindEstimator, anchor: np.void, flown: np.ndarray, t_ns: int
    ) -> winds.DeadReckoning:
        """Start at ``anchor``, the last row that had a fix, over the samples since then, up to ``t_ns``."""
        self._anchor = anchor
        position, covariance = anchor["x"][:2], anchor["P"][:2, :2]
        reckoning = estimator.carry(int(anchor["t_ns"]), position, covariance)
        since = flown[(flown["t_ns"] > anchor["t_ns"]) & (flown["t_ns"] < t_ns)]
        height = flown["alt_msl_m"][min(np.searchsorted(flown["t_ns"], anchor["t_ns"]), len(flown) - 1)]
        self._height_m = float(height)
        self._last = int(anchor["t_ns"]), self._height_m, position
        for sample in since:
            position, _ = reckoning.step(int(sample["t_ns"]), *_through_air(sample))
            self._last = int(sample["t_ns"]), float(sample["alt_msl_m"]), position
        return reckoning

    def _row(self, t_ns: int, position, covariance, velocity, wind_covariance) -> np.ndarray:
        """(1,) TRACK: level by air data and wind, height by the barometer since the last fix."""
        anchor, row = self._anchor, np.zeros(1, TRACK)
        gone_s = (t_ns - int(anchor["t_ns"])) * 1e-9
        x, P = row["x"][0], row["P"][0]
        x[:2], x[2] = position, anchor["x"][2] + self._last[1] - self._height_m
        x[3:6] = velocity
        P[:2, :2] = covariance
        P[2, 2] = anchor["P"][2, 2] + BARO_SIGMA_M**2 + (BARO_DRIFT_MPS * gone_s) ** 2
        P[3:5, 3:5] = wind_covariance
        P[range(3, 6), range(3, 6)] += VELOCITY_VAR
        P[range(6, 9), range(6, 9)] = ACCELERATION_VAR
        row["protection_h_m"] = row["protection_v_m"] = np.nan
        row["t_ns"], row["fixed_ns"], row["reset_counter"] = t_ns, anchor["t_ns"], anchor["reset_counter"]
        sigma_m = np.sqrt(np.trace(P[:3, :3]))
        row["quality"] = np.round(RECKONED_QUALITY / (1.0 + sigma_m / HALF_QUALITY_M))
        return row


def _newest(rows: np.ndarray) -> np.ndarray:
    """Those of the last KEPT_NS, of rows in order of time."""
    return rows[rows["t_ns"] > rows["t_ns"][-1] - KEPT_NS] if len(rows) else rows


def _through_air(sample) -> tuple[float, np.ndarray]:
    """True airspeed m/s; roll, pitch, yaw (3,) rad."""
    tas = winds.true_airspeed(sample["airspeed_mps"], sample["alt_msl_m"])
    return float(tas), np.radians([sample[f"{name}_deg"] for name in ("roll", "pitch", "yaw")])


def _message(wind: winds.MeanWind, sample) -> Wind:
    own_e, own_n = float(sample["own_wind_e_mps"]), float(sample["own_wind_n_mps"])
    own = _polar(own_e, own_n) if np.isfinite(own_e + own_n) else (None, None)
    (ee, en), (_, nn) = wind.covariance.tolist()
    return Wind(
        t_ns=wind.t_ns,
        speed_mps=wind.speed_mps,
        from_deg=wind.from_deg,
        e_mps=float(wind.en_mps[0]),
        n_mps=float(wind.en_mps[1]),
        covariance=(ee, en, nn),
        known=wind.observable,
        airspeed_scale=float(wind.airspeed_scale),
        own_speed_mps=own[0],
        own_from_deg=own[1],
    )


def _polar(e: float, n: float) -> tuple[float, float]:
    """(speed, direction it comes from in degrees) of where the air goes."""
    return float(np.hypot(e, n)), float(np.degrees(np.arctan2(-e, -n)) % 360.0)


def _en(speed: float, from_deg: float) -> tuple[float, float]:
    return -speed * np.sin(np.radians(from_deg)), -speed * np.cos(np.radians(from_deg))


def _median(en: list[tuple[float, float]]) -> dict | None:
    """Speed and direction of the median east and north components; None without any."""
    if not en:
        return None
    speed, from_deg = _polar(*np.median(en, axis=0))
    return {"speed_mps": speed, "from_deg": from_deg}
