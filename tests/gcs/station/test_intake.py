"""The station file's numbers as the estimator gets them."""

import numpy as np
import pytest

from filters.models import state
from filters.models.rows import AZIMUTH, ELEVATION, RANGE
from gcs.contract.config import (
    ChannelLatency,
    HeightPrior,
    Position,
    SensorPrior,
    SensorSection,
    SensorSigma,
    Station,
    VehicleSection,
)
from gcs.contract.frames import Frame
from gcs.contract.messages import CHANNELS, Bad, InsMeasurement, PolarMeasurement, decode, encode, to_columns
from gcs.station.intake import Intake, sensors_of, settings_of
from gcs.station.ledger import NO_TIME, Ledger

SITE = Position(lat_deg=-35.35, lon_deg=149.16, alt_m=640.0)


def test_priors_reach_the_state():
    prior = SensorPrior(range_m=2.0, azimuth_deg=0.1, elevation_deg=0.2, clock_s=0.5, slow=0.0)
    instrument = SensorSection(
        name="theo", kind="theodolite", position=SITE, prior=prior, estimate=["bias", "clock"]
    )
    sensors = sensors_of(Station(sensor=[instrument]), Frame(-35.36, 149.16, 600.0))
    built = state.build(sensors)
    at = [built.bias_at[1, channel] for channel in (RANGE, AZIMUTH, ELEVATION)]
    expected = [2.0, np.radians(0.1), np.radians(0.2)]
    np.testing.assert_allclose(np.sqrt(built.prior[at]), expected)
    assert np.sqrt(built.prior[built.clock_at[1]]) == 0.5


@pytest.mark.parametrize(("prior", "slow"), [(SensorPrior(), 1.0), (SensorPrior(slow=2.5), 2.5)])
def test_how_large_slow_errors_are_reaches_the_state(prior, slow):
    """In the noise that the file says, and the default in the one that it does not say."""
    sigma = SensorSigma(range_m=0.4)
    instrument = SensorSection(name="theo", kind="theodolite", position=SITE, prior=prior, sigma=sigma)
    ins, theodolite = sensors_of(Station(sensor=[instrument]), Frame(-35.36, 149.16, 600.0))
    assert theodolite.slow == slow
    built = state.build([ins, theodolite])
    at = built.bias_at[1, [RANGE, AZIMUTH, ELEVATION]]
    expected = slow * np.array([0.4, np.radians(0.003), np.radians(0.003)])
    np.testing.assert_allclose(np.sqrt(built.prior[at]), expected)


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


def intake_of(**more) -> Intake:
    """Of one theodolite."""
    station = Station(sensor=[SensorSection(name="theo", kind="theodolite", position=SITE, **more)])
    return Intake(station, Frame(-35.36, 149.16, 600.0), Ledger(["ins", "theo"], ("",)))


def entered(intake: Intake, **fields) -> dict[str, np.void]:
    """The rows of one measurement, by channel."""
    one = PolarMeasurement(t_ns=10**18, arrival_ns=10**18, range_m=800.0, azimuth_deg=10.0, **fields)
    rows, _ = intake.enter(intake.polar("theo", to_columns([one], PolarMeasurement)))
    return {CHANNELS[row["channel"]]: row for row in rows}


def test_every_channel_has_its_own_latency_and_the_record_the_stamp():
    intake = intake_of(latency_s=ChannelLatency(range_m=0.06, azimuth_deg=-0.01))
    rows = entered(intake)
    assert rows["range"]["t_ns"] == 10**18 - 60_000_000
    assert rows["azimuth"]["t_ns"] == 10**18 + 10_000_000
    assert set(intake.ledger.entries["t_ns"].tolist()) == {10**18}


def test_a_row_brings_its_own_noise():
    rows = entered(intake_of(), sigma_range_m=0.25)
    assert (rows["range"]["sigma"], rows["azimuth"]["sigma"]) == (0.25, 0.0)
    rows = entered(intake_of(), sigma_azimuth_deg=0.01)
    assert (rows["range"]["sigma"], rows["azimuth"]["sigma"]) == (0.0, pytest.approx(np.radians(0.01)))


@pytest.mark.parametrize("sigma", [-1.0, float("inf"), 1e-300])
def test_noise_that_cannot_be_costs_its_value(sigma):
    intake = intake_of()
    assert set(entered(intake, sigma_range_m=sigma)) == {"azimuth"}
    refused = intake.ledger.entries[intake.ledger.entries["final"]]
    assert intake.ledger.reason_texts(refused) == ["its own sigma cannot be"]


def test_a_reason_is_one_short_line_and_its_time_fits():
    intake = intake_of()
    bad = Bad(source="theo", where="udp", reason="x\n" * 20_000_000, t_ns=2**64)
    batch = intake.bad("theo", [bad])
    text = intake.ledger.reasons[batch.complaints[0]]
    assert len(text) <= 200
    assert "\n" not in text
    assert batch.entries["t_ns"][0] == NO_TIME


def test_a_known_height_is_above_the_origin():
    vehicle = VehicleSection(height_m=HeightPrior(mean=610.0, sigma=5.0))
    settings = settings_of(Station(vehicle=vehicle), Frame(-35.36, 149.16, 600.0))
    assert (settings.height_m, settings.height_sigma_m) == (10.0, 5.0)
