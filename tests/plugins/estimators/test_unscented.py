"""The batched unscented filter: against FilterPy and Kalman, from wide priors, through faults."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import (
    NONE,
    Bearing,
    Filtered,
    Flight,
    Linear,
    Pair,
    apart,
    fly,
    nothing,
    pair_flight,
    run_filter,
    without,
)

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Estimator
from hillsphere.testing import example
from hillsphere_estimators.consistency import chi_square_band, mean_nis, nees
from hillsphere_estimators.sigma_points import SigmaRule
from hillsphere_estimators.specs import BatchedUnscentedSpec, SequentialUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented


def unscented_filter(**keys: Any) -> BatchedUnscented:
    return BatchedUnscented(BatchedUnscentedSpec(**keys))


@pytest.mark.parametrize(("alpha", "kappa"), [(1.0, 0.0), (0.5, 1.0), (0.1, 0.0)])
def test_equals_filterpy_on_the_same_stream(alpha: float, kappa: float) -> None:
    pytest.importorskip("filterpy")
    from hillsphere_estimators.sequential import SequentialUnscented

    spec = SequentialUnscentedSpec(alpha=alpha, kappa=kappa)
    flight = pair_flight(2, 12, share=1e-3, sigma=np.maximum(Pair.sigma, 5e-4))
    flight.sets[3] = without(flight.sets[3], np.arange(13)[:, None] % 5 == np.array([[2, 4]]))
    ours = run_filter(unscented_filter(alpha=alpha, kappa=kappa), Pair(), flight)
    theirs = run_filter(SequentialUnscented(spec), Pair(), flight)
    for one, other in zip(ours.after, theirs.after, strict=True):
        assert apart(one, other) < 1e-9
    for a, b in zip(ours.brought, theirs.brought, strict=True):
        np.testing.assert_allclose(a.nis, b.nis, rtol=1e-9)
        np.testing.assert_allclose(a.residual, b.residual, rtol=0, atol=1e-9)
        size = np.sqrt(np.diagonal(b.covariance, axis1=1, axis2=2))
        scaled = (a.covariance - b.covariance) / (size[:, :, None] * size[:, None])
        np.testing.assert_allclose(scaled, 0.0, rtol=0, atol=1e-9)


def test_sharp_measurements_cost_no_digits() -> None:
    """Against the textbook's form with 64 bits of mantissa; with 53 that form loses them."""
    flight = pair_flight(1, 8, share=1e-4)
    exact = in_long_doubles(flight)
    ours = run_filter(unscented_filter(), Pair(), flight)
    for k, (x, P) in enumerate(exact):
        assert apart(ours.after[k], Belief.of(x[:, None], P[None], flight.sets[k].t_s)) < 5e-10


def in_long_doubles(flight: Flight) -> list[tuple[Any, Any]]:
    """Run the plain filter, α = 1, κ = 0, β = 2, and return means and covariances."""
    model, n, long = Pair(), 12, np.longdouble
    x, P = flight.prior.x[:, 0].astype(long), flight.prior.covariance[0].astype(long)
    R = np.diag(Pair.sigma.astype(long) ** 2)
    weights = np.array([0.0, *[1.0 / 24.0] * 24], dtype=long)
    found = []

    def points() -> Any:
        steps = np.sqrt(long(n)) * factor(P)
        return np.concatenate([x[:, None], x[:, None] + steps, x[:, None] - steps], axis=1)

    def moments(z: Any) -> Any:
        mean = z @ weights
        off = z - mean[:, None]
        return mean, off, off * (weights + 2.0 * (np.arange(25) == 0))

    for k, measured in enumerate(flight.sets):
        if k:
            before, now = flight.sets[k - 1].t_s, measured.t_s
            G = model.process_noise(flight.prior.x, before, now, NONE)[0].astype(long)
            moved = model.advance(points(), before, now, NONE, np.zeros(25, dtype=int))
            x, off, weighted = moments(moved)
            P = weighted @ off.T + G @ G.T
        drawn = points()
        z, off, weighted = moments(model.observe(drawn, measured.t_s, np.zeros(25, dtype=int)))
        root = factor(weighted @ off.T + R)
        half = forward(root, (weighted @ (drawn - x[:, None]).T))
        x = x + half.T @ forward(root, (measured.values[:, 0] - z)[:, None])[:, 0]
        P = P - half.T @ half
        found.append((x.astype(float), P.astype(float)))
    return found


