"""One vehicle's flight as the page knows it: messages in; states, claims and residuals to draw out."""

import math
import time
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs.contract.messages import Event, Health, Scene, State, Verdict, Wind
from web.memory.claims import ACCEPTED, KIND_OF, PATCH, Claim, Claims
from web.memory.other import OtherTrack
from web.memory.residuals import Residuals, sigmas_off
from web.memory.rows import GrowingRows
from web.memory.spoken import Spoken

STEP_NS = 100_000_000  # trajectories are kept ten times a second of flight; finer cannot be seen
BREAK_NS = 5_000_000_000  # a longer gap is not bridged by a straight line
PATCH_GAP_NS = 2_000_000_000  # refused claims farther apart are two patches
NIS_NS = 1_000_000_000  # residuals are averaged over so long
GAP, RESET = "gap", "reset"  # what is marked beside patches: no state for BREAK_NS, the filter began again
MOST_STATES = 72_000  # of 10 Hz: two hours, then the past is thinned
MOST_OUTLIERS = 20_000
MOST_EVENTS = 1_000
MOST_ERRORS = 7_200  # of 1 Hz
TRACK = np.dtype(
    [
        ("t_ns", "i8"),
        ("position_enu_m", "f8", (3,)),
        ("velocity_enu_mps", "f8", (3,)),
        ("acceleration_enu_mps2", "f8", (3,)),
        ("covariance", "f8", (6,)),  # of the position, lower triangle by rows
        ("lat_deg", "f8"),
        ("lon_deg", "f8"),
        ("alt_m", "f8"),
        ("quality", "i2"),
        ("reset_counter", "i4"),
        ("protection_h_m", "f8"),  # NaN: none
        ("protection_v_m", "f8"),
        ("ambiguous", "?"),
        ("nis", "f4"),  # mean squared residual of the accepted values of the last second; NaN: there are none
        ("cut", "?"),  # not joined to the row before
    ]
)
NAMES = [name for name in TRACK.fields or () if name not in ("nis", "cut")]  # as ``State`` has them
ERROR = np.dtype([("t_ns", "i8"), ("value", "f8"), ("sigma", "f8")])


class Fresh(NamedTuple):
    """What came since it was last asked for."""

    newest: list[np.void]  # TRACK rows
    smoothed: list[np.void]
    settled: list[Claim]


