"""The estimator as a whole: what arrives late or in pieces, verdicts, accuracy, the report."""

import json

import numpy as np
import pytest

from filters.models.rows import AZIMUTH, CHANNELS, DUPLICATE, INVALID, ISOLATED, LATE, PATCH, RANGE, ROW
from filters.smoother import status
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import SENSORS, contaminated, error_m, finals, run, same


@pytest.fixture(scope="module")
def whole():
    rows, bad = contaminated()
    return rows, bad, run(rows)


# ---- order and batches


@pytest.mark.parametrize("size", [1, 7, 160, 500])
def test_pieces_do_not_matter(whole, size):
    rows, _, (track, smoothed, verdicts, _) = whole
    if size == 1:  # slow: a shorter flight
        rows = rows[:400]
        track, smoothed, verdicts, _ = run(rows)
    epochs = np.flatnonzero(np.diff(rows["t_ns"], prepend=-1))
    cut = epochs[
        np.unique(np.searchsorted(epochs, np.arange(size, len(rows), size)).clip(max=len(epochs) - 1))
    ]
    other = run(rows, parts=np.split(rows, cut))
    assert same(finals(verdicts), finals(other[2]))
    assert same(smoothed, other[1])
    assert same(track, other[0])


@pytest.mark.parametrize("ahead_s", [0.0, 0.15])
def test_when_it_rests_does_not_matter(whole, ahead_s):
    """Over 0.6 s without rows, too. ``ahead_s``: rows come that were not expected any more."""
    rows = whole[0]
    t_s = (rows["t_ns"] - rows["t_ns"][0]) * 1e-9
    rows = rows[(t_s < 3.0) | (t_s > 3.6)]
    parts = np.split(rows, np.flatnonzero(np.diff(rows["t_ns"])) + 1)
    restless, resting = run(rows, parts=parts), Resting(rows["t_ns"], round(ahead_s * 1e9))
    rested = run(rows, parts=parts, between=resting)
    assert resting.closed > 40
    assert same(finals(rested[2]), finals(restless[2]))
    assert same(rested[1], restless[1])
    if not ahead_s:  # else what comes again has been told before
        assert same(rested[0], restless[0])


class Resting:
    """Lets an estimator rest until ``ahead_ns`` after the next of times ``t_ns``; ``closed`` cells so."""

    def __init__(self, t_ns, ahead_ns):
        self._t_ns, self._ahead_ns, self.closed = t_ns, ahead_ns, 0

    def __call__(self, one):
        following = self._t_ns[one._buffer.size :]
        before = one._now.boundary_ns
        if len(following):
            one.rest(int(following[0]) + self._ahead_ns)
        self.closed += one._now.boundary_ns > before


def late(rows, seed, most_s=0.7, share=0.2):
    """The rows, a share of them up to ``most_s`` late, epoch by epoch as they arrive."""
    rng = np.random.default_rng(seed)
    arrival = rows["t_ns"] + np.where(
        rng.random(len(rows)) < share, rng.uniform(0, most_s * 1e9, len(rows)), 0
    )
    order = np.argsort(arrival, kind="stable")
    return np.array_split(rows[order], 60)


@pytest.mark.parametrize("seed", [0, 1])
def test_late_rows_are_judged_as_if_in_time(whole, seed):
    rows, _, (_, smoothed, verdicts, _) = whole
    _, later, found, _ = run(rows, parts=late(rows, seed))
    expected, found = finals(verdicts), finals(found)
    assert np.array_equal(found["id"], expected["id"])
    assert np.array_equal(found["verdict"], expected["verdict"])
    assert np.allclose(found["weight"], expected["weight"], atol=1e-9)
    assert np.array_equal(later["t_ns"], smoothed["t_ns"])
    assert np.allclose(later["x"], smoothed["x"], rtol=0, atol=1e-9)
    assert np.allclose(later["P"], smoothed["P"], rtol=1e-9, atol=1e-12)


def test_a_late_first_row_of_a_whole_sensor(whole):
    """One sensor arrives 0.6 s after all others throughout."""
    rows, _, (_, smoothed, verdicts, _) = whole
    arrival = rows["t_ns"] + np.where(rows["sensor"] == 2, 600_000_000, 0)
    _, later, found, _ = run(rows, parts=np.array_split(rows[np.argsort(arrival, kind="stable")], 80))
    assert np.array_equal(finals(found)["verdict"], finals(verdicts)["verdict"])
    assert np.allclose(later["x"], smoothed["x"], rtol=0, atol=1e-9)


