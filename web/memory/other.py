"""Another course of the same flight, laid beside the one that is shown: of a run, or a truth file."""

from typing import NamedTuple

import numpy as np

from gcs.contract.frames import frame_of
from gcs.contract.messages import Scene, State

PAUSE, PAUSE_S = 5.0, 0.5  # of usual intervals, and at least: a longer pause is not bridged
STEP_NS = 100_000_000  # drawn ten times a second; finer cannot be seen
SLOW_MPS = 1.0  # below it there is no direction of flight


class Geodetic(NamedTuple):
    """Where it was at n times in order, WGS84 degrees and ellipsoidal metres."""

    name: str
    t_ns: np.ndarray  # (n,)
    lat_deg: np.ndarray
    lon_deg: np.ndarray
    alt_m: np.ndarray


class Apart(NamedTuple):
    """The state shown minus the other, m: to the front and to the right of the level course, and up."""

    along: float | None  # None: it stands still, there is no course
    across: float | None
    up: float
    whole: float  # in space


class OtherTrack:
    """The other one, in the frame of the page."""

    def __init__(self, given: Geodetic, scene: Scene):
        self.name = given.name
        frame = frame_of(scene)
        self.t_ns, first = np.unique(given.t_ns, return_index=True)
        places = frame.to_enu(given.lat_deg, given.lon_deg, given.alt_m)
        self.places_m = np.asarray(places, float)[first]  # (n, 3) station ENU
        usual_ns = float(np.median(np.diff(self.t_ns))) if len(first) > 1 else 0.0
        self._reach_ns = max(PAUSE_S * 1e9, PAUSE * usual_ns)

    def points(self) -> np.ndarray:
        """(m, 3) to be joined by lines, NaN where it pauses."""
        if not len(self.t_ns):
            return np.zeros((0, 3))
        _, kept = np.unique(self.t_ns // STEP_NS, return_index=True)
        points = self.places_m[kept]
        breaks = np.flatnonzero(np.diff(self.t_ns[kept]) > max(self._reach_ns, 2 * STEP_NS)) + 1
        return np.insert(points, breaks, np.nan, axis=0)

    def place_at(self, t_ns: int) -> np.ndarray | None:
        """(3,) where it was, straight between its places; None: it does not say."""
        after = int(np.searchsorted(self.t_ns, t_ns))
        if after < len(self.t_ns) and self.t_ns[after] == t_ns:
            return self.places_m[after]
        if not 0 < after < len(self.t_ns) or self.t_ns[after] - self.t_ns[after - 1] > self._reach_ns:
            return None
        share = float(t_ns - self.t_ns[after - 1]) / float(self.t_ns[after] - self.t_ns[after - 1])
        return (1.0 - share) * self.places_m[after - 1] + share * self.places_m[after]

    def apart(self, state: State) -> Apart | None:
        """How far ``state`` is from it at its time; None: it does not say."""
        there = self.place_at(state.t_ns)
        if there is None:
            return None
        off = np.array(state.position_enu_m) - there
        east, north = state.velocity_enu_mps[:2]
        speed = float(np.hypot(east, north))
        whole, up = float(np.linalg.norm(off)), float(off[2])
        if speed < SLOW_MPS:
            return Apart(None, None, up, whole)
        along = (off[0] * east + off[1] * north) / speed
        across = (off[0] * north - off[1] * east) / speed
        return Apart(float(along), float(across), up, whole)
