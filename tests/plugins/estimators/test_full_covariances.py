"""Measurements with full covariances, beside the dense Kalman filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import Bearing, Linear, nothing

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel
from hillsphere.testing import example
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.consistency import mean_nis
from hillsphere_estimators.cramer_rao import cramer_rao
from hillsphere_estimators.observability import observability
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented

TYPES = ["unscented", "iterated_extended", "information", "ukf", "ekf"]
RANDOM = np.random.default_rng(3)
H = RANDOM.normal(size=(3, 2))
MODEL = Linear(np.array([[1.0, 0.4], [-0.1, 0.9]]), np.zeros((2, 1)), H)
"""Three rows in two blocks below: the errors of different sensors are correlated as well."""
MODEL.blocks = ((Channel("a", "m"), Channel("b", "m")), (Channel("c", "m"),))  # type: ignore[assignment]
_A = RANDOM.normal(size=(3, 3))
R = 0.01 * (_A @ _A.T + 0.1 * np.eye(3))
P = np.array([[4.0, 1.0], [1.0, 2.0]])


def start(cases: int) -> Belief:
    return Belief.of(RANDOM.normal(size=(2, cases)), np.repeat(P[None], cases, 0), np.zeros(cases))


def measure(z: Array, t_s: float = 0.0) -> MeasurementSet:
    return MeasurementSet.of(np.full(z.shape[1], t_s), z, R[None], MODEL.blocks)


def kalman(x: Array, z: Array) -> tuple[Array, Array, float]:
    """Return mean, covariance and NIS after a measurement, without the rows that are NaN."""
    rows = np.flatnonzero(~np.isnan(z))
    h, r = H[rows], R[np.ix_(rows, rows)]
    S = h @ P @ h.T + r
    K, off = P @ h.T @ np.linalg.inv(S), z[rows] - h @ x
    return x + K @ off, P - K @ S @ K.T, float(off @ np.linalg.solve(S, off))


@pytest.mark.parametrize("type_", TYPES)
def test_updates_are_kalmans_with_any_rows_missing(type_: str) -> None:
    prior = start(8)
    z = RANDOM.normal(size=(3, 8))
    z[(np.arange(8) >> np.arange(3)[:, None]) % 2 == 1] = np.nan
    after, innovation = example("estimator", type_).update(MODEL, prior, measure(z))
    for k in range(7):
        x, covariance, nis = kalman(prior.x[:, k], z[:, k])
        np.testing.assert_allclose(after.x[:, k], x, rtol=0, atol=1e-10)
        np.testing.assert_allclose(after.covariance[k], covariance, rtol=0, atol=1e-10)
        np.testing.assert_allclose(innovation.nis[k], nis, rtol=1e-9)
        rows = np.flatnonzero(~np.isnan(z[:, k]))
        S = H[rows] @ P @ H[rows].T + R[np.ix_(rows, rows)]
        np.testing.assert_allclose(innovation.covariance[k][np.ix_(rows, rows)], S, rtol=1e-9)
        np.testing.assert_allclose(
            innovation.residual[rows, k], (z[:, k] - H @ prior.x[:, k])[rows], rtol=1e-9
        )
    np.testing.assert_allclose(after.x[:, 7], prior.x[:, 7], rtol=1e-12)
    some = np.array([3, 0, 0])
    few, _ = example("estimator", type_).update(
        MODEL,
        Belief(prior.x[:, some], prior.root[some], prior.t_s[some]),
        measure(z).of_cases(some),
    )
    np.testing.assert_array_equal(few.x, after.x[:, some])
    every = np.sum(innovation.nis) / np.sum(innovation.dof)
    np.testing.assert_allclose(mean_nis([innovation]).mean, every, rtol=1e-9)


@pytest.mark.parametrize("type_", ["unscented", "iterated_extended"])
def test_gate_leaves_the_marginal_of_the_others(type_: str) -> None:
    prior = start(1)
    z = H @ prior.x
    z[2] += 200.0
    gated = example("estimator", type_).__class__
    estimator = gated(type(example("estimator", type_).spec)(gate_sigmas=5.0))
    after, innovation = estimator.update(MODEL, prior, measure(z))
    np.testing.assert_array_equal(innovation.used[:, 0], [True, True, False])
    x, covariance, nis = kalman(prior.x[:, 0], np.array([z[0, 0], z[1, 0], np.nan]))
    np.testing.assert_allclose(after.x[:, 0], x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(after.covariance[0], covariance, rtol=0, atol=1e-10)
    np.testing.assert_allclose(innovation.nis, nis, rtol=0, atol=1e-9)


def test_a_block_is_judged_by_its_own_covariance() -> None:
    """The distance of a gate is νᵀ S⁻¹ ν of the block alone, a hair on either side of 5 sigma."""
    prior, S = start(1), (H @ P @ H.T + R)[:2, :2]
    way = np.array([1.0, -1.0])
    limit = 28.743702426935496  # χ²₂ of the probability of a normal number beyond 5: −2 ln 5.733e-7
    for factor, taken in ((0.999, True), (1.001, False)):
        z = H @ prior.x
        z[:2, 0] += factor * way * np.sqrt(limit / (way @ np.linalg.solve(S, way)))
        z[2] = np.nan
        estimator = BatchedUnscented(BatchedUnscentedSpec(gate_sigmas=5.0))
        _, innovation = estimator.update(MODEL, prior, measure(z))
        assert innovation.used[0, 0] == taken


def test_fits_bounds_and_gramians_obey() -> None:
    prior = start(2)
    sets = [measure(RANDOM.normal(size=(3, 2)), float(k)) for k in range(1, 4)]
    information, vector = np.linalg.inv(P), np.linalg.inv(P) @ prior.x
    gramian, phi = np.zeros((2, 2)), np.eye(2)
    for one in sets:
        phi = MODEL.F @ phi
        rows = np.linalg.solve(R, H @ phi)
        gramian += (H @ phi).T @ rows
        vector = vector + rows.T @ one.values
    information = information + gramian
    fit = batch_least_squares(MODEL, prior, sets)
    np.testing.assert_allclose(fit.belief.x, np.linalg.solve(information, vector), rtol=1e-9)
    np.testing.assert_allclose(fit.belief.covariance[0], np.linalg.inv(information), rtol=1e-9)
    found = observability(MODEL, prior, sets, np.ones(2))
    np.testing.assert_allclose(found.root[0].T @ found.root[0], gramian, rtol=1e-9)
    truth = [np.linalg.matrix_power(MODEL.F, k) @ prior.x for k in range(3)]
    bounds = cramer_rao(MODEL, truth, prior.covariance, [replace(m, t_s=m.t_s - 1) for m in sets])
    once = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.solve(R, H))
    np.testing.assert_allclose(bounds[0].covariance[0], once, rtol=1e-9)


def test_direction_takes_the_covariance_of_its_components() -> None:
    """Only the part across the direction counts; without variance along it, as it is measured."""
    x = np.array([[30.0], [-40.0], [120.0]])
    u = x[:, 0] / 130.0
    across = np.linalg.svd(u[None])[2][1:].T
    own = across @ np.diag([1e-6, 4e-6]) @ across.T
    full = np.zeros((4, 4))
    full[:3, :3], full[3, 3] = own, 0.25
    prior = Belief.of(x, np.diag([1.0, 2.0, 3.0])[None], np.zeros(1))
    z = Bearing().observe(x, np.zeros(1), np.zeros(1, dtype=int))
    slope = (np.eye(3) - np.outer(u, u)) / 130.0
    rows = np.concatenate([across.T @ slope, u[None]])
    S = rows @ prior.covariance[0] @ rows.T + np.diag([1e-6, 4e-6, 0.25])
    K = prior.covariance[0] @ rows.T @ np.linalg.inv(S)
    expected = prior.covariance[0] - K @ S @ K.T
    for along in (0.0, 1e-2):
        given = full.copy()
        given[:3, :3] += along * np.outer(u, u)
        measured = MeasurementSet.of(np.zeros(1), z, given[None], Bearing.blocks)
        for type_ in ("iterated_extended", "information", "ekf"):
            after, innovation = example("estimator", type_).update(Bearing(), prior, measured)
            np.testing.assert_allclose(after.covariance[0], expected, rtol=0, atol=1e-8)
            assert innovation.dof == 3


def test_covariances_that_cannot_be_used() -> None:
    z = np.zeros((3, 2))
    for wrong, message in (
        (np.diag([1.0, 1.0, -1.0])[None], "row 2 of case 0 is present"),
        (np.ones((1, 3, 3)), "case 0 is not positive definite"),
        (np.ones((3, 3, 3)), r"must be \(2, 3, 3\) or \(1, 3, 3\), got \(3, 3, 3\)"),
        (np.array([np.eye(3), np.eye(3) + 0.5 * np.eye(3, k=1)]), "case 1 is not finite and symm"),
    ):
        with pytest.raises(InputError, match=message):
            MeasurementSet.of(np.zeros(2), z, wrong, MODEL.blocks)
    with pytest.raises(InputError, match=r"covariances with three dimensions, got \(3, 3\)"):
        MeasurementSet.of(np.zeros(2), z, R, MODEL.blocks)
    # rows that are missing may hold anything
    z[2], hole = np.nan, R.copy()
    hole[2], hole[:, 2] = np.nan, np.nan
    measured = MeasurementSet.of(np.zeros(2), z, hole[None], MODEL.blocks)
    after, _ = example("estimator", "unscented").update(MODEL, start(2), measured)
    assert np.isfinite(after.x).all()
    np.testing.assert_allclose(measured.covariance[0][:2, :2], R[:2, :2], rtol=1e-12)
    assert nothing(2).shape == (0, 2)