def factor(A: Any) -> Any:
    """Return Cholesky's factor, in the precision of A."""
    L = np.zeros_like(A)
    for j in range(len(A)):
        L[j:, j] = A[j:, j] - L[j:, :j] @ L[j, :j]
        L[j:, j] /= np.sqrt(L[j, j])
    return L


def forward(L: Any, b: Any) -> Any:
    """Return L⁻¹ b, in the precision of L."""
    y = np.zeros_like(b)
    for i in range(len(L)):
        y[i] = (b[i] - L[i, :i] @ y[:i]) / L[i, i]
    return y


@pytest.mark.parametrize("type_", ["unscented", "iterated_extended", "information", "ukf", "ekf"])
def test_equals_kalman_where_all_is_linear(type_: str) -> None:
    estimator: Estimator = example("estimator", type_)
    random = np.random.default_rng(2)
    F = np.eye(4) + np.diag([0.5, 0.5], 2)
    G = 0.1 * random.normal(size=(4, 2))
    H = random.normal(size=(2, 4))
    model, sigma = Linear(F, G, H), np.array([0.3, 0.7])
    flight = fly(model, random.normal(size=(4, 3)), np.full(4, 2.0), sigma, np.arange(30.0), 3)
    run = run_filter(estimator, model, flight)
    for case in range(3):
        x, P = flight.prior.x[:, case], flight.prior.covariance[case]
        for k, measured in enumerate(flight.sets):
            if k:
                x, P = F @ x, F @ P @ F.T + G @ G.T
            S = H @ P @ H.T + np.diag(sigma**2)
            K = P @ H.T @ np.linalg.inv(S)
            x = x + K @ (measured.values[:, case] - H @ x)
            P = (np.eye(4) - K @ H) @ P @ (np.eye(4) - K @ H).T + K @ np.diag(sigma**2) @ K.T
            size = np.sqrt(np.diag(P))
            np.testing.assert_allclose(run.after[k].x[:, case] / size, x / size, rtol=0, atol=1e-10)
            np.testing.assert_allclose(
                run.after[k].covariance[case] / np.outer(size, size),
                P / np.outer(size, size), rtol=0, atol=1e-10,
            )  # fmt: skip


def errors(run: Filtered, flight: Any) -> tuple[Array, Array]:
    """Return mean NEES and rms position of the first spacecraft at each time."""
    mean = [nees(b, x).mean() for b, x in zip(run.after, flight.truth, strict=True)]
    rms = [
        np.sqrt(np.mean(np.sum((b.x - x)[:3] ** 2, axis=0)))
        for b, x in zip(run.after, flight.truth, strict=True)
    ]
    return np.array(mean), np.array(rms)


def test_wide_prior_breaks_the_plain_update_and_not_the_others() -> None:
    flight = pair_flight(100, 8)
    plain, _ = errors(run_filter(unscented_filter(), Pair(), flight), flight)
    assert plain.min() > 1e3
    low, high = chi_square_band(12, 100, 0.99999)
    iterated, rms = errors(run_filter(unscented_filter(update="iterated"), Pair(), flight), flight)
    assert (low < iterated).all()
    assert (iterated < high).all()
    tempered, tempered_rms = errors(
        run_filter(unscented_filter(update="tempered"), Pair(), flight), flight
    )
    # what the powers leave of the curvature's error costs less than a fifth
    assert (tempered < 1.2 * high).all()
    np.testing.assert_allclose(tempered_rms, rms, rtol=0.25)


