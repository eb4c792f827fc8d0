"""The passes against dense Gaussian conditioning, rows left out one by one, and differences."""

import numpy as np
import pytest

from filters.models import runs, state
from filters.models.motion import CORE
from filters.models.rows import E
from filters.smoother import passes
from tests.filters.smoother.kit import small

pytestmark = pytest.mark.decision

WEIGHTS = {
    "all used": lambda k: np.ones(k),
    "some refused": lambda k: (np.arange(k) % 3 != 1).astype(float),
    "between": lambda k: np.linspace(0.1, 1.0, k),
    "every kind": lambda k: np.array([1.0, 0.0, 0.3])[np.arange(k) % 3],
    "none used": lambda k: np.zeros(k),
}


def both(model, rows, x, P, weight, psd=small.PSD, noise=None, keep=None, factor=1.0):
    """(own, trace, scores, r, N) after one pass forward and backward; ``factor`` as in `small.densities`."""
    own = small.fresh(rows)
    own.weight[:] = weight
    if noise is not None:
        own.noise[:] = noise
    n, k = len(x), len(rows.t)
    keep = k if keep is None else keep
    out, found = passes.trace(k, n, k), passes.scores(n)
    work, r, N = state.scratch(n), np.zeros(n), np.zeros((n, n))
    densities = small.densities(model, psd, factor)[None]
    head_x, head_P = x.copy(), P.copy()
    passes.forward(model, rows, own, densities, head_x, head_P, int(rows.t[0]), keep, out, work)
    passes.backward(model, rows, own, densities, keep, out, r, N, found, work)
    return own, out, found, head_x, head_P


def in_use(own):
    return np.flatnonzero(own.weight > 0), own.noise / np.maximum(own.weight, 1e-30)


def assert_same_states(batch, rows, out, head_x, head_P, atol):
    """``batch``: mean and covariance of all states; they are those smoothed in ``out``, and the head's."""
    (mean, cov), n = batch, len(head_x)
    for e, t in enumerate(np.unique(rows.t)):
        first, at = np.searchsorted(rows.t, t), slice(e * n, (e + 1) * n)
        assert np.allclose(out.x[first], mean[at], atol=atol)
        assert np.allclose(out.P[first][:CORE, :CORE], cov[at, at][:CORE, :CORE], atol=atol)
    assert np.allclose(head_x, mean[-n:], atol=atol)
    assert np.allclose(head_P, cov[-n:, -n:], atol=atol)


def slow_case(seed=0):
    """(model, rows, x, P, H, rows as coordinates, (n − 9,) factors), the errors' factors far from 1."""
    case = small.ranging_case(seed)
    factor = np.exp(np.random.default_rng(seed + 50).uniform(-3.0, 3.0, len(case[2]) - CORE))
    return *case, factor


@pytest.mark.parametrize("kind", WEIGHTS)
def test_deletion_residuals_are_those_of_leaving_one_row_out(kind):
    model, rows, x, P, H = small.linear_case()
    own, *_ = both(model, rows, x, P, WEIGHTS[kind](len(rows.t)))
    dense, (use, noise) = small.Dense(model, rows, x, P, small.PSD, H), in_use(own)
    for k in range(len(rows.t)):
        residual, sigma = dense.left_out(k, use, noise, own.noise[k])
        assert own.residual[k] == pytest.approx(residual, abs=1e-6)
        assert own.sigma[k] == pytest.approx(sigma, rel=1e-7)


@pytest.mark.parametrize("kind", WEIGHTS)
def test_smoothed_states_are_the_batch_solution(kind):
    model, rows, x, P, H = small.linear_case(1)
    own, out, _, head_x, head_P = both(model, rows, x, P, WEIGHTS[kind](len(rows.t)))
    dense = small.Dense(model, rows, x, P, small.PSD, H)
    assert_same_states(dense.given(*in_use(own)), rows, out, head_x, head_P, atol=1e-7)


