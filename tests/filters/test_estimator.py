"""The estimator as a whole: nothing lost, order and batches do not matter, no noise means no error."""

import numpy as np
import pytest

from filters import simulate
from filters.estimator import make
from filters.rows import CHANNELS, DUPLICATE, INVALID, LATE, ROW
from tests.filters.scenes import error_m, oracle, run, scene, sensors


def test_unknown_method_lists_the_known():
    with pytest.raises(ValueError, match=r"default.*ukf"):
        make("nonsense", sensors())


def test_every_row_gets_exactly_one_final_verdict():
    _, used, rows, _ = scene(1, share=0.04, seconds=15)
    *_, verdicts = run(make("default", used), rows)
    assert np.array_equal(verdicts["id"], rows["id"])


def test_bad_rows_get_their_word():
    _, used, rows, _ = scene(2, seconds=5)
    bad = np.zeros(4, ROW)
    bad["id"] = range(len(rows), len(rows) + 4)
    bad["t_ns"] = rows["t_ns"][-1]
    bad[0] = (len(rows), rows["t_ns"][-1], 1, 0, np.nan)
    bad[1] = (len(rows) + 1, rows["t_ns"][-1], 1, CHANNELS.index("range_rate"), 1.0)
    bad[2] = (len(rows) + 2, *list(rows[-1])[1:])
    bad[3] = (len(rows) + 3, rows["t_ns"][0], 1, 0, 1000.0)
    estimator = make("default", used)
    estimator.step(rows)
    step = estimator.step(bad)
    words = {int(v["id"]) - len(rows): int(v["verdict"]) for v in step.verdicts if v["id"] >= len(rows)}
    assert words == {0: INVALID, 1: INVALID, 2: DUPLICATE, 3: LATE}


def test_batches_do_not_matter():
    _, used, rows, _ = scene(3, share=0.04, seconds=15)
    whole, smoothed, verdicts = run(make("default", used), rows)
    for batch in (37, 400):
        ends = np.flatnonzero(np.diff(rows["t_ns"])) + 1
        cuts = ends[batch // 4 :: max(1, batch // 4)]
        estimator = make("default", used)
        steps = [estimator.step(part) for part in np.split(rows, cuts)] + [estimator.finish()]
        assert np.array_equal(np.concatenate([s.track for s in steps]), whole)
        assert np.array_equal(np.concatenate([s.smoothed for s in steps]), smoothed)


def test_late_rows_end_in_the_same_track():
    _, used, rows, _ = scene(4, share=0.04, seconds=12)
    _, smoothed, verdicts = run(make("default", used), rows)
    rng = np.random.default_rng(0)
    delay = np.where(rng.random(len(rows)) < 0.1, rng.uniform(0, 0.8e9, len(rows)), 0).astype(int)
    late = rows[np.argsort(rows["t_ns"] + delay, kind="stable")]
    _, late_smoothed, late_verdicts = run(make("default", used), late, batch=50)
    assert np.array_equal(late_smoothed, smoothed)
    assert np.array_equal(late_verdicts["weight"], verdicts["weight"])


@pytest.mark.parametrize(
    "names", [("ins",), ("theo-a",), ("theo-a", "theo-b"), ("ins", "theo-a", "theo-b", "radar")]
)
def test_any_sensor_set_follows(names):
    truth, used, rows, _ = scene(5, seconds=20, level="gentle", names=names)
    track, *_ = run(make("default", used), rows)
    assert error_m(track, truth).max() < (10.0 if names == ("ins",) else 5.0)


def test_without_noise_there_is_no_error():
    truth, used, rows, _ = scene(6, seconds=20, level="gentle", names=("theo-a", "theo-b"))
    for s, sensor in enumerate(used):
        seen = simulate.instrument(truth, sensor, 20.0, np.random.default_rng(0))
        for c in range(3):
            mine = np.flatnonzero((rows["sensor"] == s) & (rows["channel"] == c))
            rows["t_ns"][mine], rows["value"][mine] = seen.t_ns, seen.clean[:, c]
    rows = np.sort(rows, order=["t_ns", "sensor", "channel"])
    estimator = make("default", used)
    run(estimator, rows)
    assert error_m(estimator.smooth(), truth).max() < 0.05


def test_covariance_stays_symmetric_and_positive():
    _, used, rows, _ = scene(7, share=0.15, seconds=20, estimate=("bias", "clock"))
    track, smoothed, _ = run(make("default", used), rows)
    for P in (*track["P"], *smoothed["P"]):
        assert np.array_equal(P, P.T)
        assert np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(P), np.diag(P)))).min() > 0


def test_four_percent_outliers_cost_next_to_nothing():
    truth, used, rows, labels = scene(8, share=0.04)
    best = oracle(used, rows, labels)[1]
    track, *_ = run(make("default", used), rows)
    assert np.sqrt(np.mean(error_m(track, truth) ** 2)) < 1.3 * np.sqrt(np.mean(error_m(best, truth) ** 2))