def test_few_powers_are_better_than_one() -> None:
    flight = pair_flight(60, 1)
    found = [
        np.median(
            nees(run_filter(unscented_filter(**keys), Pair(), flight).after[0], flight.truth[0])
        )
        for keys in ({}, {"update": "tempered", "powers": 4}, {"update": "tempered", "powers": 12})
    ]
    assert found[0] > 10.0 * found[1] > 10.0 * found[2]


def test_mean_innovations_lie_in_their_band() -> None:
    flight = pair_flight(100, 10)
    run = run_filter(unscented_filter(update="iterated"), Pair(), flight)
    found = mean_nis(run.brought[4:])
    assert found.inside.all()
    assert mean_nis(run.brought[4:], slice(10, 13)).inside.all()
    # a filter told of half the noise shows it
    quiet = [
        MeasurementSet(m.t_s, m.values, 0.5 * m.sigma, m.blocks, m.present) for m in flight.sets
    ]
    told = run_filter(
        unscented_filter(update="iterated"), Pair(), type(flight)(flight.truth, quiet, flight.prior)
    )
    assert not mean_nis(told.brought[4:]).inside.any()


def test_mean_innovations_of_nothing_are_nan() -> None:
    flight = pair_flight(2, 1)
    m = flight.sets[0]
    silent = MeasurementSet(m.t_s, m.values, 0.0 * m.sigma, m.blocks, np.zeros_like(m.present))
    _, brought = unscented_filter().update(Pair(), flight.prior, silent)
    found = mean_nis([brought])
    assert np.isnan(found.mean).all()
    assert found.inside.all()


def test_dropouts_and_outliers_are_survived() -> None:
    flight, random = pair_flight(50, 24, seed=5), np.random.default_rng(8)
    clean = errors(run_filter(unscented_filter(update="iterated"), Pair(), flight), flight)[1]
    for k, measured in enumerate(flight.sets):
        missing = np.repeat(random.random((5, 50)) < 0.3, [2, 3, 2, 3, 3], axis=0)
        wild = np.repeat(random.random((5, 50)) < 0.02, [2, 3, 2, 3, 3], axis=0) & (k > 4)
        values = measured.values + np.where(wild, 30.0 * measured.sigma, 0.0)
        flight.sets[k] = without(
            MeasurementSet(measured.t_s, values, measured.sigma, measured.blocks, measured.present),
            missing,
        )
    gated = run_filter(unscented_filter(update="iterated", gate_sigmas=5), Pair(), flight)
    open_ = run_filter(unscented_filter(update="iterated"), Pair(), flight)
    mean, rms = errors(gated, flight)
    assert rms[-10:].mean() < 1.6 * clean[-10:].mean()
    assert mean[-10:].max() < 2.0 * 12.0
    assert errors(open_, flight)[0][-10:].min() > 5.0 * 12.0
    assert errors(open_, flight)[1][-10:].mean() > 1.5 * rms[-10:].mean()


def test_gate_leaves_out_whole_blocks_and_counts_them() -> None:
    flight = pair_flight(3, 6)
    run = run_filter(unscented_filter(update="iterated"), Pair(), flight)
    prior, last = run.before[-1], flight.sets[-1]
    values = last.values.copy()
    values[2, 1] += 30.0 * last.sigma[2, 1]
    wild = MeasurementSet(last.t_s, values, last.sigma, last.blocks, last.present)
    estimator = unscented_filter(gate_sigmas=5)
    after, brought = estimator.update(Pair(), prior, wild)
    np.testing.assert_array_equal(brought.dof, [13, 10, 13])
    np.testing.assert_array_equal(np.flatnonzero(~brought.used[:, 1]), [2, 3, 4])
    missing = np.zeros((13, 3), dtype=bool)
    missing[2:5, 1] = True
    plain, _ = unscented_filter().update(Pair(), prior, without(last, missing))
    assert apart(after, plain) < 1e-12