def test_the_track_is_causal_and_goes_forward(whole):
    rows, _, (track, *_) = whole
    assert (np.diff(track["t_ns"]) > 0).all()
    half = run(rows[: len(rows) // 2])[0]
    assert same(half, track[: len(half)])


# ---- verdicts


def test_every_row_gets_exactly_one_final_verdict(whole):
    rows, _, (_, _, verdicts, _) = whole
    assert np.array_equal(finals(verdicts)["id"], rows["id"])


def test_every_row_of_a_bad_stream_gets_exactly_one_final_verdict():
    rows, _ = contaminated(6.0)
    rng = np.random.default_rng(3)
    twins, strange, old = rows[rng.permutation(len(rows))[:20]], rows[:30].copy(), rows[:5].copy()
    strange["value"][:10], strange["sensor"][10:20] = np.nan, 9
    strange["channel"][20:], strange["sensor"][20:] = AZIMUTH, 0
    everything = np.concatenate([rows, twins, strange])
    everything = everything[np.argsort(everything["t_ns"], kind="stable")]
    everything = np.concatenate([everything, old])
    everything["id"] = rng.permutation(len(everything))
    _, _, verdicts, _ = run(None, parts=np.array_split(everything, 40))
    found = finals(verdicts)
    assert np.array_equal(found["id"], np.arange(len(everything)))
    kinds = found["verdict"][everything["id"]]
    assert (kinds[-5:] == LATE).all()
    assert (kinds == DUPLICATE).sum() == 20
    assert (kinds == INVALID).sum() >= 30


def test_a_final_verdict_does_not_come_again(whole):
    *_, (_, _, verdicts, _) = whole
    last = {}
    for v in verdicts:
        assert not last.get(v["id"], False)
        last[v["id"]] = v["final"]


def test_outliers_are_found_and_good_rows_kept(whole):
    rows, bad, (_, _, verdicts, _) = whole
    found, settled = finals(verdicts), rows["t_ns"] > 1_000_000_000
    refused = np.isin(found["verdict"], (ISOLATED, PATCH))
    assert refused[bad & settled].mean() > 0.9
    assert refused[~bad & settled & (rows["sensor"] > 0)].mean() < 0.02


def test_good_rows_of_an_ins_are_kept(whole):
    rows, bad, (_, _, verdicts, _) = whole
    refused = np.isin(finals(verdicts)["verdict"], (ISOLATED, PATCH))
    assert refused[~bad & (rows["sensor"] == 0)].mean() < 0.05


def test_weights_and_verdicts_agree(whole):
    found = finals(whole[2][2])
    judged = found["verdict"] <= PATCH
    assert np.array_equal(
        found["weight"][judged] < status.DOUBT, np.isin(found["verdict"], (ISOLATED, PATCH))[judged]
    )


def test_finish_leaves_nothing_open(whole):
    rows, _, (_, smoothed, _, _) = whole
    epochs = np.unique(rows["t_ns"])
    assert (np.diff(smoothed["t_ns"]) > 0).all()
    assert smoothed["t_ns"][-1] == epochs[-1]


def test_without_any_state_everything_is_finally_invalid():
    alone = [small.theodolite(az=1e-4, el=1e-4)]
    rows = small.fly(alone, 5.0)
    track, smoothed, verdicts, _ = run(rows, sensors=alone)
    assert len(track) == len(smoothed) == 0
    found = finals(verdicts)
    assert np.array_equal(found["id"], rows["id"])
    assert (found["verdict"] == INVALID).all()
    assert (found["reason"] == status.NO_STATE).all()


def test_no_rows_at_all():
    track, smoothed, verdicts, estimator = run(np.zeros(0, ROW))
    assert len(track) == len(smoothed) == len(verdicts) == len(estimator.smooth()) == 0
    json.dumps(estimator.report(), allow_nan=False)


# ---- accuracy


def test_smoothed_is_better_than_causal_and_both_are_good(whole):
    _, _, (track, smoothed, *_) = whole
    after = slice(20, None)
    causal, later = error_m(track[track["t_ns"] > 1e9]), error_m(smoothed[smoothed["t_ns"] > 1e9])
    assert np.sqrt((later[after] ** 2).mean()) < np.sqrt((causal[after] ** 2).mean()) < 0.5


def test_the_whole_flight_smoothed_is_as_good(whole):
    _, _, (_, smoothed, _, estimator) = whole
    best = estimator.smooth()
    assert (np.diff(best["t_ns"]) > 0).all()
    assert set(smoothed["t_ns"]) <= set(best["t_ns"])
    best = best[np.isin(best["t_ns"], smoothed["t_ns"])]
    assert np.sqrt((error_m(best) ** 2).mean()) < np.sqrt((error_m(smoothed) ** 2).mean()) * 1.2


def test_the_sigmas_are_honest():
    """Squared error by the stated covariance, three axes: its mean is 3."""
    nees = []
    for seed in range(3):
        _, smoothed, _, _ = run(small.fly(SENSORS, 5.0, seed=seed + 20))
        gap = smoothed["x"][:, :3] - small.truth(smoothed["t_ns"] * 1e-9)[0]
        nees.append(np.einsum("ki,kij,kj->k", gap, np.linalg.inv(smoothed["P"][:, :3, :3]), gap)[20:])
    assert 0.8 < np.concatenate(nees).mean() < 6.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_lone_instrument_whose_channels_all_go_wrong_is_not_where_the_target_is(seed):
    """A target at the instrument would lie on all its lines of sight, were only the distance wrong."""
    sensors = [small.theodolite()]
    rows = small.fly(sensors, 6.0, hz=20.0, seed=seed)
    wrong = (rows["t_ns"] > 0.4e9) & (rows["t_ns"] < 1.0e9)
    sigma = sensors[0].sigma[rows["channel"]]
    rows["value"][wrong] += (np.array([60.0, 200.0, -150.0])[rows["channel"]] * sigma)[wrong]
    track, *_ = run(rows, sensors=sensors)
    assert error_m(track[track["t_ns"] > 2e9]).max() < 5.0


# ---- the report


def test_the_report_counts_every_decided_row(whole):
    rows, _, (_, _, verdicts, estimator) = whole
    report = estimator.report()
    json.dumps(report, allow_nan=False)
    assert list(report["sensors"]) == [sensor.name for sensor in SENSORS]
    found = finals(verdicts)
    for s, sensor in enumerate(SENSORS):
        channels = report["sensors"][sensor.name]["channels"]
        assert list(channels) == [CHANNELS[c] for c in np.flatnonzero(np.isfinite(sensor.sigma))]
        for name, said in channels.items():
            mine = found[(rows["sensor"] == s) & (rows["channel"] == CHANNELS.index(name))]["verdict"]
            assert said["used"] == (mine < ISOLATED).sum()
            assert said["refused"] == np.isin(mine, (ISOLATED, PATCH)).sum()
    assert report["resets"] == []


def test_a_known_systematic_error_is_found_and_reported():
    sensors = [SENSORS[1]._replace(estimate=("bias",)), SENSORS[2], SENSORS[3], SENSORS[0]]
    rows = small.fly(sensors, 8.0)
    rows["value"][(rows["sensor"] == 0) & (rows["channel"] == RANGE)] += 6.0
    *_, estimator = run(rows, sensors=sensors)
    error = estimator.report()["sensors"]["a"]["errors"]["range"]
    assert abs(error["value"] - 6.0) < 4 * error["sigma"]
    assert error["observable"]
    assert error["unit"] == "m"


def test_where_nobody_can_see_an_error_the_report_says_so():
    sensors = [small.theodolite("a", (0.0, -300.0, 0.0), estimate=("bias",))]
    *_, estimator = run(small.fly(sensors, 5.0), sensors=sensors)
    assert not estimator.report()["sensors"]["a"]["errors"]["azimuth"]["observable"]


def test_protection_bounds_the_error_where_there_are_others(whole):
    _, _, (track, *_) = whole
    later = track[track["t_ns"] > 2e9]
    gap = later["x"][:, :3] - small.truth(later["t_ns"] * 1e-9)[0]
    assert np.isfinite(later["protection_h_m"]).all()
    assert (np.hypot(gap[:, 0], gap[:, 1]) < later["protection_h_m"]).all()
    assert (np.abs(gap[:, 2]) < later["protection_v_m"]).all()


def test_a_sensor_alone_has_no_protection():
    sensors = [small.theodolite()]
    track, *_ = run(small.fly(sensors, 3.0), sensors=sensors)
    assert np.isinf(track["protection_h_m"]).all()
    assert np.isinf(track["protection_v_m"]).all()
