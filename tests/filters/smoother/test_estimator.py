"""The estimator as a whole: what arrives late or in pieces, gaps, verdicts, methods, the report."""

import json

import numpy as np
import pytest

from filters import methods
from filters.models.rows import AZIMUTH, CHANNELS, DUPLICATE, INVALID, ISOLATED, LATE, PATCH, RANGE, ROW, USED
from filters.smoother import status
from tests.filters.smoother import small

SENSORS = small.four()


def run(rows, *, method="default", sensors=SENSORS, parts=None, settings=None):
    """(track, smoothed, all verdicts, estimator) of ``rows`` taken ``parts`` by parts."""
    estimator = methods.make(method, sensors, settings)
    steps = [estimator.step(part) for part in (parts or [rows])] + [estimator.finish()]
    return *(np.concatenate([s[k] for s in steps]) for k in range(3)), estimator


def finals(verdicts):
    final = verdicts[verdicts["final"]]
    return final[np.argsort(final["id"], kind="stable")]


def error_m(track):
    return np.linalg.norm(track["x"][:, :3] - small.truth(track["t_ns"] * 1e-9)[0], axis=1)


def contaminated(seconds=8.0, seed=0, share=0.03):
    """(rows, (k,) whether an outlier)."""
    rows = small.fly(SENSORS, seconds, seed=seed)
    rng = np.random.default_rng(seed + 100)
    sigma = np.array([SENSORS[r["sensor"]].sigma[r["channel"]] for r in rows])
    bad = rng.random(len(rows)) < share
    rows["value"][bad] += (sigma * rng.choice([-1, 1], len(rows)) * rng.uniform(15, 60, len(rows)))[bad]
    return rows, bad


@pytest.fixture(scope="module")
def whole():
    rows, bad = contaminated()
    return rows, bad, run(rows)


def same(a, b):
    return all(
        np.array_equal(a[name], b[name], equal_nan=a[name].dtype.kind == "f") for name in a.dtype.names
    )


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


@pytest.mark.xfail(strict=True, reason="a vague channel does not recover from one outlier, see test_status")
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


@pytest.mark.xfail(strict=True, reason="what is decided by `finish` itself is never published as smoothed")
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


# ---- gaps


@pytest.mark.parametrize("gap_s", [1.0, 5.0, 20.0, 60.0, 120.0])
def test_it_comes_back_after_a_gap(gap_s):
    path = {"v0": (5.0, -3.0, 0.0)}
    before, after = (
        small.fly(SENSORS, 3.0, **path),
        small.fly(SENSORS, 4.0, seed=1, begin_s=3.0 + gap_s, **path),
    )
    rows = np.concatenate([before, after])
    rows["id"] = np.arange(len(rows))
    track, smoothed, verdicts, estimator = run(rows)
    for found in (track, smoothed, estimator.smooth()):
        back = found[found["t_ns"] > (3.5 + gap_s) * 1e9]
        wrong = np.linalg.norm(back["x"][:, :3] - small.truth(back["t_ns"] * 1e-9, **path)[0], axis=1)
        assert len(back) > 60
        assert wrong.max() < 3.0
    assert np.array_equal(finals(verdicts)["id"], rows["id"])
    used = finals(verdicts)["verdict"][rows["t_ns"] > (3.5 + gap_s) * 1e9] == USED
    assert used.mean() > 0.95


# ---- methods


@pytest.mark.parametrize("method", methods.METHODS)
def test_every_method_runs_and_starts_anew_after_a_loss(method):
    before, after = small.fly(SENSORS, 4.0), small.fly(SENSORS, 4.0, seed=1, begin_s=100.0)
    rows = np.concatenate([before, after])
    rows["id"] = np.arange(len(rows))
    track, _, verdicts, estimator = run(rows, method=method)
    for begin, end in ((1.0, 4.0), (101.0, 104.0)):
        part = track[(track["t_ns"] > begin * 1e9) & (track["t_ns"] < end * 1e9)]
        assert len(part) > 80
        assert error_m(part).max() < 5.0
    assert track["reset_counter"][-1] == 1
    assert [reset["reason"][:13] for reset in estimator.report()["resets"]] == ["nothing heard"]
    assert np.array_equal(finals(verdicts)["id"], rows["id"])


def test_an_unknown_method_lists_the_known_ones():
    with pytest.raises(ValueError, match=r"'magic'.*default, ukf, gate, igg, ga-bp-ukf"):
        methods.make("magic", SENSORS)


@pytest.mark.xfail(
    strict=True,
    reason="the window is decided again by status whatever the rule: no method but the default is itself",
)
def test_plain_ukf_takes_everything_and_a_gate_does_not():
    rows, bad = contaminated(4.0, share=0.02)
    settled = rows["t_ns"] > 1_500_000_000
    taken = finals(run(rows, method="ukf")[2])["verdict"]
    assert (taken[settled] == USED).all()
    gated = finals(run(rows, method="gate")[2])["verdict"]
    assert (gated[settled & bad] != USED).mean() > 0.6


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


@pytest.mark.parametrize("size", [50.0, 500.0, 5000.0])
def test_it_follows_a_jump_of_everything(size):
    """As after a restarted reference: all sensors agree that the target is elsewhere at once."""
    jump = size * np.array([0.6, -0.8, 0.0])
    before, after = (
        small.fly(SENSORS, 3.0),
        small.fly(SENSORS, 4.0, seed=1, begin_s=3.0, p0=np.array([300.0, 900, 200]) + jump),
    )
    rows = np.concatenate([before, after])
    rows["id"] = np.arange(len(rows))
    track, *_ = run(rows)
    back = track[track["t_ns"] > 5.5e9]
    wrong = np.linalg.norm(back["x"][:, :3] - small.truth(back["t_ns"] * 1e-9)[0] - jump, axis=1)
    assert len(back) > 50
    assert wrong.max() < 3.0
