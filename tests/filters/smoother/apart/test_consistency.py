"""Instruments whose errors are slow: what the sigmas are worth with a state for these, and without one."""

import numpy as np
import pytest
from scipy.stats import chi2

from filters import methods
from filters.models import theodolite
from filters.models.motion import CORE, MOTIONS
from filters.models.rows import AZIMUTH, ISOLATED, PATCH
from filters.smoother import adaptation
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import SENSORS, contaminated, finals, run, same

PATH = {"v0": (5.0, -3.0, 0.0)}
BEYOND = chi2.ppf(0.9973, 3)  # squared distance that as few errors exceed as 3 sigma of one number


def instruments(told):
    """Two theodolites and a radar that believe their slow errors to be ``told`` times their noise."""
    return [
        small.theodolite("a", (0.0, -300.0, 0.0), slow=told),
        small.theodolite("b", (900.0, 500.0, 10.0), slow=told),
        small.radar("radar", (-500.0, 700.0, 0.0), slow=told),
    ]


def flown(size, seed, seconds=30.0):
    """Rows of them whose slow errors are ``size`` times their noise."""
    rows = small.fly(instruments(1.0), seconds, seed=seed, **PATH)
    return small.drift(rows, instruments(1.0), size, theodolite.SLOW_TAU_S, seed + 500)


def nees(track):
    """(k,) squared error of the position by the stated covariance; its mean is 3."""
    track = track[track["t_ns"] > 3e9]
    gap = track["x"][:, :3] - small.truth(track["t_ns"] * 1e-9, **PATH)[0]
    return np.einsum("ki,kij,kj->k", gap, np.linalg.inv(track["P"][:, :3, :3]), gap)


def judged(told, size):
    """(newest, smoothed, best: squared errors; share refused) of five flights."""
    newest, smoothed, best, refused = [], [], [], []
    for seed in range(5):
        track, later, verdicts, estimator = run(flown(size, seed), sensors=instruments(told))
        newest.append(nees(track))
        smoothed.append(nees(later))
        best.append(nees(estimator.smooth()))
        refused.append(np.isin(finals(verdicts)["verdict"], (ISOLATED, PATCH)).mean())
    return *(np.concatenate(part) for part in (newest, smoothed, best)), np.mean(refused)


@pytest.mark.slow
def test_with_slow_errors_as_stated_the_sigmas_are_true():
    newest, smoothed, best, refused = judged(1.0, 1.0)
    for found in (newest, smoothed, best):
        assert 1.5 < found.mean() < 4.5  # five flights of three correlation times
        assert (found > BEYOND).mean() < 0.01
    assert refused < 0.001


@pytest.mark.slow
def test_told_that_there_are_none_they_are_not():
    """What the model is for: errors that last are averaged away as if each row had one of its own."""
    newest, smoothed, best, refused = judged(0.0, 1.0)
    assert newest.mean() > 6.0
    assert (newest > BEYOND).mean() > 0.1
    for found in (smoothed, best):
        assert found.mean() > 15.0
        assert (found > BEYOND).mean() > 0.4
    assert refused > 0.005  # good rows of whom the others outvote


@pytest.mark.slow
def test_where_there_are_none_the_sigmas_are_too_wide_and_nobody_is_refused():
    newest, smoothed, _, refused = judged(1.0, 0.0)
    assert 0.3 < smoothed.mean() < newest.mean() < 3.0
    assert not (newest > BEYOND).any()
    assert refused < 0.001


@pytest.mark.parametrize(("size", "low", "high"), [(3.0, 0.9, 3.5), (0.1, -4.0, -1.0)])
def test_an_estimator_learns_how_large_they_are(size, low, high):
    """Within a minute, of every instrument; the log of the factor of the variance."""
    *_, estimator = run(flown(size, 1, seconds=60.0), sensors=instruments(1.0))
    known = estimator._window.now.best.slow
    assert (known[0] > low).all()
    assert (known[0] < high).all()
    assert (known[1] > adaptation.SLOW_SIGMA**-2).all()


def test_the_densities_of_every_window_hold_the_factor_that_was_known_then():
    *_, estimator = run(flown(3.0, 0, seconds=20.0), sensors=instruments(1.0))
    stored = estimator._window.densities.read(0, len(estimator._window.densities))["psd"]
    model = estimator._window.space.model
    factor = stored[:, MOTIONS:]
    assert factor.shape[1] == len(model.prior) - CORE == 9
    assert np.array_equal(factor[0], np.ones(9))
    for s in range(3):
        mine = factor[:, model.slow_of == s]
        assert (mine == mine[:, :1]).all()  # one for all channels of an instrument
        assert mine[-1, 0] > 1.5