class SeenFlight:
    """Takes messages; forgets on ``clear``."""

    def __init__(self, scene: Scene, other: OtherTrack | None = None):
        self.scene, self.other = scene, other
        self.newest = GrowingRows(TRACK, MOST_STATES)
        self.claims, self.residuals = Claims(), Residuals()
        self.healths, self.winds = Spoken(Health), Spoken(Wind)
        self.moments: dict[tuple[int, str], str] = {}  # time and text → level; a seek back forgets none
        self.marks: dict[int, str] = {}  # time → patch, gap or reset; a seek back forgets none
        self.clear()

    @property
    def root(self) -> str:
        """The node of the picture that all of this vehicle hangs under."""
        return f"/world/{self.scene.vehicle}"

    def clear(self) -> None:
        self.state: State | None = None
        self.arrived_s = 0.0  # monotonic, of the state
        self.health: Health | None = None
        self.health_s = 0.0
        self.wind: Wind | None = None
        self.events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self.outliers: deque[Claim] = deque(maxlen=MOST_OUTLIERS)
        self.outliers_before = 0  # how many have left ``outliers``
        self.errors: dict[tuple[str, str], GrowingRows] = {}  # by sensor and name
        self._smoothed: np.void | None = None  # the last one; who draws them keeps their course
        for part in (self.newest, self.claims, self.residuals, self.healths, self.winds):
            part.clear()
        self._squares: deque[tuple[int, float]] = deque()
        self._patched: dict[str, int] = {}  # by sensor: time of its newest patch claim
        self._fresh = Fresh([], [], [])

    def take(self, message: object, source: str) -> None:
        """Note a message; ``source`` is "smoothed" for a smoothed state."""
        match message:
            case State() if source == "smoothed":
                self._take_smoothed(message)
            case State():
                self._take_newest(message)
            case Verdict():
                self.claims.take(message)
                if KIND_OF.get(message.verdict) == 0:
                    self._squares.append((message.t_ns, sigmas_off(message) ** 2))
            case Health():
                self._take_health(message)
            case Wind():
                self.wind = message
                self.winds.add(message.t_ns, message)
            case Event():
                self.events.append(message)
                self._mark(message.t_ns, message.text, message.level)

    def settle(self) -> None:
        """Let claims that no revision can reach become points and outliers."""
        for claim in self.claims.settle():
            self.residuals.add(claim)
            self._fresh.settled.append(claim)
            if claim.kind != ACCEPTED and claim.position:
                self.outliers_before += len(self.outliers) == MOST_OUTLIERS
                self.outliers.append(claim)
            if claim.kind == PATCH:
                before_ns = self._patched.get(claim.sensor, -PATCH_GAP_NS)
                if claim.t_ns - before_ns > PATCH_GAP_NS:
                    self._mark(claim.t_ns, f"{claim.sensor}: a patch of outliers begins", PATCH)
                    self._set_mark(claim.t_ns, PATCH)
                self._patched[claim.sensor] = claim.t_ns

    @property
    def piled(self) -> int:
        """Claims that ``take_fresh`` would give."""
        return len(self._fresh.settled)

    def take_fresh(self) -> Fresh:
        fresh, self._fresh = self._fresh, Fresh([], [], [])
        return fresh

    @property
    def span_ns(self) -> tuple[int, int]:
        """Time of the first and the newest state; 0, 0 before the first."""
        times = self.newest.view["t_ns"]
        return (int(times[0]), int(times[-1])) if len(times) else (0, 0)

    def place_at(self, t_ns: int) -> np.ndarray | None:
        """(3,) where the newest track was at ``t_ns``, station ENU; None where it does not reach."""
        rows = self.newest.between(t_ns - BREAK_NS, t_ns + BREAK_NS)
        if not len(rows) or not rows["t_ns"][0] - STEP_NS <= t_ns <= rows["t_ns"][-1] + STEP_NS:
            return None
        at = (rows["t_ns"] - t_ns) / 1e9
        return np.array([np.interp(0.0, at, rows["position_enu_m"][:, k]) for k in range(3)])

    def state_at(self, t_ns: int) -> State | None:
        """What was known at ``t_ns``: the last kept state before it."""
        at = int(np.searchsorted(self.newest.view["t_ns"], t_ns, side="right")) - 1
        return _state(self.newest.view[at]) if at >= 0 else None

    def _mark(self, t_ns: int, text: str, level: str) -> None:
        if t_ns and len(self.moments) < MOST_EVENTS:
            self.moments[t_ns, text] = level

    def _set_mark(self, t_ns: int, what: str) -> None:
        if len(self.marks) < MOST_EVENTS:
            self.marks[t_ns] = what

    def _take_newest(self, state: State) -> None:
        self.state, self.arrived_s = state, time.monotonic()
        last = self.newest.view[-1] if len(self.newest.view) else None
        row = self._row_after(last, state)
        if row is None:
            return
        if row["cut"] and last is not None:
            gap_ns = state.t_ns - int(last["t_ns"])
            self._set_mark(state.t_ns, GAP if gap_ns >= BREAK_NS else RESET)
        self.newest.add(row)
        self._fresh.newest.append(row)

    def _take_smoothed(self, state: State) -> None:
        row = self._row_after(self._smoothed, state)
        if row is not None:
            self._smoothed = row
            self._fresh.smoothed.append(row)

    def _row_after(self, last: np.void | None, state: State) -> np.void | None:
        """The state as a row to keep; None where it comes late or sooner than can be seen."""
        cut = False
        if last is not None:
            gap_ns = state.t_ns - int(last["t_ns"])
            cut = gap_ns >= BREAK_NS or state.reset_counter != last["reset_counter"]
            if gap_ns < 0 or not (cut or gap_ns >= STEP_NS):
                return None  # what comes late is not drawn: rows are in order of time
        return np.array([_row(state, self._nis(state.t_ns), cut=cut)], TRACK)[0]

    def _nis(self, t_ns: int) -> float:
        while self._squares and self._squares[0][0] < t_ns - NIS_NS:
            self._squares.popleft()
        squares = [square for _, square in self._squares if square == square]
        return sum(squares) / len(squares) if squares else math.nan

    def _take_health(self, health: Health) -> None:
        self.health, self.health_s = health, time.monotonic()
        self.healths.add(health.t_ns, health)
        for name, sensor in health.sensors.items():
            for which, error in sensor.errors.items():
                key = name, which
                rows = self.errors.get(key) or self.errors.setdefault(key, GrowingRows(ERROR, MOST_ERRORS))
                rows.add((health.t_ns, error.value, error.sigma))


def _row(state: State, nis: float, *, cut: bool) -> tuple:
    values = [getattr(state, name) for name in NAMES]
    values[NAMES.index("covariance")] = state.covariance[:6]
    return (*(math.nan if value is None else value for value in values), nis, cut)


def _state(row: np.void) -> State:
    """A kept row as a message again; of its covariance only the position's part was kept."""

    def or_none(name: str) -> float | None:
        value = float(row[name])
        return value if math.isfinite(value) else None

    def three(name: str) -> tuple[float, float, float]:
        values: Sequence[float] = row[name].tolist()
        return values[0], values[1], values[2]

    return State(
        t_ns=int(row["t_ns"]),
        seq=0,
        lat_deg=float(row["lat_deg"]),
        lon_deg=float(row["lon_deg"]),
        alt_m=float(row["alt_m"]),
        position_enu_m=three("position_enu_m"),
        velocity_enu_mps=three("velocity_enu_mps"),
        acceleration_enu_mps2=three("acceleration_enu_mps2"),
        covariance=row["covariance"].tolist() + [0.0] * 39,
        quality=int(row["quality"]),
        reset_counter=int(row["reset_counter"]),
        protection_h_m=or_none("protection_h_m"),
        protection_v_m=or_none("protection_v_m"),
        ambiguous=bool(row["ambiguous"]),
    )
