"""The estimator as a whole: nothing lost, order and batches do not matter, no noise means no error."""

import numpy as np
import pytest

from filters.methods import make
from filters.models import model
from filters.models.rows import CHANNELS, DUPLICATE, INVALID, LATE, ROW
from filters.simulation import scenario, simulate
from filters.window import passes as window
from filters.window.outlier import REASONS
from tests.filters import full_ukf
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
    whole, smoothed, _ = run(make("default", used), rows)
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


def test_smoothing_equals_the_textbook_on_a_linear_problem():
    """Deletion residuals and smoothed states by brute force: one big joint Gaussian, row by row."""
    rng = np.random.default_rng(0)
    used = sensors(["ins"])
    built = model.build(used, 10.0, 2.5, 90.0)
    built = built._replace(bias_at=np.full_like(built.bias_at, -1), clock_at=np.full_like(built.clock_at, -1))
    n, rows = len(built.prior), 12
    given = window.Given(
        t=np.arange(rows) // 3 * 100_000_000,
        sensor=np.zeros(rows, np.int64),
        channel=np.tile([4, 8, 12], 4),
        value=rng.normal(size=rows),
        noise=np.full(rows, 0.5),
        jerk=np.full(rows, 10.0),
        weight=np.where(np.arange(rows) == 7, 0.0, 1.0),
    )
    x0, P0 = np.zeros(n), np.diag(np.r_[np.ones(9), built.prior[9:]])
    out, work = window.trace(rows, n, rows), model.scratch(n)
    window.ahead(built, given, 0, rows, x0.copy(), P0.copy(), 0, out, work)
    window.back(built, given, 0, rows, out, np.zeros(n), np.zeros((n, n)), work)
    F, Q = full_ukf.transition(0.1)
    blocks = [P0[:9, :9]]
    for _ in range(3):
        blocks.append(F @ blocks[-1] @ F.T + 10.0 * Q)
    joint = np.zeros((36, 36))
    for i in range(4):
        for j in range(i, 4):
            joint[9 * i : 9 * i + 9, 9 * j : 9 * j + 9] = blocks[i] @ np.linalg.matrix_power(F, j - i).T
    joint = np.triu(joint) + np.triu(joint, 1).T
    for i in range(4):
        joint[9 * i : 9 * i + 9, 9 * i : 9 * i + 9] = blocks[i]
    H = np.zeros((rows, 36))
    H[np.arange(rows), 9 * (np.arange(rows) // 3) + np.tile([0, 4, 8], 4)] = 1.0
    for row in range(rows):
        others = (np.arange(rows) != row) & (given.weight > 0)
        K = joint @ H[others].T @ np.linalg.inv(H[others] @ joint @ H[others].T + 0.5 * np.eye(others.sum()))
        x, P = K @ given.value[others], joint - K @ H[others] @ joint
        assert out.off[row] == pytest.approx(given.value[row] - H[row] @ x)
        assert out.sigma[row] ** 2 == pytest.approx(H[row] @ P @ H[row] + 0.5)
    K = joint @ H[given.weight > 0].T
    K = K @ np.linalg.inv(H[given.weight > 0] @ K + 0.5 * np.eye(11))
    x, P = K @ given.value[given.weight > 0], joint - K @ H[given.weight > 0] @ joint
    for epoch in range(4):
        part = slice(9 * epoch, 9 * epoch + 9)
        assert np.allclose(out.x[3 * epoch, :9], x[part])
        assert np.allclose(out.P[3 * epoch, :9, :9], P[part, part])


@pytest.mark.parametrize("kind", ["offset", "frozen", "noise"])
def test_a_long_patch_on_one_theodolite_is_left_out(kind):
    truth, used, rows, labels = scene(9, seconds=25.0, patch=(kind, "theo-a", 12.0, 8.0, 30.0))
    best = oracle(used, rows, labels)[1]
    track, *_ = run(make("default", used), rows)
    mine, told = (np.sqrt(np.mean(error_m(t, truth, 12.0) ** 2)) for t in (track, best))
    assert mine < 2.0 * told


def test_systematic_errors_are_recovered_within_their_sigma():
    wrong = simulate.InstrumentErrors(zero=(5.0, np.radians(0.05), 0.0, 0.0), clock_offset_s=0.12)
    _, used, rows, _ = scene(10, seconds=60.0, estimate=("bias", "clock"), errors={"theo-a": wrong})
    estimator = make("default", used)
    run(estimator, rows)
    found = estimator.report()["sensors"]["theo-a"]["errors"]
    for name, true in {"range": 5.0, "azimuth": np.radians(0.05), "elevation": 0.0, "clock": 0.12}.items():
        assert abs(found[name]["value"] - true) < 3.5 * found[name]["sigma"]


def test_total_disagreement_begins_again_and_says_so():
    _, used, rows, _ = scene(11, seconds=20.0, level="gentle")
    later = rows["t_ns"] > simulate.T0_NS + 10 * 10**9
    _, _, elsewhere, _ = scene(12, seconds=20.0, level="gentle", start=(400.0, 300.0, 200.0))
    there = elsewhere["t_ns"] > simulate.T0_NS + 10 * 10**9
    jump = np.concatenate([rows[~later], elsewhere[there]])
    jump["id"] = np.arange(len(jump))
    estimator = make("default", used)
    track, *_ = run(estimator, jump)
    assert track["reset_counter"][-1] == 1
    assert "refused" in estimator.report()["resets"][0]["reason"]


def test_a_run_that_only_one_other_contradicts_is_ambiguous():
    _, used, rows, _ = scene(
        13, seconds=20.0, names=("ins", "theo-a"), patch=("offset", "theo-a", 12.0, 1.0, 60.0)
    )
    *_, verdicts = run(make("default", used), rows)
    assert REASONS.index("ambiguous") in verdicts["reason"]


def test_an_abrupt_motion_is_no_outlier():
    """The vehicle's velocity changes by 8 m/s within a tenth of a second; every sensor sees it."""
    _, used, rows, _ = scene(14, seconds=16.0, level="hover")
    begin_ns = simulate.T0_NS + 10 * 10**9
    late_s = (rows["t_ns"] - begin_ns) * 1e-9
    truth, *_ = scene(14, seconds=16.0, level="hover")
    push = np.clip(late_s, 0.0, 0.1)
    climb_m = 40.0 * push**2 + 8.0 * np.clip(late_s - 0.1, 0.0, None)
    t_s = (rows["t_ns"] - simulate.T0_NS) * 1e-9
    p, v, _ = scenario.at(truth, t_s)
    up = np.column_stack([np.zeros_like(climb_m), np.zeros_like(climb_m), climb_m])
    rise = np.column_stack([np.zeros_like(push), np.zeros_like(push), 80.0 * push])
    for s, sensor in enumerate(used):
        mine = rows["sensor"] == s
        for c in np.unique(rows["channel"][mine]):
            here = np.flatnonzero(mine & (rows["channel"] == c))
            if sensor.kind == "ins":
                extra = {6: climb_m, 9: 80.0 * push, 12: np.where((late_s > 0.0) & (late_s < 0.1), 80.0, 0.0)}
                rows["value"][here] += extra.get(int(c), np.zeros(len(rows)))[here]
                continue
            was, now = (polar(q[here] - sensor.offset_m, w[here], c) for q, w in ((p, v), (p + up, v + rise)))
            rows["value"][here] += now - was
    track, *_ = run(make("default", used), rows)
    t_s = (track["t_ns"] - begin_ns) * 1e-9
    truth_m = scenario.at(truth, t_s + 10.0)[0]
    truth_m[:, 2] += 40.0 * np.clip(t_s, 0.0, 0.1) ** 2 + 8.0 * np.clip(t_s - 0.1, 0.0, None)
    after = (t_s > 0.0) & (t_s < 3.0)
    assert np.linalg.norm(track["x"][after, :3] - truth_m[after], axis=1).max() < 2.0


def polar(p, v, channel):
    """Range, azimuth, elevation or range rate of positions (k, 3), as a textbook has them."""
    distance = np.linalg.norm(p, axis=1)
    if channel == 3:
        return (p * v).sum(axis=1) / distance
    return (distance, np.arctan2(p[:, 0], p[:, 1]), np.arcsin(p[:, 2] / distance))[channel]


def test_a_correction_is_told_the_prediction_even_where_the_window_was_decided_again():
    _, used, rows, _ = scene(3, seconds=8.0, share=0.15)
    apart = []

    def spy(x0, P0, x1, P1):
        apart.append(np.linalg.norm(x0[:3] - x1[:3]))
        return x1

    make("default", used, correction=spy).step(rows)
    assert np.max(apart[50:]) < 3.0  # a state of the window's beginning would be a second's flight away
