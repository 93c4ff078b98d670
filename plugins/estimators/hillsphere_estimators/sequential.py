"""FilterPy's filters behind the interface of estimators, case by case, as a reference.

FilterPy needs some care: an update must begin with sigma points drawn for it, the noise is a full
matrix, and covariances are made symmetric after each step. Measurements are given as differences
from the predicted measurement of the mean, so that angles and directions do not wrap.

References
----------
.. [1] Labbe (2014), Kalman and Bayesian filters in Python.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.innovations import usable_at
from hillsphere_estimators.linearisation import predict_measurement, sensitivity, transition
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.specs import SequentialExtendedSpec, SequentialUnscentedSpec

__all__ = ["SequentialExtended", "SequentialUnscented"]


class SequentialUnscented:
    """FilterPy's scaled unscented filter [1]_ (see the module).

    Parameters
    ----------
    spec : SequentialUnscentedSpec
        Its parameters.
    """

    def __init__(self, spec: SequentialUnscentedSpec) -> None:
        self.spec = spec

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times; see `hillsphere.interfaces.Estimator`."""
        noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
        made = []
        for k in range(len(belief.t_s)):
            own, case = slice(k, k + 1), np.array([k])

            def forward(x: Array, dt: float, own: slice = own, case: Any = case) -> Array:
                return model.advance(
                    x[:, None], belief.t_s[own], t_to_s[own], control[:, own], case
                )[:, 0]

            one = self._filter(belief, k, 1)
            one.Q = noise[k] @ noise[k].T
            one.predict(dt=float(t_to_s[k] - belief.t_s[k]), fx=forward)
            made.append((one.x, one.P))
        return _join_cases(made, t_to_s)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`."""

        def update_case(k: int, offs: Callable[[Array], Array], z: Array, R: Array) -> Any:
            one = self._filter(belief, k, len(z))
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


class SequentialExtended:
    """FilterPy's extended filter [1]_ (see the module).

    Parameters
    ----------
    spec : SequentialExtendedSpec
        Its parameters; it has none.
    """

    def __init__(self, spec: SequentialExtendedSpec) -> None:
        self.spec = spec

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times; see `hillsphere.interfaces.Estimator`."""
        noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
        there, phi = transition(model, belief, t_to_s, control)
        made = []
        for k in range(len(belief.t_s)):
            one = self._filter(belief, k, 1)
            one.F, one.Q = phi[k], noise[k] @ noise[k].T
            one.predict()
            # the library moves the mean by F alone; the motion itself is not linear
            made.append((there[:, k], one.P))
        return _join_cases(made, t_to_s)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`."""
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
) -> tuple[Belief, Innovation]:
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
    values = np.where(measurements.present, measurements.values, middle)
    z = layout.difference(values, middle)
    m, cases = z.shape
    residual, nis = np.zeros((m, cases)), np.zeros(cases)
    sigma = measurements.sigma
    unit = np.where(np.isfinite(sigma) & (sigma > 0.0), sigma, 1.0)
    covariance = np.zeros((cases, m, m))
    covariance[:, np.arange(m), np.arange(m)] = unit.T**2
    made = []
    for k in range(cases):
        rows = np.flatnonzero(used[:, k])
        if not rows.size:
            made.append((belief.x[:, k], belief.root[k] @ belief.root[k].T))
            continue
        offs = _innovation_function(model, belief, layout, middle, k, rows)
        one = update_case(k, offs, z[rows, k], np.diag(measurements.sigma[rows, k] ** 2))
        made.append((one.x, one.P))
        residual[rows, k] = one.y
        covariance[k][np.ix_(rows, rows)] = one.S
        nis[k] = one.y @ np.linalg.solve(one.S, one.y)
    return _join_cases(made, belief.t_s), Innovation(residual, covariance, used, nis)


def _innovation_function(
    model: EstimationModel, belief: Belief, layout: Layout, middle: Array, k: int, rows: Any
) -> Callable[[Array], Array]:
    """Return the function from a state (n,) to some rows of its measurements minus the mean's."""
    case = np.array([k])

    def offs(x: Array) -> Array:
        z = model.observe(x[:, None], belief.t_s[k : k + 1], case)
        return np.asarray(layout.difference(z, middle[:, k : k + 1])[rows, 0])

    return offs


def _join_cases(made: list[tuple[Array, Array]], t_s: Array) -> Belief:
    """Return the beliefs (x, P) of single cases as one, with symmetric covariances."""
    covariance = np.array([P for _, P in made])
    x = np.array([x for x, _ in made]).T
    return Belief.of(x, 0.5 * (covariance + np.swapaxes(covariance, 1, 2)), t_s)


def _filterpy() -> Any:
    """Import FilterPy, or raise `InputError` that says how to install it."""
    try:
        return import_module("filterpy.kalman")
    except ImportError:
        raise InputError(
            "estimators of types ukf and ekf need the package filterpy, which is not installed: "
            "pip install 'filterpy>=2.0', or take type unscented or iterated_extended"
        ) from None
