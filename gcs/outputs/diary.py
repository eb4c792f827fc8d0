"""What was told while it ran, beside the record of the values: events.csv, wind.csv, errors.csv."""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from gcs.contract.messages import Event, Wind
from gcs.outputs.disk import RunFile, Tell, to_operator
from gcs.outputs.record import quoted
from gcs.station.health import Monitor
from gcs.station.session import Update

PERIOD_NS = 1_000_000_000  # between two rows of the same systematic error
FILES = {
    "events.csv": "t_ns,level,text\n",
    "wind.csv": "t_ns,speed_mps,from_deg,sigma_mps,known,own_speed_mps,own_from_deg\n",
    "errors.csv": "t_ns,sensor,error,value,sigma,prior_sigma\n",
}
Put = Callable[[Callable[[], object], int, dict[str, int]], object]  # as RunRecorder.put


def at_once(work: Callable[[], object], _size: int, _rows: dict[str, int]) -> None:
    work()


class Diary:
    """A sink, killed in the middle like the record: what was told is there.

    Whatever the disk does, nothing is raised, and ``tell`` is given what an operator should know. Rows that
    are lost are counted in ``missing``, the record's: the diary is closed before it. ``put`` has the writing
    done; in a live run beside the fusion.
    """

    def __init__(
        self,
        folder: Path,
        monitor: Monitor,
        missing: Counter[str],
        tell: Tell = to_operator,
        put: Put = at_once,
    ):
        self._monitor, self._missing, self._put = monitor, missing, put
        self._next_ns = 0
        self._files = [RunFile(folder / name, tell) for name in FILES]
        self._write([[header] for header in FILES.values()])

    def take(self, update: Update) -> None:
        messages = (*update.told, *self._monitor.take(update))
        events = [f"{m.t_ns},{m.level},{quoted(m.text)}\n" for m in messages if isinstance(m, Event)]
        wind, errors = [_wind_line(m) for m in messages if isinstance(m, Wind)], list[str]()
        if len(update.track) and (now_ns := int(update.track["t_ns"][-1])) >= self._next_ns:
            self._next_ns = now_ns + PERIOD_NS
            errors = list(error_lines(now_ns, update.report()))
        lines = [events, wind, errors]
        rows = {name: len(some) for name, some in zip(FILES, lines, strict=True) if some}
        if rows:
            self._put(partial(self._write, lines), sum(rows.values()), rows)

    def close(self, summary: dict, best: object) -> None:
        self._put(self._close, 1, {})

    def _write(self, lines: list[list[str]]) -> None:
        for file, some in zip(self._files, lines, strict=True):
            if some:
                file.write("".join(some).encode(), len(some))
            else:
                file.flush()

    def _close(self) -> None:
        for file in self._files:
            file.close()
            if file.lost:
                self._missing[file.path.name] += file.lost


def error_lines(t_ns: int, report: dict) -> Iterator[str]:
    """Lines of errors.csv, angles in degrees, of an estimator's report."""
    for sensor, own in report.get("sensors", {}).items():
        for name, error in own["errors"].items():
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
