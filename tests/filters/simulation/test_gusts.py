import numpy as np
import pytest

from filters.simulation import gusts, scenario

DT_S = 0.02


def blown(seconds: float, airspeed: float, height: float, wind: float, seed: int = 1) -> np.ndarray:
    n = round(seconds / DT_S)
    rng = np.random.default_rng(seed)
    return gusts.dryden(np.full(n, airspeed), np.full(n, height), wind, DT_S, rng)


def test_intensity_and_scale_are_those_of_the_model():
    sigma, scale_m = gusts.intensities(np.array([304.8, 30.48]), 15.0)
    assert sigma[0, 2] == sigma[1, 2] == pytest.approx(1.5)
    assert sigma[0, 0] == pytest.approx(1.5, rel=0.01)  # isotropic at 1000 ft
    assert sigma[1, 0] == pytest.approx(1.5 / (0.177 + 0.0823) ** 0.4)
    assert scale_m[1, 2] == pytest.approx(30.48)
    assert scale_m[1, 0] == pytest.approx(30.48 / (0.177 + 0.0823) ** 1.2)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_variance_is_kept_by_the_filters(axis):
    found = blown(6000.0, 30.0, 100.0, 15.0)[:, axis]
    sigma, _ = gusts.intensities(np.array([100.0]), 15.0)
    assert found.std() == pytest.approx(sigma[0, axis], rel=0.08)


def test_gusts_along_forget_after_the_scale_length():
    along = blown(6000.0, 30.0, 100.0, 15.0)[:, 0]
    _, scale_m = gusts.intensities(np.array([100.0]), 15.0)
    lag = round(scale_m[0, 0] / 30.0 / DT_S)
    assert np.corrcoef(along[lag:], along[:-lag])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.1)


def test_gusts_across_have_the_model_s_spectrum():
    """Φ(ω) of a lateral gust: σ² T/π (1 + 3 (Tω)²) / (1 + (Tω)²)²; its part below 1/T and above."""
    across = blown(8000.0, 30.0, 100.0, 15.0)[:, 1]
    _, scale_m = gusts.intensities(np.array([100.0]), 15.0)
    T = scale_m[0, 1] / 30.0
    power = np.abs(np.fft.rfft(across)) ** 2
    omega = 2 * np.pi * np.fft.rfftfreq(len(across), DT_S)
    model = (1 + 3 * (T * omega) ** 2) / (1 + (T * omega) ** 2) ** 2
    low = (omega > 0) & (omega < 1.0 / T)
    high = (omega >= 1.0 / T) & (omega < 0.2 * np.pi / DT_S)
    assert power[low].sum() / power[high].sum() == pytest.approx(
        model[low].sum() / model[high].sum(), rel=0.1
    )


@pytest.mark.parametrize("kind", list(gusts.AIRFRAMES))
def test_an_aircraft_gives_way_and_comes_back(kind):
    rng = np.random.default_rng(3)
    calm = scenario.flight(300.0, 100.0, "gentle", rng)
    flown = gusts.buffeted(calm, 15.0, gusts.AIRFRAMES[kind], rng, (10.0, 0.0, 0.0))
    off = flown.p - calm.p
    assert 0.05 < off.std() < 10.0
    assert np.abs(off).max() < 40.0
    assert np.allclose(np.gradient(flown.p, 0.01, axis=0), flown.v, atol=0.05)


def test_the_same_seed_gives_the_same_air():
    assert np.array_equal(blown(10.0, 20.0, 50.0, 8.0, 5), blown(10.0, 20.0, 50.0, 8.0, 5))
    assert not np.array_equal(blown(10.0, 20.0, 50.0, 8.0, 5), blown(10.0, 20.0, 50.0, 8.0, 6))