def test_every_sensor_lost_for_a_day_and_back() -> None:
    flight = pair_flight(40, 40)
    for k in range(8, 32):
        flight.sets[k] = without(flight.sets[k], np.ones((13, 1), dtype=bool))
    run = run_filter(unscented_filter(update="iterated", gate_sigmas=5), Pair(), flight)
    sigma = np.array([b.sigma[:3].max() for b in run.after])
    assert (np.diff(sigma[8:32]) > 0.0).all()
    assert sigma[31] > 4.0 * sigma[7]
    mean, rms = errors(run, flight)
    low, high = chi_square_band(12, 40, 0.99999)
    assert low < mean[31] < high
    assert low < mean[-1] < high
    assert rms[-1] < 2.0 * rms[7]
    # a belief as wide as these is no measure of what is measured: the gate stands open
    for k in (0, 32):
        np.testing.assert_array_equal(run.brought[k].dof, 13)


@pytest.mark.parametrize("update", ["plain", "tempered", "iterated"])
def test_case_does_not_feel_its_neighbours(update: str) -> None:
    flight = pair_flight(5, 1)
    estimator = unscented_filter(update=update, gate_sigmas=5)
    together, _ = estimator.update(Pair(), flight.prior, flight.sets[0])
    for k in range(5):
        own = slice(k, k + 1)
        prior = Belief(flight.prior.x[:, own], flight.prior.root[own], flight.prior.t_s[own])
        m = flight.sets[0]
        alone, _ = estimator.update(
            Pair(), prior,
            MeasurementSet(m.t_s[own], m.values[:, own], m.sigma[:, own], m.blocks,
                           m.present[:, own]),
        )  # fmt: skip
        kept = Belief(together.x[:, own], together.root[own], together.t_s[own])
        assert apart(alone, kept) < 1e-9


