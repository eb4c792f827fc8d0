"""The evidence in numbers: means, bands and systematic errors by hand."""

import json

import numpy as np
import pytest

from filters.models import state
from filters.models.rows import AZIMUTH, RANGE
from filters.smoother.integrity.report import report
from tests.filters.smoother.kit import small

pytestmark = pytest.mark.decision

SENSORS = [small.theodolite("a", estimate=("bias", "clock")), small.ins()]
MODEL = state.build(SENSORS)


def made(tally=None, x=None, P=None, sensors=SENSORS, model=MODEL):
    tally = np.zeros((len(sensors), 13, 3)) if tally is None else tally
    x = np.zeros(len(model.prior)) if x is None else x
    P = state.prior_covariance(model) if P is None else P
    return report(sensors, model, x, P, tally, [])


def test_mean_nis_and_its_band():
    tally = np.zeros((2, 13, 3))
    tally[0, RANGE] = 200, 210.0, 7
    said = made(tally)["sensors"]["a"]["channels"]["range"]
    assert said["used"] == 200
    assert said["refused"] == 7
    assert said["nis_mean"] == pytest.approx(1.05)
    assert said["nis_band_95"] == pytest.approx([1 - 0.196, 1 + 0.196])


def test_the_band_holds_95_percent_of_means():
    rng, tally = np.random.default_rng(0), np.zeros((2, 13, 3))
    tally[0, RANGE, 0] = 200
    low, high = made(tally)["sensors"]["a"]["channels"]["range"]["nis_band_95"]
    means = (rng.normal(size=(4000, 200)) ** 2).mean(axis=1)
    assert ((means > low) & (means < high)).mean() == pytest.approx(0.95, abs=0.01)


def test_a_channel_that_said_nothing_has_no_mean():
    said = made()["sensors"]["a"]["channels"]["azimuth"]
    assert (said["used"], said["nis_mean"], said["nis_band_95"]) == (0, None, None)


def test_an_error_is_observable_when_its_prior_sigma_is_more_than_halved():
    x, P = np.zeros(len(MODEL.prior)), state.prior_covariance(MODEL)
    at, other = MODEL.bias_at[0, RANGE], MODEL.bias_at[0, AZIMUTH]
    x[at] = 3.0
    P[at, at], P[other, other] = 0.24 * MODEL.prior[at], 0.26 * MODEL.prior[other]
    errors = made(x=x, P=P)["sensors"]["a"]["errors"]
    assert errors["range"]["value"] == 3.0
    assert errors["range"]["sigma"] == pytest.approx(np.sqrt(P[at, at]))
    assert errors["range"]["prior_sigma"] == pytest.approx(np.sqrt(MODEL.prior[at]))
    assert errors["range"]["observable"]
    assert not errors["azimuth"]["observable"]
    assert (errors["range"]["unit"], errors["azimuth"]["unit"], errors["clock"]["unit"]) == ("m", "rad", "s")


def test_an_ins_has_a_latency_and_an_instrument_a_clock():
    errors = {name: set(said["errors"]) for name, said in made()["sensors"].items()}
    assert "clock" in errors["a"]
    assert "latency" in errors["ins"]
    assert "clock" not in errors["ins"]


@pytest.mark.parametrize(
    ("estimate", "told"),
    [
        ((), set()),
        (("clock",), {"clock"}),
        (("bias",), {"range", "azimuth", "elevation"}),
        (("bias", "clock"), {"range", "azimuth", "elevation", "clock"}),
    ],
)
def test_zero_errors_are_told_where_they_were_asked_for_and_slow_ones_are_not(estimate, told):
    sensors = [small.theodolite("a", estimate=estimate, slow=1.0), small.ins()]
    model = state.build(sensors)
    assert (model.bias_at[0, :3] >= 0).all()
    said = made(sensors=sensors, model=model)["sensors"]
    assert set(said["a"]["errors"]) == told
    assert set(said["ins"]["errors"]) == {"e", "n", "u", "ve", "vn", "vu", "latency"}


def test_before_the_first_state_there_are_no_errors_to_tell():
    tally = np.zeros((2, 13, 3))
    said = report(SENSORS, MODEL, np.zeros(0), np.zeros((0, 0)), tally, [{"t_ns": 1, "reason": "lost"}])
    assert all(sensor["errors"] == {} for sensor in said["sensors"].values())
    assert said["resets"] == [{"t_ns": 1, "reason": "lost"}]
    json.dumps(said, allow_nan=False)


def test_a_clock_is_told_against_what_most_say():
    sensors = [small.theodolite(name, estimate=("clock",)) for name in "abc"]
    model = state.build(sensors)
    x, tally = np.zeros(len(model.prior)), np.zeros((3, 13, 3))
    x[model.clock_at], tally[:, RANGE, 0] = [0.02, 0.021, 0.4], 1
    said = made(tally, x, sensors=sensors, model=model)["sensors"]
    values = [said[name]["errors"]["clock"]["value"] for name in "abc"]
    assert values == pytest.approx([-0.001, 0.0, 0.379])
