"""Where the instruments look: polar values of the best estimate, claimed places, crossing and dilution."""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from gcs.contract.frames import polar_to_enu
from gcs.contract.messages import CHANNELS
from gcs.report.basis import numbers
from gcs.report.basis.run import Run, is_one_of

POLAR = tuple(CHANNELS.index(name) for name in ("range", "azimuth", "elevation"))
HEARD_S = 1.0  # an instrument that spoke so recently takes part in the geometry


class Sight(NamedTuple):
    """The best estimate as one instrument should see it, at (n,) times."""

    range_m: np.ndarray
    azimuth_deg: np.ndarray
    elevation_deg: np.ndarray


class Crossing(NamedTuple):
    """Geometry at (n,) times; NaN where too few instruments speak."""

    t_ns: np.ndarray
    angle_deg: np.ndarray  # best crossing: the angle nearest to 90° between two lines of sight
    horizontal_m: np.ndarray  # 1 sigma of a fix from one measurement of each instrument
    height_m: np.ndarray
    dilution: np.ndarray  # 1 sigma of that fix over that of a single coordinate of one measurement


def best(run: Run, names: Sequence[str], t_ns: np.ndarray) -> np.ndarray:
    """(n, c) columns ``names`` of the best estimate at (n,) times; NaN outside it and in its pauses."""
    known_ns = run.smoothed["t_ns"]
    columns = np.column_stack([run.smoothed[name] for name in names])
    return numbers.at_times(t_ns, known_ns, columns, numbers.longest_s(known_ns))


def positions(run: Run, t_ns: np.ndarray) -> np.ndarray:
    """(n, 3) of the best estimate at (n,) times, station ENU in m; NaN outside it."""
    return best(run, ("e_m", "n_m", "u_m"), t_ns)


def velocities(run: Run, t_ns: np.ndarray) -> np.ndarray:
    """(n, 3) of the best estimate at (n,) times, m/s."""
    return best(run, ("ve_mps", "vn_mps", "vu_mps"), t_ns)


def sight(run: Run, sensor: str, t_ns: np.ndarray) -> Sight:
    """See `Sight`; ``t_ns`` (n,)."""
    offset, rotation = _place(run, sensor)
    east, north, up = ((positions(run, t_ns) - offset) @ rotation.T).T
    flat = np.hypot(east, north)
    return Sight(
        np.hypot(flat, up), np.degrees(np.arctan2(east, north)) % 360.0, np.degrees(np.arctan2(up, flat))
    )


def claims(run: Run, sensor: str, refused: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) and places (k, 3) where an instrument saw the target with a range or an angle refused.

    Of measurements that have all three.
    """
    values = run.of(sensor)
    stamps, at = np.unique(values["t_ns"], return_inverse=True)
    polar, wrong = np.full((len(stamps), 3), np.nan), np.zeros(len(stamps), bool)
    for k, channel in enumerate(POLAR):
        own = values["channel"] == channel
        polar[at[own], k] = values["value"][own]
        wrong[at[own & is_one_of(values, refused)]] = True
    place = _place(run, sensor)
    where = polar_to_enu(polar[:, 0], np.radians(polar[:, 1]), np.radians(polar[:, 2]), *place)
    kept = wrong & np.isfinite(where).all(axis=1)
    return stamps[kept], where[kept]


def crossing(run: Run, step_s: float) -> Crossing:
    """The geometry every ``step_s``, of the instruments that have spoken within HEARD_S."""
    t_ns = np.arange(run.start_ns, run.end_ns + 1, round(step_s * 1e9))
    at, count = positions(run, t_ns), len(run.station.sensor)
    unit, widths = np.full((count, len(t_ns), 3), np.nan), np.full((count, len(t_ns)), np.nan)
    information = np.zeros((len(t_ns), 3, 3))
    for k, sensor in enumerate(run.station.sensor):
        away = at - _place(run, sensor.name)[0]
        distance = np.linalg.norm(away, axis=1)
        heard = _heard(np.unique(run.of(sensor.name)["t_ns"]), t_ns) & np.isfinite(distance)
        direction = away / distance[:, None]
        noise = sensor.sigma_by_channel
        spoken = {CHANNELS[c] for c in np.unique(run.of(sensor.name)["channel"]) if c < len(CHANNELS)}
        across = distance * np.radians(min(noise.get("azimuth", np.inf), noise.get("elevation", np.inf)))
        for axis, sigma in _axes(direction, distance, noise, spoken):
            gain = axis[:, :, None] * axis[:, None, :] / (sigma**2)[:, None, None]
            information[heard] += gain[heard]
        unit[k, heard], widths[k, heard] = direction[heard], across[heard]
    variance = np.full((len(t_ns), 3), np.nan)
    fixed = np.linalg.cond(information) < 1e12
    variance[fixed] = np.diagonal(np.linalg.inv(information[fixed]), axis1=1, axis2=2)
    horizontal, height = np.sqrt(variance[:, 0] + variance[:, 1]), np.sqrt(variance[:, 2])
    narrow = np.where(np.isfinite(widths), widths, np.inf).min(axis=0, initial=np.inf)
    return Crossing(t_ns, _best_angle(unit), horizontal, height, np.hypot(horizontal, height) / narrow)


def _axes(direction: np.ndarray, distance: np.ndarray, noise: dict[str, float], spoken: set[str]):
    """What an instrument measures: unit vectors (n, 3) with the 1-sigma (n,) along each, m."""
    level = np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-9)  # overhead azimuth says nothing
    side = np.column_stack([direction[:, 1] / level, -direction[:, 0] / level, np.zeros(len(level))])
    if "range" in spoken:
        yield direction, np.full(len(level), noise["range"])
    if "azimuth" in spoken:
        yield side, distance * level * np.radians(noise["azimuth"])
    if "elevation" in spoken:
        yield np.cross(side, direction), distance * np.radians(noise["elevation"])


def _best_angle(unit: np.ndarray) -> np.ndarray:
    """(n,) of unit vectors (s, n, 3) the acute angle between two lines that is largest, degrees."""
    best = np.full(unit.shape[1], np.nan)
    for a, b in combinations(range(len(unit)), 2):
        cosine = np.abs((unit[a] * unit[b]).sum(axis=1))
        best = np.fmax(best, np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))
    return best


def _heard(spoken_ns: np.ndarray, t_ns: np.ndarray) -> np.ndarray:
    """(n,) bool: whether one of ``spoken_ns``, in order, is within HEARD_S of each of ``t_ns`` (n,)."""
    if not len(spoken_ns):
        return np.zeros(len(t_ns), bool)
    after = np.clip(np.searchsorted(spoken_ns, t_ns), 0, len(spoken_ns) - 1)
    before = np.maximum(after - 1, 0)
    gap = np.minimum(np.abs(spoken_ns[after] - t_ns), np.abs(spoken_ns[before] - t_ns))
    return gap <= HEARD_S * 1e9


def _place(run: Run, sensor: str) -> tuple[np.ndarray, np.ndarray]:
    return run.frame.place_sensor(next(one for one in run.station.sensor if one.name == sensor))
