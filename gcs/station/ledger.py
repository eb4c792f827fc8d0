"""The ledger: every value that came in, by number, with what was done with it. Nothing is lost here."""

from collections.abc import Mapping

import numpy as np

from gcs.contract.messages import CHANNELS, VERDICTS

PENDING = -1  # no verdict yet
ENTRY = np.dtype(
    [
        ("t_ns", "i8"),  # as the feed gave it
        ("sensor", "i2"),
        ("channel", "i1"),  # index into CHANNELS, −1: the whole line
        ("measurement", "i8"),  # values of one measurement share this number
        ("value", "f8"),  # units of the input
        ("position_m", "f8", (3,)),  # where the measurement says the target was, station ENU; NaN: it cannot
        ("predicted", "f8"),  # units of the input, like sigma
        ("sigma", "f8"),
        ("weight", "f8"),
        ("verdict", "i1"),
        ("reason", "i4"),  # index into Ledger.reasons; negative: a remark on this entry alone
        ("count", "i4"),  # of lines that it stands for; 1 for a value
        ("final", "?"),
        ("screened", "?"),  # doubted by the screening of its own channel
    ]
)
NO_TIME = np.iinfo(np.int64).min  # the t_ns of a line whose time cannot be read
ANGLES = np.array([name in ("azimuth", "elevation") for name in CHANNELS])


