"""The bench: its scores against cases with a known answer, and the estimator's figures in a short version."""

import json
import shutil

import numpy as np
import pytest

from bench import accuracy, score
from bench.cases import CASES, WRONG
from bench.measure import follow, measure
from bench.scene import Case, Patch, SimulatedFlight, fly
from bench.speed import peers, recording, speed
from filters.methods import make
from filters.models.rows import ISOLATED, ROW, TRACK, USED, VERDICT
from filters.simulation import scenario, simulate
from gcs.contract.messages import InputError

SECONDS = 15.0
SEEDS = range(5, 8)


def straight(seconds=60.0, speed_mps=20.0):
    t_s = np.arange(0.0, seconds, 0.05)
    v = np.tile([speed_mps, 0.0, 0.0], (len(t_s), 1))
    return scenario.Truth(t_s, v * t_s[:, None], v, np.zeros_like(v))


def track_of(truth, off_m, sigma_m=1.0):
    """The truth moved by ``off_m`` (n, 3)."""
    track = np.zeros(len(truth.t_s), TRACK)
    track["t_ns"] = simulate.T0_NS + np.round(truth.t_s * 1e9).astype(np.int64)
    track["x"] = np.hstack([truth.p + off_m, truth.v, truth.a])
    track["P"] = np.eye(9) * sigma_m**2
    return track


def test_distance_is_that_of_the_state_moved_on():
    truth = straight()
    track = track_of(truth, np.array([0.0, 3.0, 4.0]))
    between_ns = track["t_ns"][200:205] + 20_000_000
    assert score.distance_m(track, truth, between_ns) == pytest.approx(5.0)


@pytest.mark.parametrize(("length_s", "lost"), [(1.8, False), (2.3, True)])
def test_lost_is_far_off_for_long(length_s, lost):
    truth = straight()
    far = (truth.t_s >= 30.0) & (truth.t_s < 30.0 + length_s)
    t_ns = track_of(truth, 0.0)["t_ns"]
    assert score.lost(t_ns, np.where(far, 50.0, 1.0)) is lost


def test_nees_of_right_covariances_is_their_dimension():
    rng, truth = np.random.default_rng(1), straight(2000.0)
    off = rng.normal(0.0, 2.0, truth.p.shape)
    assert np.mean(score.nees(track_of(truth, off, 2.0), truth)) == pytest.approx(3.0, abs=0.2)


def test_a_patch_is_measured_while_it_lasts_and_until_it_is_forgotten():
    truth = straight()
    off = np.zeros_like(truth.p)
    off[(truth.t_s >= 30.0) & (truth.t_s < 40.7), 1] = 3.0
    flight = SimulatedFlight(truth, [], np.zeros(0, ROW), np.zeros(0), np.zeros(0), [(30.0, 40.0)])
    one = np.full_like(truth.p, 0.0)
    one[:, 2] = 1.0
    found = score.patches(flight, track_of(truth, off + one), track_of(truth, one))
    assert found[0]["during"] == pytest.approx(np.sqrt(10.0))
    assert found[0]["back_s"] == pytest.approx(0.65, abs=0.06)


def test_detection_counts_clear_outliers_and_good_values():
    labels = np.array([simulate.NONE, simulate.NONE, simulate.ISOLATED, simulate.PATCH, simulate.PATCH])
    flight = SimulatedFlight(None, [], np.zeros(5, ROW), labels, np.array([1.0, 2.0, 9.0, 9.0, 3.0]), [])
    verdicts = np.zeros(5, VERDICT)
    verdicts["id"], verdicts["verdict"] = range(5), [USED, ISOLATED, ISOLATED, USED, USED]
    assert score.detection(flight, verdicts) == {"isolated": (1, 1), "patch": (0, 1), "false": (1, 2)}


def test_a_flight_is_the_same_again_and_the_errors_change_nothing_else():
    case = Case("x", 6, share=0.04, wrong=WRONG, estimate=("bias", "clock"))
    crooked, again, right = (
        fly(case, 3, 20.0),
        fly(case, 3, 20.0),
        fly(case._replace(wrong=simulate.NO_ERRORS), 3, 20.0),
    )
    assert np.array_equal(crooked.rows, again.rows)
    other = crooked.rows["sensor"] != 1
    assert np.array_equal(
        np.sort(crooked.rows[other]["value"]), np.sort(right.rows[right.rows["sensor"] != 1]["value"])
    )


def test_patches_hit_as_many_instruments_as_they_should():
    flight = fly(Case("x", 3, patch=Patch("offset", instruments=2)), 4, 60.0)
    t_s = (flight.rows["t_ns"] - simulate.T0_NS) * 1e-9
    assert len(flight.spans_s) == 2
    for begin_s, end_s in flight.spans_s:
        inside = (t_s > begin_s) & (t_s < end_s)
        assert len(np.unique(flight.rows["sensor"][inside & (flight.labels > 0)])) == 2


