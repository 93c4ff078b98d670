"""FilterPy's filters behind the interface of estimators, case by case, as a reference.

FilterPy needs some care: an update must begin with sigma points drawn for it, the noise is a full
matrix, and covariances are made symmetric after each step. Measurements are given as differences
from the predicted measurement of the mean, so that angles and directions do not wrap.

References
----------
.. [1] Labbe (2014), Kalman and Bayesian filters in Python.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.casewise import CasewiseEstimator, mark_failed
from hillsphere_estimators.convergence import regular_root
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.innovations import usable_at
from hillsphere_estimators.linearisation import (
    noise_between,
    predict_measurement,
    sensitivity,
    transition,
)
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.specs import SequentialExtendedSpec, SequentialUnscentedSpec
from hillsphere_estimators.state_angles import lift_differences, state_angles

__all__ = ["SequentialExtended", "SequentialUnscented"]


class SequentialUnscented(CasewiseEstimator):
    """FilterPy's scaled unscented filter [1]_ (see the module).

    Its sigma points need regular covariances: states that are known exactly are refused.

    Parameters
    ----------
    spec : SequentialUnscentedSpec
        Its parameters.
    """

    considers = False
    """It estimates all states, see `hillsphere.interfaces.Estimator`."""

    def __init__(self, spec: SequentialUnscentedSpec) -> None:
        self.spec = spec

    def _predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at other times."""
        regular_root(belief)
        noise = noise_between(model, belief, t_to_s, control)
        angles = state_angles(model, len(belief.x))
        if angles:
            there, phi = transition(model, belief, t_to_s, control)
        made = []
        for k in range(len(belief.t_s)):
            own, case = slice(k, k + 1), np.array([k])

            def forward(x: Array, dt: float, own: slice = own, case: Any = case) -> Array:
                moved = model.advance(
                    x[:, None], belief.t_s[own], t_to_s[own], control[:, own], case
                )
                if not angles:
                    return moved[:, 0]
                # the library takes plain means: images of angles lie about that of the mean
                middle = there[:, own]
                expected = phi[own][0] @ (x[:, None] - belief.x[:, own])
                return np.asarray(middle + lift_differences(moved - middle, expected, angles))[:, 0]

            one = self._filter(belief, k, 1)
            one.Q = noise[k] @ noise[k].T
            with _failing(one):
                one.predict(dt=float(t_to_s[k] - belief.t_s[k]), fx=forward)
            made.append((one.x, one.P))
        return _join_cases(made, t_to_s)

    def _update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation, NDArray[np.bool_]]:
        """Return the belief after measurements, the innovation, and which cases have failed."""
        regular_root(belief)

        def update_case(k: int, offs: Callable[[Array], Array], z: Array, R: Array) -> Any:
            one = self._filter(belief, k, len(z))
            with _failing(one):
                one.sigmas_f = one.points_fn.sigma_points(one.x, one.P)
                one.update(z, R=R, hx=offs)
            return one

        return _update_cases(model, belief, measurements, update_case)

    def _filter(self, belief: Belief, k: int, rows: int) -> Any:
        kalman, n, spec = _filterpy(), len(belief.x), self.spec
        points = kalman.MerweScaledSigmaPoints(n, spec.alpha, spec.beta, spec.kappa)
        one = kalman.UnscentedKalmanFilter(n, rows, 1.0, None, None, points)
        one.x, one.P = belief.x[:, k].copy(), belief.root[k] @ belief.root[k].T
        return one


