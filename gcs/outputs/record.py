"""The run folder: the tables of a flight as it goes on, its summary and the resolved station file."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from math import isfinite
from pathlib import Path

import numpy as np

from gcs.contract.config import Station, dump
from gcs.contract.frames import Frame
from gcs.contract.messages import CHANNELS, VERDICTS
from gcs.outputs.disk import RunFile, Tell, replace, to_operator
from gcs.station.ledger import NO_TIME, Ledger
from gcs.station.session import Update

TRACK_HEADER = (
    "t_ns,lat_deg,lon_deg,alt_m,e_m,n_m,u_m,ve_mps,vn_mps,vu_mps,ae_mps2,an_mps2,au_mps2,"
    "sigma_e_m,sigma_n_m,sigma_u_m,sigma_ve_mps,sigma_vn_mps,sigma_vu_mps,quality,reset_counter,"
    "protection_h_m,protection_v_m,ambiguous\n"
)
TRACK_LINE = "%d,%.9f,%.9f,%.4f" + ",%.4f" * 15 + ",%d,%d,%s,%s,%d\n"  # 0.1 mm; 1e-9 degrees is 0.1 mm
SEPARATION_HEADER = "t_ns,sensor,horizontal_m,vertical_m,sigma_h_m,sigma_v_m\n"
PIECE = 10_000  # rows made into text at a time
VERDICT_HEADER = "t_ns,sensor,channel,value,predicted,sigma,weight,verdict,reason\n"


class Record:
    """A sink that writes as it goes: killed in the middle, the folder holds all that was final.

    Whatever the disk does, nothing is raised: ``tell`` is given what an operator should know, and the summary
    says under ``not_written`` how many rows of which file are missing. ``goes_on`` is called now and then
    while the best estimate is written: that of a day takes a minute.
    """

    def __init__(
        self,
        folder: Path,
        station: Station,
        frame: Frame,
        tell: Tell = to_operator,
        goes_on: Callable[[], None] = lambda: None,
    ):
        self._folder, self._frame, self._tell, self._station = folder, frame, tell, dump(station)
        self._goes_on = goes_on
        self.missing = Counter[str]()  # rows by file, known at the end; of files of other sinks too
        (folder / "summary.json").unlink(missing_ok=True)  # no summary: the run did not end
        self._replace("station.toml", [self._station])
        self._track = self._open("track.csv", TRACK_HEADER)
        self._smoothed = self._open("smoothed.csv", TRACK_HEADER)
        self._verdicts = self._open("verdicts.csv", VERDICT_HEADER)
        self._separation = self._open("separation.csv", SEPARATION_HEADER)

    def take(self, update: Update) -> None:
        for file, track in ((self._track, update.track), (self._smoothed, update.smoothed)):
            if len(track):
                file.write(track_lines(track, self._frame).encode(), len(track))
            else:
                file.flush()
        if len(update.retired):
            lines = verdict_lines(update.retired, update.ledger, update.remarks)
            self._verdicts.write(lines.encode(), len(update.retired))
        else:
            self._verdicts.flush()
        if len(update.separation):
            text = separation_lines(update.separation, update.ledger)
            self._separation.write(text.encode(), len(update.separation))
        else:
            self._separation.flush()

    def close(self, summary: dict, best: np.ndarray) -> None:
        """The best estimate takes the place of the window's view, and the summary says what is missing."""
        if not (self._folder / "station.toml").exists():  # somebody has taken the folder away
            self._replace("station.toml", [self._station])
        files = self._track, self._smoothed, self._verdicts, self._separation
        for file in files:
            file.close()
        missing = self.missing
        missing.update({file.path.name: file.lost for file in files if file.lost})
        missing.update(summary.get("not_written", {}))
        if self._replace("smoothed.csv", chain([TRACK_HEADER], self._best_lines(best))):
            missing["smoothed.csv"] = len(best)
        else:
            missing.pop("smoothed.csv", None)
        text = json.dumps(summary | {"not_written": missing}, indent=2, sort_keys=True, allow_nan=False)
        self._replace("summary.json", [text, "\n"])
        if missing:
            lost = ", ".join(f"{name} {rows}" for name, rows in sorted(missing.items()))
            self._tell("error", f"{self._folder}: the disk did not take all; missing rows: {lost}")

    def _best_lines(self, best: np.ndarray) -> Iterator[str]:
        for k in range(0, len(best), PIECE):
            self._goes_on()
            yield track_lines(best[k : k + PIECE], self._frame)

    def _open(self, name: str, header: str) -> RunFile:
        file = RunFile(self._folder / name, self._tell)
        file.write(header.encode())
        return file

    def _replace(self, name: str, parts: Iterable[str]) -> str:
        why = replace(self._folder / name, parts)
        if why:
            self._tell("error", f"{self._folder / name}: {why}; it is not written")
        return why


def track_lines(track: np.ndarray, frame: Frame) -> str:
    """(n,) TRACK as lines of track.csv."""
    lat, lon, alt = frame.to_geodetic(track["x"][:, :3])
    sigma = np.sqrt(np.diagonal(track["P"], axis1=1, axis2=2)[:, :6])
    numbers = np.column_stack([lat, lon, alt, track["x"], sigma]).tolist()
    ends = (track[f].tolist() for f in ("quality", "reset_counter"))
    levels = ([_level(m) for m in track[f].tolist()] for f in ("protection_h_m", "protection_v_m"))
    lines = zip(track["t_ns"].tolist(), numbers, *ends, *levels, track["ambiguous"].tolist(), strict=True)
    return "".join(TRACK_LINE % (t_ns, *row, *rest) for t_ns, row, *rest in lines)


def verdict_lines(entries: np.ndarray, ledger: Ledger, remarks: Mapping[int, str] | None = None) -> str:
    """(n,) ENTRY as lines of verdicts.csv; what has no number is left empty. ``remarks``: of an Update."""
    channels = [*CHANNELS, ""]  # channel −1: the whole line
    reasons = ledger.reason_texts(entries, remarks)
    columns = (entries[f].tolist() for f in ("t_ns", "sensor", "channel", "verdict", "weight"))
    numbers = zip(*(entries[f].tolist() for f in ("value", "predicted", "sigma")), strict=True)
    return "".join(
        f"{'' if t_ns == NO_TIME else t_ns},{ledger.sensors[sensor]},{channels[channel]},"
        f"{_number(value)},{_number(predicted)},{_number(sigma)},{weight:.4g},{VERDICTS[verdict]},{quoted(reason)}\n"
        for (t_ns, sensor, channel, verdict, weight), (value, predicted, sigma), reason in zip(
            zip(*columns, strict=True), numbers, reasons, strict=True
        )
    )


def separation_lines(separation: np.ndarray, ledger: Ledger) -> str:
    """(n,) SEPARATION as lines of separation.csv."""
    return "".join(
        f"{t_ns},{ledger.sensors[sensor]}," + ",".join(f"{metres:.4f}" for metres in rest) + "\n"
        for t_ns, sensor, *rest in separation.tolist()
    )


def _number(value: float) -> str:
    return f"{value:.10g}" if value == value else ""


def _level(metres: float) -> str:
    """A protection level; empty where there is none."""
    return f"{metres:.3f}" if isfinite(metres) else ""


def quoted(text: str) -> str:
    """A text as a field of a CSV file."""
    return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text


def stamp(t_ns: int) -> str:
    """A folder name for the run that began at ``t_ns``."""
    return np.datetime_as_string(np.datetime64(t_ns, "ns"), unit="s").replace(":", "")
