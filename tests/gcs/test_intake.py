"""The station file's numbers as the estimator gets them."""

import numpy as np

from filters import model
from filters.rows import AZIMUTH, ELEVATION, RANGE
from gcs.config import Position, Sensor, SensorPrior, Station
from gcs.frames import Frame
from gcs.intake import sensors_of

SITE = Position(lat_deg=-35.35, lon_deg=149.16, alt_m=640.0)


def test_priors_reach_the_state():
    prior = SensorPrior(range_m=2.0, azimuth_deg=0.1, elevation_deg=0.2, clock_s=0.5)
    instrument = Sensor(
        name="theo", kind="theodolite", position=SITE, prior=prior, estimate=["bias", "clock"]
    )
    sensors = sensors_of(Station(sensor=[instrument]), Frame(-35.36, 149.16, 600.0))
    built = model.build(sensors, 1.0, 1.0, 1.0)
    at = [built.bias_at[1, channel] for channel in (RANGE, AZIMUTH, ELEVATION)]
    expected = [2.0, np.radians(0.1), np.radians(0.2)]
    np.testing.assert_allclose(np.sqrt(built.prior[at]), expected)
    assert np.sqrt(built.prior[built.clock_at[1]]) == 0.5
