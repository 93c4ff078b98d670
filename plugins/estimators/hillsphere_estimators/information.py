"""The square-root information filter, on all cases at once.

It keeps an upper triangular R and says that R (x − x̂) is white noise of unit variance; a covariance
never appears. Prediction and update are orthogonal triangularisations of the same statement about
later states and with more rows [1]_. Nothing of its algebra is that of the filters in covariance
form: it is their check.

References
----------
.. [1] Bierman (1977), Factorization methods for discrete sequential estimation, chapters V and VI.
"""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.convergence import regular_root
from hillsphere_estimators.gauss_newton import iterate_update, linearise_measurements
from hillsphere_estimators.innovations import WhitenedInnovation, refer_to_prior, usable_at
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.roots import upper_triangle
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.specs import InformationSpec

__all__ = ["Information", "information_root"]


class Information:
    """A square-root information filter, its update iterated (see the module).

    Parameters
    ----------
    spec : InformationSpec
        Its parameters.
    """

    def __init__(self, spec: InformationSpec) -> None:
        self.spec = spec

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times; see `hillsphere.interfaces.Estimator`."""
        x, phi = transition(model, belief, t_to_s, control)
        noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
        cases, n, r = noise.shape
        # x' = Φ x + G w: of w and x' we know that w is white, and R Φ⁻¹ (x' − G w) − R x̂ too
        back = np.linalg.solve(np.swapaxes(phi, 1, 2), np.swapaxes(information_root(belief), 1, 2))
        back = np.swapaxes(back, 1, 2)
        rows = np.zeros((cases, r + n, r + n))
        rows[:, :r, :r] = np.eye(r)
        rows[:, r:, :r] = -back @ noise
        rows[:, r:, r:] = back
        return _belief(x, upper_triangle(rows)[:, r:, r:], t_to_s)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`.

        Raises
        ------
        InputError
            If the model has considered states: an information filter has no gain to leave out.
        """
        spec = self.spec
        layout, used = usable_at(belief, measurements)
        if update_mask(model, len(belief.x)) is not None:
            raise InputError(
                "the information filter estimates all states, but the model has considered ones; "
                "take an estimator of type unscented or iterated_extended"
            )
        first = linearise_measurements(model, belief, layout, measurements, used)
        after = iterate_update(
            model, belief, layout, measurements, used, _solve_linearised,
            spec.iterations, spec.tolerance_sigmas,
        )  # fmt: skip
        innovation = refer_to_prior(belief, belief.x, first).innovation(measurements.sigma)
        return after, innovation


def information_root(belief: Belief) -> Array:
    """Return the R of a belief (N, n, n), the inverse of the covariance's root.

    Raises
    ------
    InputError
        If a state is known exactly: its information has no end.
    """
    return np.asarray(np.linalg.inv(regular_root(belief)))


def _solve_linearised(prior: Belief, x: Array, expected: WhitenedInnovation) -> Belief:
    """Return the belief of the rows of prior and measurements, linearised at x."""
    m = expected.linear.shape[2]
    n = len(x)
    known = information_root(prior)
    rows = np.empty((len(known), n + m, n + 1))
    rows[:, :n, :n] = known
    rows[:, :n, n:] = known @ (prior.x - x).T[:, :, None]
    rows[:, n:, :n] = np.swapaxes(expected.linear, 1, 2)
    rows[:, n:, n] = expected.residual
    upper = upper_triangle(rows)
    step = np.linalg.solve(upper[:, :n, :n], upper[:, :n, n:])
    return _belief(x + step[:, :, 0].T, upper[:, :n, :n], prior.t_s)


def _belief(x: Array, known: Array, t_s: Array) -> Belief:
    rows = np.swapaxes(np.linalg.inv(known), 1, 2)
    return Belief(x, np.swapaxes(upper_triangle(rows), 1, 2), t_s)
