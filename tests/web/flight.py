"""A flight made of a formula, for tests and screenshots of the view."""

from collections.abc import Iterator

import msgspec
import numpy as np

from gcs.contract.messages import (
    Event,
    Health,
    Instrument,
    Scene,
    SensorHealth,
    State,
    SystematicError,
    Verdict,
)

START_NS = 1_790_000_000_000_000_000
HZ = 10
RADAR_ERRORS = {"range": SystematicError(value=1.5, sigma=0.4, unit="m", known=True)}
SCENE = Scene(
    range="demo",
    vehicle="uav1",
    origin_lat_deg=-35.3632,
    origin_lon_deg=149.1652,
    origin_alt_m=584.0,
    instruments=[
        Instrument(name="theo-north", kind="theodolite", position_enu_m=(-520.0, 760.0, 12.0)),
        Instrument(name="theo-south", kind="theodolite", position_enu_m=(420.0, -640.0, 4.0)),
        Instrument(name="radar-west", kind="radar", position_enu_m=(-1050.0, -420.0, 8.0)),
    ],
)
NOISE_M = {"theo-north": 1.5, "theo-south": 1.5, "radar-west": 7.0, "ins": 2.5}


def position(t_s: np.ndarray) -> np.ndarray:
    """(n, 3) station ENU, metres: a drifting, climbing figure of eight of 2 km."""
    angle = t_s / 18.0
    return np.stack(
        [
            950 * np.sin(angle) + 1.5 * t_s - 150,
            620 * np.sin(2 * angle) * np.cos(0.15 * angle),
            190 + 120 * np.sin(angle / 2.3) + 0.5 * t_s,
        ],
        axis=-1,
    )


def messages(seconds: float, seed: int = 7) -> Iterator[tuple[object, str]]:
    """(message, source) in order of time, as a station would give them to the view."""
    rng = np.random.default_rng(seed)
    yield Event(t_ns=START_NS, level="info", text="recording started"), ""
    for i in range(int(seconds * HZ)):
        t_ns = START_NS + i * 1_000_000_000 // HZ
        yield _state(t_ns, i, rng.normal(0, 0.3, 3)), ""
        if i >= HZ:
            yield _state(t_ns - 1_000_000_000, i - HZ, np.zeros(3)), "smoothed"
        for sensor, noise_m in NOISE_M.items():
            yield _verdict(t_ns, i, sensor, noise_m, rng), ""
        if i % HZ == 0:
            yield _health(t_ns), ""
        if i == 30 * HZ:
            yield Event(t_ns=t_ns, level="warning", text="theo-south: 12 azimuths in a row refused"), ""


def _truth(t_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t_s = (t_ns - START_NS) / 1e9
    behind, here, ahead = position(np.array([t_s - 0.1, t_s, t_s + 0.1]))
    return here, (ahead - behind) / 0.2, (ahead - 2 * here + behind) / 0.01


def _state(t_ns: int, seq: int, error: np.ndarray) -> State:
    here, velocity, acceleration = _truth(t_ns)
    here = here + error
    covariance = np.diag([0.5, 0.9, 1.6, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1])
    covariance[1, 0] = covariance[0, 1] = 0.4
    return State(
        t_ns=t_ns,
        seq=seq,
        lat_deg=float(-35.3632 + here[1] / 111_000),
        lon_deg=float(149.1652 + here[0] / 90_600),
        alt_m=float(584.0 + here[2]),
        position_enu_m=tuple(here.tolist()),
        velocity_enu_mps=tuple(velocity.tolist()),
        acceleration_enu_mps2=tuple(acceleration.tolist()),
        covariance=covariance[np.tril_indices(9)].tolist(),
        quality=96,
        reset_counter=0,
        age_s={"theo-north": 0.04, "theo-south": 0.06, "radar-west": 0.12, "ins": 0.02},
    )


def _verdict(t_ns: int, i: int, sensor: str, noise_m: float, rng: np.random.Generator) -> Verdict:
    here = _truth(t_ns)[0] + rng.normal(0, noise_m, 3)
    verdict, off = "used", float(rng.normal(0, noise_m))
    if sensor != "ins" and rng.random() < 0.025:
        verdict, here, off = "isolated", here + rng.normal(0, 90, 3), 90.0
    if sensor == "theo-south" and 300 <= i < 312:
        verdict, here, off = "patch", here + np.array([70.0, -40.0, 30.0]), 86.0
    return Verdict(
        t_ns=t_ns,
        sensor=sensor,
        channel="e" if sensor == "ins" else "range",
        value=800.0 + off,
        predicted=800.0,
        sigma=noise_m,
        weight=float(verdict == "used"),
        verdict=verdict,
        reason="" if verdict == "used" else f"innovation ({off / noise_m:.1f} sigma)",
        position_enu_m=tuple(here.tolist()),
    )


def _health(t_ns: int) -> Health:
    def sensor(rate_hz: float, share: float, latency_s: float) -> SensorHealth:
        return SensorHealth(
            rate_hz=rate_hz, age_s=0.1, outlier_share=share, latency_s=latency_s, alive=True, rows=1000
        )

    return Health(
        t_ns=t_ns,
        sensors={
            "theo-north": sensor(20.0, 0.021, 0.03),
            "theo-south": sensor(20.0, 0.083, 0.03),
            "radar-west": msgspec.structs.replace(sensor(10.0, 0.026, 0.12), errors=RADAR_ERRORS),
            "ins": sensor(25.0, 0.0, 0.02),
        },
    )