def test_directions_know_no_turn_nor_pole() -> None:
    """The same belief and measurement, turned about: the same belief, turned about."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    covariance = np.diag([4.0, 1.0, 9.0])
    sigma = np.array([1e-3, 1e-3, 1e-3, 0.5])[:, None]
    found = []
    for axes in (np.eye(3), turn):
        x = axes @ np.array([[3.0], [4.0], [-100.0]])
        seen = axes @ np.array([[3.5], [3.0], [-102.0]])
        prior = Belief.of(x, (axes @ covariance @ axes.T)[None], np.zeros(1))
        z = Bearing().observe(seen, np.zeros(1), np.zeros(1, dtype=int))
        measured = MeasurementSet.of(np.zeros(1), z, sigma, Bearing.blocks)
        # with κ = 3 − n sigma points in other axes give the same up to the third order
        after, brought = unscented_filter(update="iterated", iterations=50).update(
            Bearing(), prior, measured
        )
        found.append((axes.T @ after.x, axes.T @ after.covariance[0] @ axes, brought))
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=0, atol=2e-3)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=0, atol=2e-3)
    assert found[0][2].dof == found[1][2].dof == 3
    np.testing.assert_allclose(found[0][2].nis, found[1][2].nis, rtol=1e-2)
    # the measurement is far better than the prior
    np.testing.assert_allclose(found[0][0][:, 0], [3.5, 3.0, -102.0], rtol=0, atol=0.5)


class Held(Linear):
    considered = np.array([False, False, True])


def test_considered_states_as_by_schmidt() -> None:
    random = np.random.default_rng(5)
    A = random.normal(size=(3, 3))
    P, H, R = A @ A.T + np.eye(3), random.normal(size=(2, 3)), np.diag([0.04, 0.09])
    x, z = random.normal(size=3), random.normal(size=2)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    K[2] = 0.0
    expected = (np.eye(3) - K @ H) @ P @ (np.eye(3) - K @ H).T + K @ R @ K.T
    model = Held(np.eye(3), np.zeros((3, 1)), H)
    prior = Belief.of(x[:, None], P[None], np.zeros(1))
    measured = MeasurementSet.of(np.zeros(1), z[:, None], np.array([[0.2], [0.3]]), model.blocks)
    for estimator in (
        unscented_filter(),
        unscented_filter(update="iterated"),
        example("estimator", "iterated_extended"),
        example("estimator", "information"),
    ):
        after, _ = estimator.update(model, prior, measured)
        np.testing.assert_allclose(after.x[:, 0], x + K @ (z - H @ x), rtol=0, atol=1e-12)
        np.testing.assert_allclose(after.covariance[0], expected, rtol=0, atol=1e-12)
    for type_ in ("ukf", "ekf"):
        with pytest.raises(InputError, match="considered"):
            example("estimator", type_).update(model, prior, measured)


def test_states_known_exactly_stay_so() -> None:
    model = Linear(np.eye(2), np.zeros((2, 1)), np.array([[1.0, 1.0]]))
    root = np.array([[[2.0, 0.0], [0.0, 0.0]]])
    prior = Belief(np.array([[1.0], [5.0]]), root, np.zeros(1))
    measured = MeasurementSet.of(np.zeros(1), np.array([[8.0]]), np.ones((1, 1)), model.blocks)
    for update in ("plain", "iterated", "tempered"):
        after, _ = unscented_filter(update=update).update(model, prior, measured)
        np.testing.assert_allclose(after.x[:, 0], [1.0 + 0.8 * 2.0, 5.0], rtol=1e-12)
        np.testing.assert_allclose(after.covariance[0], np.diag([0.8, 0.0]), rtol=0, atol=1e-12)


def test_filterpy_that_is_absent_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "filterpy.kalman", None)
    flight = pair_flight(1, 1)
    with pytest.raises(InputError, match=r"pip install 'filterpy>=2\.0'"):
        example("estimator", "ukf").update(Pair(), flight.prior, flight.sets[0])


def test_refuses_a_reach_that_is_none() -> None:
    with pytest.raises(InputError, match="kappa > -12"):
        SigmaRule(kappa=-12.0).reach(12)


def positive_definite(steps: int) -> None:
    flight = pair_flight(1, 2, period_s=600.0)
    random, model, estimator = np.random.default_rng(9), Pair(), unscented_filter(gate_sigmas=5)
    belief = run_filter(unscented_filter(update="iterated"), model, flight).after[-1]
    x, t_s = flight.truth[-1], flight.sets[-1].t_s
    for k in range(steps):
        later = t_s + 600.0
        noise = model.process_noise(x, t_s, later, nothing(1))
        x = model.advance(x, t_s, later, nothing(1), np.zeros(1, dtype=int))
        x = x + noise[0] @ random.normal(size=(12, 1))
        # pulled back, so that it stays where it is seen
        x[3:6] -= 1e-4 * (x[:3] - Pair.start[:3, None]) / 600.0
        belief = estimator.predict(model, belief, later, nothing(1))
        z = model.observe(x, later, np.zeros(1, dtype=int))
        z += Pair.sigma[:, None] * random.normal(size=z.shape)
        measured = MeasurementSet.of(later, z, Pair.sigma[:, None], Pair.blocks)
        belief, _ = estimator.update(model, belief, measured)
        t_s = later
        assert np.diagonal(belief.root[0]).min() > 0.0, k
    scaled = belief.covariance[0] / np.outer(belief.sigma, belief.sigma)
    assert np.linalg.eigvalsh(scaled)[0] > 0.0


def test_covariance_stays_positive_definite() -> None:
    positive_definite(300)


@pytest.mark.slow
def test_covariance_stays_positive_definite_for_long() -> None:
    positive_definite(100_000)