@pytest.mark.parametrize("kind", WEIGHTS)
def test_slow_errors_of_any_factor_are_followed_as_in_the_batch_solution(kind):
    model, rows, x, P, H, near, factor = slow_case()
    own, out, _, head_x, head_P = both(model, rows, x, P, WEIGHTS[kind](len(rows.t)), factor=factor)
    dense = small.Dense(model, near, x, P, small.densities(model, factor=factor), H)
    use, noise = in_use(own)
    assert_same_states(dense.given(use, noise), rows, out, head_x, head_P, atol=1e-4)
    for k in range(len(rows.t)):
        residual, sigma = dense.left_out(k, use, noise, own.noise[k])
        assert own.residual[k] == pytest.approx(residual, abs=1e-4)
        assert own.sigma[k] == pytest.approx(sigma, rel=1e-5)


@pytest.mark.parametrize(
    "prior_m",
    [
        1e2,
        1e3,
        pytest.param(
            1e5,
            marks=pytest.mark.xfail(
                strict=True, reason="P − P N P cancels: N is not known to 1 / P², as that needs"
            ),
        ),
    ],
)
def test_deletion_residuals_and_smoothed_states_after_a_start(prior_m):
    """Five positions at one instant, the first one refused: closed form, however little was known before."""
    model = state.build([small.ins(str(s), p=1.0) for s in range(5)])
    values = np.random.default_rng(0).normal(size=5)
    rows = small.as_rows([(0.0, s, E, value) for s, value in enumerate(values)], model)
    x, P = np.zeros(len(model.prior)), state.prior_covariance(model)
    P[range(CORE), range(CORE)] = prior_m**2
    own, out, *_ = both(model, rows, x, P, np.array([0.0, 1, 1, 1, 1]))
    each = 1.0 + model.prior[model.bias_at[0, E]]
    place = 1.0 / (prior_m**-2 + 4.0 / each)
    assert own.sigma[0] == pytest.approx(np.sqrt(place + each), rel=1e-3)
    assert own.residual[0] == pytest.approx(values[0] - place / each * values[1:].sum(), abs=1e-5)
    assert out.P[0][0, 0] == pytest.approx(place, rel=1e-3)


def test_only_the_kept_rows_states_are_smoothed():
    model, rows, x, P, _ = small.linear_case(2)
    whole = both(model, rows, x, P, 1.0)
    some = both(model, rows, x, P, 1.0, keep=8)
    assert np.array_equal(whole[1].x[:8], some[1].x[:8])
    assert not some[1].x[8:].any()
    assert np.array_equal(whole[0].residual, some[0].residual)
    first = both(model, rows, x, P, 1.0, keep=0)
    assert not first[2].kept.any()
    for found in (some[2], whole[2]):
        assert np.allclose(found.kept[0] + found.rest, first[2].rest, rtol=1e-12)
    assert some[2].kept[0].all()


def test_the_slope_by_the_motion_densities_is_that_of_the_log_likelihood():
    model, rows, x, P, H = small.linear_case(3)
    own, _, found, *_ = both(model, rows, x, P, WEIGHTS["between"](len(rows.t)))
    _, noise = in_use(own)
    h = 1e-4
    for j in range(4):
        up, down = (
            small.Dense(model, rows, x, P, small.PSD * np.exp(sign * h * np.eye(4)[j]), H).log_density(noise)
            for sign in (1, -1)
        )
        assert found.kept[0, 0, j] == pytest.approx((up - down) / (2 * h), abs=2e-5)


