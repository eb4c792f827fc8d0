"""One run against the truth, and against the oracle: the same filter, told which values are outliers."""

import numpy as np

from bench.scene import SimulatedFlight
from filters.models.rows import CHANNELS, ISOLATED, PATCH
from filters.simulation import scenario, simulate

SETTLE_S = 5.0  # of the flight's beginning, not counted
LOST_M, LOST_S = 20.0, 2.0
CLEAR_SIGMA = 6.0  # an outlier that everybody should find
CALM_S = 1.0  # a track that stays right for so long is back


def distance_m(track: np.ndarray, truth: scenario.Truth, t_ns: np.ndarray) -> np.ndarray:
    """(k,) distance from the truth of the newest state at ``t_ns`` (k,), moved on where it is older."""
    return np.linalg.norm(_position(track, t_ns) - scenario.at(truth, _seconds(t_ns))[0], axis=1)


def epochs(track: np.ndarray, oracle: np.ndarray, truth: scenario.Truth) -> np.ndarray:
    """(k,) times of ``track`` that are compared: settled, in flight, and the oracle has started."""
    t_ns = track["t_ns"]
    t_s = _seconds(t_ns)
    return t_ns[(t_s > SETTLE_S) & (t_s <= truth.t_s[-1]) & (t_ns >= oracle["t_ns"][0])]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def lost(t_ns: np.ndarray, error_m: np.ndarray) -> bool:
    """Whether the error stays above LOST_M for longer than LOST_S."""
    good_ns = np.concatenate([t_ns[:1], t_ns[error_m <= LOST_M], t_ns[-1:]])
    return bool(np.diff(good_ns).max() > LOST_S * 1e9)


def detection(flight: SimulatedFlight, verdicts: np.ndarray) -> dict:
    """How many clear outliers were refused, of both kinds, and how many good values; (found, there)."""
    refused = np.zeros(len(flight.rows), bool)
    refused[verdicts["id"]] = np.isin(verdicts["verdict"], (ISOLATED, PATCH))
    clear = flight.off_sigma >= CLEAR_SIGMA
    kinds = {
        "isolated": clear & (flight.labels == simulate.ISOLATED),
        "patch": clear & (flight.labels == simulate.PATCH),
        "false": flight.labels == simulate.NONE,
    }
    return {name: (int((refused & those).sum()), int(those.sum())) for name, those in kinds.items()}


def nees(track: np.ndarray, truth: scenario.Truth) -> list[float]:
    """Normalised squared position error, 3 degrees of freedom, at every full second after the start."""
    t_ns = simulate.T0_NS + np.arange(SETTLE_S, truth.t_s[-1] - 1.0).astype(np.int64) * 1_000_000_000
    k = np.minimum(np.searchsorted(track["t_ns"], t_ns), len(track) - 1)
    off = track["x"][k, :3] - scenario.at(truth, _seconds(track["t_ns"][k]))[0]
    return np.einsum("ki,ki->k", off, np.linalg.solve(track["P"][k, :3, :3], off[..., None])[..., 0]).tolist()


def patches(flight: SimulatedFlight, track: np.ndarray, oracle: np.ndarray) -> list[dict]:
    """Per patch: error while it lasts over the oracle's; seconds after its end until the track is back.

    Back: for CALM_S its distance from the oracle's track stays within the oracle's RMS error over the flight.
    """
    t_ns = epochs(track, oracle, flight.truth)
    t_s = _seconds(t_ns)
    ours, theirs = distance_m(track, flight.truth, t_ns), distance_m(oracle, flight.truth, t_ns)
    apart = np.linalg.norm(_position(track, t_ns) - _position(oracle, t_ns), axis=1) > rms(theirs)
    out = []
    for begin_s, end_s in flight.spans_s:
        during = (t_s >= begin_s) & (t_s < end_s)
        wrong_s = np.concatenate([[end_s], t_s[apart & (t_s >= end_s)], [np.inf]])
        back_s = wrong_s[np.argmax(np.diff(wrong_s) > CALM_S)] - end_s
        out.append({"during": rms(ours[during]) / rms(theirs[during]), "back_s": float(back_s)})
    return out


def recovered(report: dict, name: str, wrong: simulate.InstrumentErrors) -> dict[str, float]:
    """By how many of its own sigmas each estimated systematic error of instrument ``name`` is wrong."""
    injected = dict(zip(CHANNELS, wrong.zero, strict=False)) | {"clock": wrong.clock_offset_s}
    found = report["sensors"][name]["errors"]
    return {error: abs(said["value"] - injected[error]) / said["sigma"] for error, said in found.items()}


def nis(report: dict) -> dict[str, tuple[float, bool]]:
    """Mean NIS of every channel, and whether it is inside its band."""
    return {
        f"{name} {channel}": (c["nis_mean"], c["nis_band_95"][0] <= c["nis_mean"] <= c["nis_band_95"][1])
        for name, s in report["sensors"].items()
        for channel, c in s["channels"].items()
        if c["used"]
    }


def _position(track: np.ndarray, t_ns: np.ndarray) -> np.ndarray:
    """(k, 3) m: the newest state at ``t_ns``, moved on to it."""
    k = np.maximum(np.searchsorted(track["t_ns"], t_ns, side="right") - 1, 0)
    h, x = ((t_ns - track["t_ns"][k]) * 1e-9)[:, None], track["x"][k]
    return x[:, :3] + h * (x[:, 3:6] + h / 2 * x[:, 6:9])


def _seconds(t_ns: np.ndarray) -> np.ndarray:
    return (t_ns - simulate.T0_NS) * 1e-9
