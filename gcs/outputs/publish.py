"""Updates as messages, for the bus and the view."""

from collections.abc import Callable, Iterator, Sequence
from math import isfinite

import msgspec
import numpy as np

from gcs.contract.frames import Frame
from gcs.contract.messages import ANY, CHANNELS, VERDICTS, Event, State, Verdict
from gcs.station.health import Monitor
from gcs.station.ledger import NO_TIME, Ledger
from gcs.station.session import Update

LOWER = np.tril_indices(9)
SEVERITY = np.array([1, 2, 3, 4, 5, 0, 0])  # of VERDICTS: the worst channel speaks for the measurement
FAILED = -1  # quality of the last state, sent again when no newer one can be told; as MAVLink's ODOMETRY
Target = Callable[[str, ANY, str], None]  # (subject, message, source)


class Publisher:
    """A sink: updates become ``state``, ``smoothed``, ``verdict``, ``wind``, ``health`` and ``event``."""

    def __init__(self, frame: Frame, monitor: Monitor, targets: Sequence[Target]):
        self._frame, self._monitor, self._targets = frame, monitor, targets
        self._seq = {"state": 0, "smoothed": 0}
        self._last: State | None = None
        self._smoothed_ns = 0

    def take(self, update: Update) -> None:
        self._monitor.see(update)  # it knows how old each sensor's newest measurement is
        for subject, track in (("state", update.track), ("smoothed", update.smoothed)):
            self._send_states(subject, track)
        for source, verdict in verdicts(update.judged, update.ledger):
            self._send("verdict", verdict, source)
        if update.failed and self._last:
            failed = msgspec.structs.replace(self._last, seq=self._seq["state"], quality=FAILED)
            self._seq["state"] += 1
            self._send("state", failed)
        for message in (*update.told, *self._monitor.take(update)):
            self._send(type(message).__name__.lower(), message)

    def close(self, summary: dict, best: np.ndarray) -> None:
        self._send_states("smoothed", best[best["t_ns"] > self._smoothed_ns])  # to the end of the flight
        self._send("event", Event(t_ns=self._monitor.now_ns, level="info", text="end of data"))

    def _send_states(self, subject: str, track: np.ndarray) -> None:
        if not len(track):
            return
        for state in states(track, self._frame, self._seq[subject], self._monitor.ages_s):
            self._send(subject, state)
            self._last = state if subject == "state" else self._last
        self._seq[subject] += len(track)
        if subject == "smoothed":
            self._smoothed_ns = int(track["t_ns"][-1])

    def _send(self, subject: str, message: ANY, source: str = "") -> None:
        for target in self._targets:
            target(subject, message, source)


def states(
    track: np.ndarray, frame: Frame, first_seq: int, ages_s: Callable[[int], dict[str, float]]
) -> Iterator[State]:
    """(n,) TRACK as messages, numbered from ``first_seq``."""
    lat, lon, alt = (column.tolist() for column in frame.to_geodetic(track["x"][:, :3]))
    covariance = track["P"][:, *LOWER].tolist()
    for k, (row, x) in enumerate(zip(track, track["x"].tolist(), strict=True)):
        t_ns = int(row["t_ns"])
        yield State(
            t_ns=t_ns,
            seq=first_seq + k,
            lat_deg=lat[k],
            lon_deg=lon[k],
            alt_m=alt[k],
            position_enu_m=tuple(x[:3]),
            velocity_enu_mps=tuple(x[3:6]),
            acceleration_enu_mps2=tuple(x[6:]),
            covariance=covariance[k],
            quality=int(row["quality"]),
            reset_counter=int(row["reset_counter"]),
            age_s=ages_s(t_ns),
            protection_h_m=_or_none(float(row["protection_h_m"])),
            protection_v_m=_or_none(float(row["protection_v_m"])),
            ambiguous=bool(row["ambiguous"]),
        )


def verdicts(judged: np.ndarray, ledger: Ledger) -> Iterator[tuple[str, Verdict]]:
    """(sensor, message) of each of (n,) ENTRY. The worst channel of a measurement carries its position."""
    claims = _spokesmen(judged)
    fields = ("t_ns", "sensor", "channel", "value", "predicted", "sigma", "weight", "verdict", "final")
    reasons = ledger.reason_texts(judged)
    rows = zip(*(judged[name].tolist() for name in fields), strict=True)
    for k, (t_ns, sensor, channel, value, predicted, sigma, weight, verdict, final) in enumerate(rows):
        yield (
            ledger.sensors[sensor],
            Verdict(
                t_ns=0 if t_ns == NO_TIME else t_ns,
                sensor=ledger.sensors[sensor],
                channel=CHANNELS[channel] if channel >= 0 else "",
                value=_or_none(value),
                predicted=_or_none(predicted),
                sigma=_or_none(sigma),
                weight=weight,
                verdict=VERDICTS[verdict],
                reason=reasons[k],
                position_enu_m=claims.get(k),
                final=final,
            ),
        )


def _spokesmen(judged: np.ndarray) -> dict[int, tuple[float, float, float]]:
    """Index of the worst entry of each measurement → the position the measurement claims."""
    order = np.lexsort((SEVERITY[judged["verdict"]], judged["measurement"]))
    ends = np.flatnonzero(np.diff(judged["measurement"][order], append=-1))
    worst = order[ends]
    worst = worst[np.isfinite(judged["position_m"][worst]).all(axis=1)]
    return dict(zip(worst.tolist(), map(tuple, judged["position_m"][worst].tolist()), strict=True))


def _or_none(value: float) -> float | None:
    return value if isfinite(value) else None