def test_kept_rows_speak_of_the_densities_of_their_own_regime():
    model, rows, x, P, _ = small.linear_case(2)
    k, n = len(rows.t), len(x)
    calm = both(model, rows, x, P, 1.0, keep=k)[2]
    own = small.fresh(rows)
    own.regime[: k // 2] = 1
    out, found = passes.trace(k, n, k), passes.scores(n)
    work, twice = state.scratch(n), np.tile(small.densities(model), (2, 1))
    passes.forward(model, rows, own, twice, x.copy(), P.copy(), int(rows.t[0]), k, out, work)
    passes.backward(model, rows, own, twice, k, out, np.zeros(n), np.zeros((n, n)), found, work)
    assert found.kept[:, 1].all()
    assert np.allclose(found.kept.sum(axis=0), calm.kept[0], rtol=1e-9)
    assert not found.rest.any()


def test_expected_information_is_positive_and_never_more_than_fishers():
    """Each row's and each step's own share of ½ tr(Σ⁻¹ ∂Σ Σ⁻¹ ∂Σ); products of two are not negative."""
    model, rows, x, P, H = small.linear_case(5)
    own, _, found, *_ = both(model, rows, x, P, 1.0)

    def covariance(psd, noise):
        return small.Dense(model, rows, x, P, psd, H).rows(noise)[1]

    S, h = covariance(small.PSD, own.noise), 1e-3

    def fisher(up, down):
        A = np.linalg.solve(S, (up - down) / (2 * h))
        return 0.5 * np.trace(A @ A)

    for j in range(4):
        one = h * np.eye(4)[j]
        full = fisher(*(covariance(small.PSD * np.exp(one * sign), own.noise) for sign in (1, -1)))
        assert 0.0 < found.kept[0, 1, j] <= full * (1 + 1e-6)


def test_what_has_moved_a_prediction_is_what_others_said_since():
    """Innovations of a channel that is not used differ by it, and by what the target does."""
    model, rows, x, P, H = small.linear_case(8)
    _, out, *_ = both(model, rows, x, P, 1.0)
    for k, c in enumerate(rows.channel):
        before = np.flatnonzero(rows.channel[:k] == c)
        if not len(before):
            assert out.moved[k] == 0.0
            assert out.fresh[k] == pytest.approx(runs.FRESH * (out.S[k] - rows.stated[k]))
            continue
        F, _ = small.transition((rows.t[k] - rows.t[before[-1]]) * 1e-9, small.PSD, model)
        then = out.at[before[-1]]
        learned = np.linalg.solve(F, out.at[k]) - then
        learned[CORE:] = (out.at[k] - F @ then)[CORE:]
        assert out.moved[k] == pytest.approx(H[k] @ learned)
        assert out.fresh[k] > 0.0
    untouched = both(model, rows, x, P, 0.0)[1]
    assert untouched.moved == pytest.approx(0.0, abs=1e-9)


def test_what_may_have_moved_since_is_counted_entry_by_entry():
    """hᵀ((F − I) P (F − I)ᵀ + Q) h of each entry by itself, of slow errors their noise by its factor."""
    model, rows, x, P, H, _, factor = slow_case(1)
    densities = small.densities(model, factor=factor)
    _, out, *_ = both(model, rows, x, P, 0.0, factor=factor)
    for k in range(len(rows.t)):
        before = np.flatnonzero((rows.channel[:k] == rows.channel[k]) & (rows.sensor[:k] == rows.sensor[k]))
        if not len(before):
            continue
        F, Q = small.transition((rows.t[k] - rows.t[before[-1]]) * 1e-9, densities, model)
        ahead, at = P.copy(), rows.t[0]
        for t in np.unique(rows.t[: k + 1]):
            step, noise = small.transition((t - at) * 1e-9, densities, model)
            ahead, at = step @ ahead @ step.T + noise, t
        rest = F - np.eye(len(x))
        moved = rest @ ahead @ rest.T
        moved[CORE:, CORE:] = 0.0  # of an error what is left of it is in the prediction, see ``moved``
        assert out.fresh[k] == pytest.approx(H[k] ** 2 @ np.diag(moved + Q), rel=1e-5)
        assert out.moved[k] == pytest.approx(0.0, abs=1e-4)


def test_a_regime_drives_the_motion_on_the_way_to_its_rows():
    model, rows, x, P, _H = small.linear_case(6)
    own, n = small.fresh(rows), len(x)
    own.regime[rows.t >= rows.t[8]] = 1
    densities = np.array([small.densities(model, psd) for psd in (small.PSD, 100.0 * small.PSD)])
    at, out = int(rows.t[0]), passes.trace(len(rows.t), n, 1)
    x_, P_ = x.copy(), P.copy()
    passes.forward(model, rows, own, densities, x_, P_, at, 0, out, state.scratch(n))
    before, after = rows.t < rows.t[8], rows.t >= rows.t[8]

    def part(use, x, P, at, psd):
        some = type(rows)(*(column[use] for column in rows))
        own, out = small.fresh(some), passes.trace(use.sum(), n, 1)
        passes.forward(model, some, own, np.array([psd]), x, P, at, 0, out, state.scratch(n))

    part(before, x, P, at, densities[0])
    part(after, x, P, int(rows.t[before][-1]), densities[1])
    assert np.allclose(x, x_, atol=1e-12)
    assert np.allclose(P, P_, atol=1e-12)