def test_a_restart_keeps_how_large_they_are():
    """A jump of everything begins anew; what was learned of the instruments is not lost."""
    rows = flown(3.0, 0)
    jump = small.fly(instruments(1.0), 4.0, seed=9, begin_s=30.0, p0=(0.0, 2e3, 300.0))
    known = {}
    for name, part in (("before", rows), ("after", np.concatenate([rows, jump]))):
        part["id"] = np.arange(len(part))
        *_, estimator = run(part, sensors=instruments(1.0))
        known[name], resets = estimator._window.now.best.slow, estimator.report()["resets"]
    assert len(resets) == 1
    assert (known["before"][0] > 0.5).all()
    assert known["after"][0] == pytest.approx(known["before"][0], abs=0.3)


def test_a_gap_of_a_minute_leaves_how_large_they_are():
    """Less than `adaptation.SLOW_MEMORY_S`: nobody has set the instruments up anew."""
    rows, known = flown(3.0, 0), {}
    late = small.fly(instruments(1.0), 3.0, seed=9, begin_s=90.0, **PATH)
    for name, part in (("before", rows), ("after", np.concatenate([rows, late]))):
        part["id"] = np.arange(len(part))
        *_, estimator = run(part, sensors=instruments(1.0))
        known[name] = estimator._window.now.best.slow[0]
    assert (known["after"] > 0.5 * known["before"]).all()


@pytest.mark.parametrize(
    "slow",
    [
        0.0,
        pytest.param(
            1.0,
            marks=pytest.mark.xfail(
                strict=True, reason="one state of both: 20 s where they are equally large"
            ),
        ),
    ],
)
def test_a_zero_error_is_still_known_twenty_seconds_later(slow):
    """Of a radar's azimuth, as large as its noise, seen beside two theodolites and then alone."""
    sensors = instruments(slow)
    sensors[2] = sensors[2]._replace(estimate=("bias",), zero_sigma=(5.0, 1e-3, 1e-3))
    rows = small.fly(sensors, 40.0, **PATH)
    rows["value"][(rows["sensor"] == 2) & (rows["channel"] == AZIMUTH)] += 1.5e-3
    rows = rows[(rows["t_ns"] < 20e9) | (rows["sensor"] == 2)]
    *_, estimator = run(rows, sensors=sensors)
    error = estimator.report()["sensors"]["radar"]["errors"]["azimuth"]
    assert error["observable"]
    assert error["value"] == pytest.approx(1.5e-3, abs=0.5e-3)


def test_slow_errors_of_an_instrument_do_not_make_the_result_depend_on_pieces():
    rows = flown(1.0, 2, seconds=8.0)
    whole = run(rows, sensors=instruments(1.0))
    again = run(rows, sensors=instruments(1.0))
    parts = run(None, parts=np.array_split(rows, 30), sensors=instruments(1.0))
    for other in (again, parts):
        assert same(whole[1], other[1])
        assert same(finals(whole[2]), finals(other[2]))
    assert same(whole[0], again[0])


def test_outliers_are_found_beside_slow_errors():
    rows, bad = contaminated(8.0)
    sensors = [one._replace(slow=1.0) for one in SENSORS]
    *_, verdicts, _ = run(small.drift(rows, sensors, 1.0, theodolite.SLOW_TAU_S), sensors=sensors)
    refused = np.isin(finals(verdicts)["verdict"], (ISOLATED, PATCH))
    settled = rows["t_ns"] > 1_000_000_000
    assert refused[bad & settled].mean() > 0.9
    assert refused[~bad & settled & (rows["sensor"] > 0)].mean() < 0.02


def test_every_method_runs_with_them():
    rows = flown(1.0, 3, seconds=6.0)
    for method in methods.METHODS:
        track, *_ = run(rows, method=method, sensors=instruments(1.0))
        late = track[track["t_ns"] > 2e9]
        gap = late["x"][:, :3] - small.truth(late["t_ns"] * 1e-9, **PATH)[0]
        assert len(late) > 50
        assert np.linalg.norm(gap, axis=1).max() < 6.0
