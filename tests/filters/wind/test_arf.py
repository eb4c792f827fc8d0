"""The robust adaptive filter against textbook twins that know nothing of differencing."""

import numpy as np
import pytest

from filters.models.update import weight as three_segments
from filters.wind import arf
from filters.wind.arf import Wind1D

FIXED_PHI = {"phi_sigma": 1e-9, "phi_walk": 0.0}


def measured(n: int = 120, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 8.0 + np.cumsum(rng.normal(0.0, 0.3, n)) + rng.normal(0.0, 1.5, n)


def with_noise_in_the_state(z: np.ndarray, model: Wind1D) -> tuple[np.ndarray, np.ndarray]:
    """Plain Kalman filter over (x, η, γ): the coloured noise is a state, measured without any error."""
    phi, psi = model.phi, model.noise_memory
    F = np.array([[phi, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, psi]])
    G = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    Q = G @ np.diag([model.drift_var, model.noise_var]) @ G.T
    H = np.array([[1.0, 0.0, 1.0]])
    x = np.array([z[0], 0.0, 0.0])
    start = model.start_sigma**2  # z(0) is exact: what x is too high, γ is too low
    P = np.array([[start, 0.0, -start], [0.0, model.drift_var, 0.0], [-start, 0.0, start]])
    out, sigma = [x[0]], [model.start_sigma]
    for value in z[1:]:
        x, P = F @ x, F @ P @ F.T + Q
        if np.isfinite(value):
            K = P @ H.T / (H @ P @ H.T)
            x, P = x + K[:, 0] * (value - H[0] @ x), P - K @ H @ P
        out.append(x[0])
        sigma.append(np.sqrt(P[0, 0]))
    return np.array(out), np.array(sigma)


@pytest.mark.parametrize("psi", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("phi", [1.0, 0.9])
def test_differencing_and_decorrelation_are_exact(psi, phi):
    model = Wind1D(noise_memory=psi, phi=phi, **FIXED_PHI)
    z = measured()
    found = arf.estimate(z, "kalman", model)
    x, sigma = with_noise_in_the_state(z, model)
    np.testing.assert_allclose(found.x, x, atol=1e-6)
    np.testing.assert_allclose(found.sigma, sigma, atol=1e-6)


def test_with_white_noise_a_missing_measurement_is_no_measurement():
    model, z = Wind1D(noise_memory=0.0, **FIXED_PHI), measured(seed=1)
    z[40:47] = np.nan
    np.testing.assert_allclose(
        arf.estimate(z, "kalman", model).x, with_noise_in_the_state(z, model)[0], atol=1e-6
    )


def test_coloured_noise_remembers_over_a_missing_measurement():
    model, z = Wind1D(noise_memory=0.5, **FIXED_PHI), measured(seed=2)
    z[60] = np.nan
    found, twin = arf.estimate(z, "kalman", model), with_noise_in_the_state(z, model)[0]
    assert np.abs(found.x - twin).max() < 0.2 * found.sigma[60]  # the stand-in is taken as independent


def test_three_segments():
    u = np.linspace(-12.0, 12.0, 2001)
    weight = np.array([three_segments(v, 1.5, 8.0) for v in u])
    assert (weight[np.abs(u) <= 1.5] == 1.0).all()
    assert (weight[np.abs(u) > 8.0] == 0.0).all()
    assert three_segments(3.0, 1.5, 8.0) == pytest.approx(1.5 / 3.0 * (5.0 / 6.5) ** 2)
    assert np.abs(np.diff(weight)).max() < 0.02  # no jump where the segments meet
    assert (np.diff(weight[u >= 0.0]) <= 0.0).all()


def test_a_robust_filter_without_outliers_is_nearly_the_kalman_filter():
    z = measured(400, seed=3)
    kalman, robust = (arf.estimate(z, method, Wind1D(noise_memory=0.0)).x for method in ("kalman", "arf"))
    assert np.sqrt(np.mean((kalman - robust) ** 2)) < 0.5


def test_a_run_of_outliers_is_refused_and_the_truth_kept():
    rng = np.random.default_rng(4)
    truth = np.full(300, 10.0)
    z = truth + rng.normal(0.0, 1.0, 300)
    z[150:160] += 30.0
    model = Wind1D(noise_memory=0.0, noise_var=1.0)
    found = arf.estimate(z, "arf", model)
    assert (found.weight[150:160] == 0.0).all()
    assert np.abs(found.x[150:170] - 10.0).max() < 3.0
    assert np.abs(arf.estimate(z, "kalman", model).x[150:170] - 10.0).max() > 8.0


def test_refusing_does_not_let_the_next_outlier_in():
    z = 10.0 + np.random.default_rng(6).normal(0.0, 1.0, 200)
    z[100:112] = 21.0
    found = arf.estimate(z, "arf", Wind1D())
    assert (found.weight[100:112] == 0.0).all()
    assert found.sigma[111] > 1.5 * found.sigma[99]  # yet it says that it knows less
    assert np.ptp(found.x[99:112]) == 0.0
    z[105:110] = np.nan  # time without any value is none refused: the wind may have changed
    assert arf.estimate(z, "arf", Wind1D()).weight[110] > 0.0


def test_a_new_wind_is_accepted_after_its_patience():
    rng = np.random.default_rng(5)
    truth = np.where(np.arange(300) < 150, 10.0, -20.0)
    found = arf.estimate(truth + rng.normal(0.0, 1.0, 300), "arf", Wind1D(noise_memory=0.0, noise_var=1.0))
    assert np.abs(found.x[200:] + 20.0).max() < 3.0


def test_unknown_method_and_nothing_measured():
    with pytest.raises(ValueError, match="choose one of kalman, sage-husa, arf"):
        arf.estimate(np.zeros(3), "ekf")
    assert np.isnan(arf.estimate(np.full(4, np.nan)).x).all()
