"""Damaged logs, read and replayed to the end: nothing raised, no good frame lost, no number that is none.

``case(log, seed)`` makes one damaged log out of a real one, ``problems(...)`` says what is wrong with what
the station makes of it.
"""

import csv
import json
import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import msgspec
import numpy as np

from bridges.tlog import scan
from gcs.commands.replay import command
from gcs.contract import config
from gcs.contract.messages import VERDICTS, InputError
from gcs.station.session import Session
from gcs.station.sources import replay
from tests.fuzz import mutate
from tests.fuzz.mutate import Bytes

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "../shared/data"
SAMPLE = ROOT / "logs/sample"
REAL = {  # name → system id
    "codelever_16-58-51": 1,
    "codelever_18-50-10": 1,
    "copter_fast_wind8": 1,
    "plane_aero": 5,
    "plane_gpsloss": 7,
    "plane_wind8": 2,
}
TEXTS = {"sensor", "channel", "verdict", "reason"}  # columns of verdicts.csv that hold no number
MAY_BE_EMPTY = {"t_ns", "value", "predicted", "sigma", "protection_h_m", "protection_v_m"}


class FuzzedLog(NamedTuple):
    """A real log: its bytes and its good frames."""

    name: str
    system_id: int
    data: np.ndarray  # (bytes,) uint8
    begins: np.ndarray  # (k,) int64, of the frames
    lengths: np.ndarray  # (k,) int64
    msgid: np.ndarray  # (k,)


class DamagedLog(NamedTuple):
    """One damaged log."""

    log: FuzzedLog
    seed: int
    damaged: Bytes


def path_of(name: str) -> Path:
    return SAMPLE / "flight.tlog" if name == "sample" else DATA / f"{name}.tlog"


def opened(name: str) -> FuzzedLog:
    """The undamaged log; the existing tests hold its frames against pymavlink's own reading."""
    data = np.fromfile(path_of(name), np.uint8)
    frames = scan.scan(data)
    frames = frames[frames["kind"] == scan.GOOD]
    lengths = scan.sizes(data, frames)
    system_id = REAL.get(name) or config.load(SAMPLE / "station.toml").vehicle.system_id or 1
    return FuzzedLog(name, system_id, data, frames["offset"], lengths, frames["msgid"])


def case(log: FuzzedLog, seed: int, longest: int) -> DamagedLog:
    """A piece of the log, at most ``longest`` bytes, with a few or many things wrong with it."""
    rng = random.Random(f"{log.name} {seed}")
    size = min(log.data.size, int(longest * 2 ** rng.uniform(-3.0, 0.0)))
    first = log.begins[rng.randrange(max(1, int(np.searchsorted(log.begins, log.data.size - size))))]
    begin = max(0, int(first) - mutate.STAMP)
    inside = (log.begins >= begin) & (log.begins < begin + size)
    near = log._replace(begins=log.begins[inside], lengths=log.lengths[inside], msgid=log.msgid[inside])
    piece = mutate.whole(log.data).part(begin, begin + size)
    times = int(2 ** rng.uniform(0.0, 6.0))
    return DamagedLog(near, seed, mutate.damage(piece, near.begins, rng, times))


def lost_frames(of: DamagedLog) -> list[str]:
    """Frames that nobody touched and that the reader does not have as good ones."""
    data = of.damaged.data
    found = scan.scan(np.ascontiguousarray(data))
    good = set(found["offset"][found["kind"] == scan.GOOD].tolist())
    there = mutate.untouched(of.damaged, of.log.begins, of.log.lengths)
    lost = [f"frame {begin} at {at}" for begin, places in there.items() for at in places if at not in good]
    return [f"lost: {', '.join(lost[:5])}"] if lost else []


def problems(of: DamagedLog, folder: Path, feeds: dict[str, Path] | None = None) -> list[str]:
    """All that is wrong with what `gcs replay` makes of a damaged log: its files, and what is published."""
    folder.mkdir(parents=True, exist_ok=True)
    path, out, sent = folder / "damaged.tlog", folder / "run", []
    path.write_bytes(of.damaged.data.tobytes())
    found = lost_frames(of)
    told = {
        "station": SAMPLE / "station.toml" if feeds else None,
        "config": (f"vehicle.system_id={of.log.system_id}",),
    }
    here = {"on_signal": lambda _: None, "targets": lambda *_: [lambda *put: sent.append(put[1])]}
    try:
        with mock.patch.multiple("gcs.commands.replay", **here):
            command(
                path, feed=tuple(f"{name}={file}" for name, file in (feeds or {}).items()), out=out, **told
            )
    except InputError as error:
        return found + _wrongly_refused(of, str(error))
    station = config.load(told["station"], told["config"])
    flight = replay.load(path, station, feeds or {})
    intake = Session(replay.heard(station, flight.feeds), flight.frame, []).intake
    return found + list(_outputs(out, sent, len(replay.batch(flight, intake).entries)))


def _wrongly_refused(of: DamagedLog, line: str) -> list[str]:
    """A log may be refused where no whole position report of the vehicle with a fix is left in it."""
    if "\n" in line or "damaged.tlog" not in line:
        return [f"refused in other words: {line}"]
    if "before a GPS fix" in line:
        return []
    there = mutate.untouched(of.damaged, of.log.begins, of.log.lengths)
    left = of.log.msgid[np.isin(of.log.begins, list(there))]
    reports = int(np.count_nonzero(left == scan.dialect().ids["GLOBAL_POSITION_INT"]))
    return [f"{reports} position reports are left, yet: {line}"] if reports else []


def _outputs(out: Path, sent: list, expected: int) -> Iterator[str]:
    json.dumps(json.loads((out / "summary.json").read_text(encoding="utf-8")), allow_nan=False)
    for name in ("track.csv", "smoothed.csv", "verdicts.csv"):
        yield from table(out / name)
    with (out / "verdicts.csv").open(encoding="utf-8", newline="") as file:
        verdicts = [row["verdict"] for row in csv.DictReader(file)]
    if len(verdicts) != expected or not set(verdicts) <= set(VERDICTS):
        yield f"{expected} values came in, {len(verdicts)} have a verdict: {sorted(set(verdicts))}"
    for message in sent:
        try:
            json.dumps(msgspec.to_builtins(message), allow_nan=False)
        except ValueError:
            yield f"no number in a message: {message!r:.300}"
            return


def table(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", newline="") as file:
        for number, row in enumerate(csv.DictReader(file), 2):
            for name, text in row.items():
                if name in TEXTS or (text == "" and name in MAY_BE_EMPTY):
                    continue
                if not math.isfinite(float(text)):
                    yield f"{path.name}:{number}: {name} is {text!r}"
                    return
