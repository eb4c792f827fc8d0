"""The station file's numbers as the estimator gets them."""

import numpy as np

from filters.models import state
from filters.models.rows import AZIMUTH, ELEVATION, RANGE
from gcs.contract.config import Position, SensorPrior, SensorSection, Station
from gcs.contract.frames import Frame
from gcs.contract.messages import CHANNELS, InsMeasurement, decode, encode, to_columns
from gcs.station.intake import Intake, sensors_of
from gcs.station.ledger import Ledger

SITE = Position(lat_deg=-35.35, lon_deg=149.16, alt_m=640.0)


def test_priors_reach_the_state():
    prior = SensorPrior(range_m=2.0, azimuth_deg=0.1, elevation_deg=0.2, clock_s=0.5)
    instrument = SensorSection(
        name="theo", kind="theodolite", position=SITE, prior=prior, estimate=["bias", "clock"]
    )
    sensors = sensors_of(Station(sensor=[instrument]), Frame(-35.36, 149.16, 600.0))
    built = state.build(sensors)
    at = [built.bias_at[1, channel] for channel in (RANGE, AZIMUTH, ELEVATION)]
    expected = [2.0, np.radians(0.1), np.radians(0.2)]
    np.testing.assert_allclose(np.sqrt(built.prior[at]), expected)
    assert np.sqrt(built.prior[built.clock_at[1]]) == 0.5


def test_dead_reckoning_costs_position_and_velocity_only():
    place = {"lat_deg": -35.36, "lon_deg": 149.16, "alt_msl_m": 650.0}
    moved = dict.fromkeys(["ve_mps", "vn_mps", "vu_mps", "ae_mps2", "an_mps2", "au_mps2"], 1.0)
    sent = [
        InsMeasurement(t_ns=k, arrival_ns=k, dead_reckoned=lost, **place, **moved)
        for k, lost in enumerate([False, True])
    ]
    station, frame = Station(), Frame(-35.36, 149.16, 600.0)
    ledger = Ledger([sensor.name for sensor in sensors_of(station, frame)], ("",))
    batch = Intake(station, frame, ledger).ins(
        to_columns([decode(*encode(one)) for one in sent], InsMeasurement)
    )
    said = {
        (entry["measurement"], CHANNELS[entry["channel"]]): ledger.reasons[complaint]
        for entry, complaint in zip(batch.entries, batch.complaints, strict=True)
    }
    assert len(said) == 18
    complaint = "no GPS fix, the autopilot's own dead reckoning"
    assert {key for key, text in said.items() if text == complaint} == {
        (1, channel) for channel in ("e", "n", "u", "ve", "vn", "vu")
    }
    assert set(said.values()) == {"", complaint}
