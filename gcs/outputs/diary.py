"""What was told while it ran, beside the record of the values: events.csv, wind.csv, errors.csv."""

import math
from collections.abc import Iterator
from pathlib import Path

from gcs.contract.messages import Event, Wind
from gcs.outputs.record import quoted
from gcs.station.health import Monitor
from gcs.station.session import Update

PERIOD_NS = 1_000_000_000  # between two rows of the same systematic error
EVENTS = "t_ns,level,text\n"
WIND = "t_ns,speed_mps,from_deg,sigma_mps,known,own_speed_mps,own_from_deg\n"
ERRORS = "t_ns,sensor,error,value,sigma,prior_sigma\n"


class Diary:
    """A sink, killed in the middle like the record: what was told is there."""

    def __init__(self, folder: Path, monitor: Monitor):
        self._monitor = monitor
        self._next_ns = 0
        self._events, self._wind, self._errors = (
            _begin(folder / name, header)
            for name, header in (("events.csv", EVENTS), ("wind.csv", WIND), ("errors.csv", ERRORS))
        )

    def take(self, update: Update) -> None:
        for message in (*update.told, *self._monitor.take(update)):
            if isinstance(message, Event):
                self._events.write(f"{message.t_ns},{message.level},{quoted(message.text)}\n")
            elif isinstance(message, Wind):
                self._wind.write(_wind_line(message))
        if len(update.track) and (now_ns := int(update.track["t_ns"][-1])) >= self._next_ns:
            self._next_ns = now_ns + PERIOD_NS
            self._errors.writelines(error_lines(now_ns, update.report()))
        for file in (self._events, self._wind, self._errors):
            file.flush()

    def close(self, summary: dict, best: object) -> None:
        for file in (self._events, self._wind, self._errors):
            file.close()


def error_lines(t_ns: int, report: dict) -> Iterator[str]:
    """Lines of errors.csv, angles in degrees, of an estimator's report."""
    for sensor, told in report.get("sensors", {}).items():
        for name, error in told["errors"].items():
            scale = math.degrees(1.0) if error["unit"] == "rad" else 1.0
            numbers = (scale * error[field] for field in ("value", "sigma", "prior_sigma"))
            yield f"{t_ns},{sensor},{name}," + ",".join(f"{number:.6g}" for number in numbers) + "\n"


def _wind_line(wind: Wind) -> str:
    ee, en, nn = wind.covariance
    worst = math.sqrt(0.5 * (ee + nn) + math.hypot(0.5 * (ee - nn), en))  # in the direction known least
    own = ("" if x is None else f"{x:.3f}" for x in (wind.own_speed_mps, wind.own_from_deg))
    return (
        f"{wind.t_ns},{wind.speed_mps:.3f},{wind.from_deg:.2f},{worst:.3f},{wind.known:d},{','.join(own)}\n"
    )


def _begin(path: Path, header: str):
    file = path.open("w", encoding="utf-8", newline="\n")
    file.write(header)
    return file