class Ledger:
    """Entries [first, first + len) are held; older ones are final and have been taken away by ``retire``."""

    def __init__(self, sensors: list[str], reasons: tuple[str, ...]):
        self.sensors = sensors
        self.reasons = list(reasons)
        self._reason_index = {text: index for index, text in enumerate(reasons)}
        self._remarks: dict[int, str] = {}
        self._remarked = 0
        self.parting: dict[int, str] = {}  # remarks on what was retired last; a new one each time
        self.first = 0
        self.counts = np.zeros((len(sensors), len(CHANNELS) + 1, len(VERDICTS)), dtype=np.int64)
        self.doubted = np.zeros_like(self.counts)
        self._entries = np.empty(1024, dtype=ENTRY)
        self._size = 0
        self._measurements = 0

    @property
    def entries(self) -> np.ndarray:
        """A view of the held entries; entry k has the id ``first + k``."""
        return self._entries[: self._size]

    def add(self, entries: np.ndarray) -> np.ndarray:
        """Enter (n,) ENTRY values (``measurement`` counted from 0 in this batch); returns their ids (n,)."""
        needed = self._size + len(entries)
        if needed > len(self._entries):
            grown = np.empty(max(needed, 2 * len(self._entries)), dtype=ENTRY)
            grown[: self._size] = self.entries
            self._entries = grown
        ids = self.first + np.arange(self._size, needed)
        self._entries[self._size : needed] = entries
        self._entries["measurement"][self._size : needed] += self._measurements
        self._size = needed
        if len(entries):
            self._measurements += int(entries["measurement"].max()) + 1
        return ids

    def reason(self, text: str) -> int:
        """The index of a reason, entered when it is new."""
        index = self._reason_index.setdefault(text, len(self.reasons))
        if index == len(self.reasons):
            self.reasons.append(text)
        return index

    def remark(self, text: str) -> int:
        """The index of a reason for one entry; it is forgotten with the entry."""
        self._remarked -= 1
        self._remarks[self._remarked] = text
        return self._remarked

    def dismiss(self, ids: np.ndarray, verdict: str, reasons: np.ndarray | int) -> np.ndarray:
        """Final verdict on values that never reach the filter; ``reasons`` as indices. Returns ``ids``."""
        at = ids - self.first
        self._entries["verdict"][at] = VERDICTS.index(verdict)
        self._entries["reason"][at] = reasons
        self._entries["weight"][at] = 0.0
        self._entries["final"][at] = True
        return ids

    def doubt(self, ids: np.ndarray) -> None:
        """Note that screening doubts these values (n,) ids; the verdict is not touched."""
        self._entries["screened"][ids - self.first] = True

    def judge(self, verdicts: np.ndarray) -> np.ndarray:
        """Enter the estimator's verdicts, (v,) filters.models.rows.VERDICT; returns the ids (v,)."""
        at = verdicts["id"] - self.first
        scale = np.where(ANGLES[self._entries["channel"][at]], np.degrees(1.0), 1.0)
        for field in ("predicted", "sigma"):
            self._entries[field][at] = verdicts[field] * scale
        for field in ("weight", "verdict", "reason", "final"):
            self._entries[field][at] = verdicts[field]
        return verdicts["id"]

    def abandon(self, but: np.ndarray, reason: int) -> np.ndarray:
        """Nobody judges any more what is held, except the ids ``but``: what has a verdict keeps it for good,
        the rest is invalid for ``reason``. Returns the ids (n,) that are final now.
        """
        ids = self.first + np.flatnonzero(~self.entries["final"])
        ids = np.setdiff1d(ids, but)
        self._entries["final"][ids - self.first] = True
        self.dismiss(ids[self._entries["verdict"][ids - self.first] == PENDING], "invalid", reason)
        return ids

    def at(self, ids: np.ndarray) -> np.ndarray:
        """(n,) ENTRY, a copy."""
        return self._entries[ids - self.first]

    def retire(self) -> np.ndarray:
        """Take away and count the leading entries that are final, (n,) ENTRY in the order of arrival."""
        held = self.entries
        n = len(held) if held["final"].all() else int(np.argmin(held["final"]))
        done = held[:n].copy()
        for index in self.parting:
            self._remarks.pop(index, None)
        if not n:
            self.parting = {}
            return done
        codes = done["reason"][done["reason"] < 0].tolist()
        self.parting = {code: self._remarks[code] for code in codes}
        np.add.at(self.counts, (done["sensor"], done["channel"], done["verdict"]), done["count"])
        np.add.at(self.doubted, (done["sensor"], done["channel"], done["verdict"]), done["screened"])
        self._entries[: self._size - n] = held[n:].copy()
        self._size -= n
        self.first += n
        return done

    def reason_texts(self, entries: np.ndarray, remarks: Mapping[int, str] | None = None) -> list[str]:
        """Why, in words, for each of (n,) ENTRY: how far from the prediction, and who else doubts it.

        ``remarks`` are needed for entries that were retired some turns ago: they are forgotten here.
        """
        remarks = self._remarks if remarks is None else remarks
        with np.errstate(invalid="ignore", divide="ignore"):
            off = entries["value"] - entries["predicted"]
            wrapped = np.where(
                entries["channel"] == CHANNELS.index("azimuth"), (off + 180.0) % 360.0 - 180.0, off
            )
            sigmas = np.where(entries["sigma"] > 0.0, np.abs(wrapped) / entries["sigma"], np.nan)
        return [
            self._text(self.reasons[code] if code >= 0 else remarks[code], far, screened=screened)
            for code, far, screened in zip(
                entries["reason"].tolist(), sigmas.tolist(), entries["screened"].tolist(), strict=True
            )
        ]

    @staticmethod
    def _text(text: str, far: float, *, screened: bool) -> str:
        text = f"{text} ({far:.1f} sigma)" if text and far == far else text
        if not screened:
            return text
        return f"{text}; screening agrees" if text else "screening alone doubts it"

    def count_table(self, *, doubted: bool = False) -> dict[str, dict[str, dict[str, int]]]:
        """How many values by sensor, channel and verdict: all retired, or those that screening doubts."""
        counts = self.doubted if doubted else self.counts
        names = [*CHANNELS, "line"]
        return {
            sensor: {
                names[channel]: {VERDICTS[v]: int(n) for v, n in enumerate(counts[index, channel]) if n}
                for channel in np.flatnonzero(counts[index].any(axis=1)).tolist()
            }
            for index, sensor in enumerate(self.sensors)
        }