class SequentialExtended(CasewiseEstimator):
    """FilterPy's extended filter [1]_ (see the module).

    Parameters
    ----------
    spec : SequentialExtendedSpec
        Its parameters; it has none.
    """

    considers = False
    """It estimates all states, see `hillsphere.interfaces.Estimator`."""

    def __init__(self, spec: SequentialExtendedSpec) -> None:
        self.spec = spec

    def _predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at other times."""
        noise = noise_between(model, belief, t_to_s, control)
        there, phi = transition(model, belief, t_to_s, control)
        made = []
        for k in range(len(belief.t_s)):
            one = self._filter(belief, k, 1)
            one.F, one.Q = phi[k], noise[k] @ noise[k].T
            one.predict()
            # the library moves the mean by F alone; the motion itself is not linear
            made.append((there[:, k], one.P))
        return _join_cases(made, t_to_s)

    def _update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation, NDArray[np.bool_]]:
        """Return the belief after measurements, the innovation, and which cases have failed."""
        layout, used = usable_at(belief, measurements)
        _, slopes = sensitivity(model, belief, layout)

        def update_case(k: int, offs: Callable[[Array], Array], z: Array, R: Array) -> Any:
            one = self._filter(belief, k, len(z))
            one.update(z, lambda x: slopes[k][used[:, k]], offs, R=R)
            return one

        return _update_cases(model, belief, measurements, update_case)

    def _filter(self, belief: Belief, k: int, rows: int) -> Any:
        one = _filterpy().ExtendedKalmanFilter(len(belief.x), rows)
        one.x, one.P = belief.x[:, k].copy(), belief.root[k] @ belief.root[k].T
        return one


def _update_cases(
    model: EstimationModel,
    belief: Belief,
    measurements: MeasurementSet,
    update_case: Callable[[int, Callable[[Array], Array], Array, Array], Any],
) -> tuple[Belief, Innovation, NDArray[np.bool_]]:
    """Update case by case.

    `update_case` takes the number of the case, the function from a state to the predicted
    differences, the measured differences and their covariance R; it returns FilterPy's filter.
    """
    if update_mask(model, len(belief.x)) is not None:
        raise InputError(
            "FilterPy's filters estimate all states, but the model has considered ones; take an "
            "estimator of type unscented or iterated_extended"
        )
    layout, used = usable_at(belief, measurements)
    middle = predict_measurement(model, belief, layout)
    # a case whose measured rows cannot be predicted is left as it is
    failed: NDArray[np.bool_] = np.asarray((used & ~np.isfinite(middle)).any(axis=0))
    used &= ~failed
    values = np.where(measurements.present, measurements.values, middle)
    z = layout.difference(values, middle)
    m, cases = z.shape
    residual, nis = np.zeros((m, cases)), np.zeros(cases)
    sigma = measurements.sigma
    unit = np.where(np.isfinite(sigma) & (sigma > 0.0), sigma, 1.0)
    covariance = np.zeros((cases, m, m))
    covariance[:, np.arange(m), np.arange(m)] = unit.T**2
    noise = layout.noise(measurements.covariance, middle)
    turning = bool(layout.angles) and bool(state_angles(model, len(belief.x)))
    slopes = sensitivity(model, belief, layout)[1] if turning else None
    made = []
    for k in range(cases):
        rows = np.flatnonzero(used[:, k])
        if not rows.size:
            made.append((belief.x[:, k], belief.root[k] @ belief.root[k].T))
            continue
        slope = None if slopes is None else slopes[k]
        offs = _innovation_function(model, belief, layout, middle, k, rows, slope)
        one = update_case(k, offs, z[rows, k], noise[k][np.ix_(rows, rows)])
        made.append((one.x, one.P))
        residual[rows, k] = one.y
        covariance[k][np.ix_(rows, rows)] = one.S
        nis[k] = one.y @ np.linalg.solve(one.S, one.y)
    return _join_cases(made, belief.t_s), Innovation(residual, covariance, used, nis), failed


def _innovation_function(
    model: EstimationModel,
    belief: Belief,
    layout: Layout,
    middle: Array,
    k: int,
    rows: Any,
    slope: Array | None,
) -> Callable[[Array], Array]:
    """Return the function from a state (n,) to some rows of its measurements minus the mean's.

    With derivatives `slope` (m, n) angles are within half a turn of the linearised function.
    """
    case = np.array([k])

    def offs(x: Array) -> Array:
        z = model.observe(x[:, None], belief.t_s[k : k + 1], case)
        off = layout.difference(z, middle[:, k : k + 1])
        if slope is not None:
            off = lift_differences(off, slope @ (x - belief.x[:, k])[:, None], layout.angles)
        return np.asarray(off[rows, 0])

    return offs


def _join_cases(made: list[tuple[Array, Array]], t_s: Array) -> Belief:
    """Return the beliefs (x, P) of single cases as one, with symmetric covariances.

    Of several cases those whose P is no covariance become NaN; a single one raises `InputError`.
    """
    beliefs = []
    for k, (x, P) in enumerate(made):
        try:
            beliefs.append(Belief.of(x[:, None], 0.5 * (P + P.T)[None], t_s[k : k + 1]))
        except InputError:
            # what is no number is told by the caller
            if len(made) == 1 and np.isfinite(x).all() and np.isfinite(P).all():
                raise
            none = Belief(x[:, None], P[None], t_s[k : k + 1])
            beliefs.append(mark_failed(none, np.ones(1, dtype=bool)))
    return Belief(
        np.concatenate([one.x for one in beliefs], axis=1),
        np.concatenate([one.root for one in beliefs]),
        t_s,
    )


@contextmanager
def _failing(one: Any) -> Iterator[None]:
    """Turn a filter into NaN where FilterPy cannot take a root of what the model has returned."""
    try:
        yield
    except InputError:
        raise
    except (ValueError, np.linalg.LinAlgError):
        one.x, one.P = np.full_like(one.x, np.nan), np.full_like(one.P, np.nan)


def _filterpy() -> Any:
    """Import FilterPy, or raise `InputError` that says how to install it."""
    try:
        return import_module("filterpy.kalman")
    except ImportError:
        raise InputError(
            "estimators of types ukf and ekf need the package filterpy, which is not installed: "
            "pip install 'filterpy>=2.0', or take type unscented or iterated_extended"
        ) from None