def figures(name):
    case = next(case for case in CASES if case.name == name)
    runs = [measure(case, seed, SECONDS, ("default",))["default"] for seed in SEEDS]
    return accuracy.summary(case, "default", runs)["figures"]


@pytest.mark.slow
def test_few_outliers_cost_little():
    found = figures("4 %")
    assert found["ratio_median"] < 1.3
    assert found["smoothed_median"] < 1.2
    assert found["lost"] == 0
    assert found["found_isolated"] > 0.98
    assert found["found_patch"] > 0.95


@pytest.mark.slow
def test_robustness_costs_nothing_where_nothing_is_wrong():
    """Against the same filter without any robustness."""
    case = next(case for case in CASES if case.name == "normal")
    runs = [measure(case, seed, SECONDS, ("default", "ukf")) for seed in SEEDS]
    pairs = [(run["default"], run["ukf"]) for run in runs]
    assert max(ours["ratio"] / plain["ratio"] for ours, plain in pairs) < 1.05
    assert accuracy.summary(case, "default", [ours for ours, _ in pairs])["figures"]["false_per_10000"] < 20.0


@pytest.mark.slow
def test_a_constant_offset_of_one_instrument_is_seen_through():
    case = Case("x", 3, patch=Patch("offset"))
    runs = [measure(case, seed, 31.0, ("default",))["default"] for seed in SEEDS]
    found = accuracy.summary(case, "default", runs)["figures"]
    assert found["during_median"] < 3.0
    assert found["back_median_s"] <= 1.0


@pytest.mark.slow
def test_late_rows_end_in_the_same_track():
    case = Case("late", 7, share=0.041, late_share=0.1)
    assert measure(case, 5, 12.0, ("default",))["default"]["late_m"] <= 1e-9


@pytest.mark.slow
def test_run_writes_what_it_returns(tmp_path):
    out = tmp_path / "bench.json"
    found = accuracy.run(2, 5, 15.0, ("4 %",), ("ukf", "wolf"), 1, out)
    written = json.loads(out.read_text(encoding="utf-8"))
    assert [(c["case"], c["method"]) for c in written["cases"]] == [("4 %", "ukf"), ("4 %", "wolf")]
    assert (
        written["cases"][0]["figures"]["ratio_median"] == found["cases"][0]["figures"]["ratio_median"] > 1.5
    )


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"choose one of 4 %; 15 %"):
        accuracy.run(names=("nonsense",))
    with pytest.raises(InputError, match=r"choose one of .*ukf.*wolf"):
        accuracy.run(methods=("nonsense",))


def test_a_longer_recording_than_the_sample_flight_is_refused():
    """It used to fly what there is, and the figures said nothing of it."""
    with pytest.raises(InputError, match=r"--seconds 600: the sample flight has 148 s"):
        recording.run(600.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("peer", [peers.ours, peers.filterpy, peers.stonesoup])
def test_peers_end_where_the_textbook_does(peer):
    """Otherwise the speeds of different work would be compared. The C++ one compiles too long for here."""
    if peer is peers.stonesoup:
        pytest.importorskip("stonesoup", reason="Stone Soup is not installed: pip install stonesoup")
    work = speed.task(40)
    done = peer(work)
    assert done.ns > 0
    assert np.allclose(done.x[:3], textbook(work)[:3], rtol=0, atol=2e-3)


def test_no_compiler_is_said_and_not_an_error(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    peers._compiled.cache_clear()
    assert peers.eigen(speed.task(3)) is None
    peers._compiled.cache_clear()


def textbook(work):
    """tests/filters/full_ukf over the same shots."""
    from tests.filters import full_ukf

    x, P, t_s = work.x, work.P, 0.0
    for now_s, shot in zip(work.t_s, work.shots, strict=True):
        F, Q = full_ukf.transition(now_s - t_s)
        x, P, t_s = F @ x, F @ P @ F.T + peers.JERK_PSD * Q, now_s
        for channel, value in enumerate(shot):
            x, P, *_ = full_ukf.update(x, P, work.sensor, channel, value)
    return x


def test_follow_takes_parts_as_well():
    flight = fly(Case("x", 1), 6, 8.0)
    ends = np.flatnonzero(np.diff(flight.rows["t_ns"]))[::50] + 1
    whole, parts = (follow(make("ukf", flight.sensors), flight.rows, e) for e in (None, ends))
    assert np.array_equal(whole.track["x"], parts.track["x"])
