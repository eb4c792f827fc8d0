"""Gaps, jumps and the methods by name: whoever loses the target begins again."""

import numpy as np
import pytest

from filters import methods
from filters.models.rows import ELEVATION, USED
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import SENSORS, contaminated, error_m, finals, run


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


SWEEPING = [
    small.theodolite("a", (0.0, 0.0, 3.0), az=4e-3, el=4e-3),
    small.theodolite("b", (4.0, 0.0, 3.0), az=4e-3, el=4e-3),
]
ROOM = {"p0": (2.0, -27.0, 1.0), "v0": (-0.3, 0.1, 0.0), "turn": 0.02}  # y: 3 m at first


def swept(seconds):
    """(k,) ROW of two stations a few metres away; each sweeps for the elevation 8 ms after the azimuth."""
    rows = small.fly(SWEEPING, seconds, hz=30.0, **ROOM)
    rows["t_ns"] += 8_000_000 * (rows["channel"] == ELEVATION)
    return rows[np.argsort(rows["t_ns"], kind="stable")]


def test_two_stations_with_a_sweep_for_each_angle_begin_at_once():
    track, *_ = run(swept(2.0), sensors=SWEEPING)
    assert track["t_ns"][0] < 0.2e9
    gap = track["x"][:, :3] - small.truth(track["t_ns"] * 1e-9, **ROOM)[0]
    assert np.linalg.norm(gap[10:], axis=1).max() < 0.1


def test_a_station_that_comes_back_is_used_at_once():
    """Three seconds by the other one alone leave the target anywhere along its line of sight."""
    rows = swept(8.0)
    alone = (rows["sensor"] == 1) & (rows["t_ns"] > 3e9) & (rows["t_ns"] < 6e9)
    rows = rows[~alone]
    rows["id"] = np.arange(len(rows))
    track, _, verdicts, estimator = run(rows, sensors=SWEEPING)
    gap = track["x"][:, :3] - small.truth(track["t_ns"] * 1e-9, **ROOM)[0]
    assert (np.abs(gap) < 5.0 * np.sqrt(np.diagonal(track["P"], axis1=1, axis2=2)[:, :3])).all()
    back = track["t_ns"] > 6.2e9
    assert np.linalg.norm(gap[back], axis=1).max() < 0.1
    assert not track["ambiguous"][track["t_ns"] > 7e9].any()
    best = estimator.smooth()
    assert np.linalg.norm(best["x"][:, :3] - small.truth(best["t_ns"] * 1e-9, **ROOM)[0], axis=1).max() < 0.3
    assert (finals(verdicts)["verdict"][rows["t_ns"] > 6e9] == USED).mean() > 0.97


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


def test_plain_ukf_takes_everything_and_a_gate_does_not():
    rows, bad = contaminated(4.0, share=0.02)
    settled = rows["t_ns"] > 1_500_000_000
    taken = finals(run(rows, method="ukf")[2])["verdict"]
    assert (taken[settled] == USED).all()
    gated = finals(run(rows, method="gate")[2])["verdict"]
    assert (gated[settled & bad] != USED).mean() > 0.6


@pytest.mark.parametrize("size", [10.0, 50.0, 500.0, 5000.0])
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
