"""The square-root information filter, for all cases at once.

The belief is carried as an upper triangular R with R (x − x̂) white noise of unit variance, so that
P = R⁻¹ R⁻ᵀ; no covariance appears. Prediction and update are QR decompositions of the same
equations for the later states and with the rows of the measurements [1]_. None of its algebra is
shared with the filters in covariance form, which makes it an independent check of them.

References
----------
.. [1] Bierman (1977), Factorization methods for discrete sequential estimation, chapters V and VI.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.casewise import CasewiseEstimator, drop_failed
from hillsphere_estimators.convergence import regular_root
from hillsphere_estimators.gauss_newton import iterate_update, linearise_measurements
from hillsphere_estimators.innovations import WhitenedInnovation, refer_to_prior, usable_at
from hillsphere_estimators.linearisation import noise_between, transition
from hillsphere_estimators.roots import lower_root, upper_triangle
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.specs import InformationSpec

__all__ = ["Information", "information_root"]


class Information(CasewiseEstimator):
    """A square-root information filter, its update iterated (see the module).

    States that are known exactly have infinite information: they are refused.

    Parameters
    ----------
    spec : InformationSpec
        Its parameters.
    """

    def __init__(self, spec: InformationSpec) -> None:
        self.spec = spec

    def _predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at other times."""
        noise = noise_between(model, belief, t_to_s, control)
        x, phi = transition(model, belief, t_to_s, control)
        cases, n, r = noise.shape
        # x' = Φ x + G w with white w: the equations are w = 0 and R Φ⁻¹ (x' − G w) = R x̂, each with
        # noise of unit variance; the triangle of both without the columns of w is R of x'
        known = np.swapaxes(information_root(belief), 1, 2)
        try:
            back = np.linalg.solve(np.swapaxes(phi, 1, 2), known)
        except np.linalg.LinAlgError:
            raise InputError(
                "the information filter needs a motion that can be inverted, but its derivative by "
                "the states is singular; take an estimator of type unscented or iterated_extended"
            ) from None
        back = np.swapaxes(back, 1, 2)
        rows = np.zeros((cases, r + n, r + n))
        rows[:, :r, :r] = np.eye(r)
        rows[:, r:, :r] = -back @ noise
        rows[:, r:, r:] = back
        return _belief(x, upper_triangle(rows)[:, r:, r:], t_to_s)

    def _update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation, NDArray[np.bool_]]:
        """Return the belief after measurements, the innovation, and which cases have failed."""
        spec = self.spec
        layout, used = usable_at(belief, measurements)
        free = update_mask(model, len(belief.x))
        first, failed = drop_failed(
            linearise_measurements(model, belief, layout, measurements, used)
        )

        after = iterate_update(
            model, belief, layout, measurements, first.used, _solve_linearised,
            spec.iterations, spec.tolerance_sigmas,
        )  # fmt: skip
        if free is not None:
            # about the solution for all states; the extended filter stays at the prior
            at = after if spec.iterations > 1 else belief
            expected = linearise_measurements(model, at, layout, measurements, first.used)
            joint = _solve_linearised(belief, at.x, expected)
            after = _hold_considered(belief, at.x, expected, joint, free)
        innovation = refer_to_prior(belief, belief.x, first).innovation(measurements.sigma)
        return after, innovation, failed


def information_root(belief: Belief) -> Array:
    """Return R = S⁻¹ (N, n, n) of a belief with the root S.

    Parameters
    ----------
    belief : Belief
        N beliefs of n states.

    Returns
    -------
    ndarray, shape (N, n, n)
        R, with Rᵀ R the information.

    Raises
    ------
    InputError
        If the covariance is singular: its information is infinite.
    """
    return np.asarray(np.linalg.inv(regular_root(belief)))


def _solve_linearised(prior: Belief, x: Array, expected: WhitenedInnovation) -> Belief:
    """Return the belief that solves the equations of prior and measurements, linearised at x.

    The rows are R d = R (x̄ − x) and H d = ν(x) for the correction d of x.
    """
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


def _hold_considered(
    prior: Belief, x: Array, expected: WhitenedInnovation, joint: Belief, free: Array
) -> Belief:
    """Return Schmidt's update from that of all states, whose covariance is P⁺.

    With noise of unit variance the gain is K = P⁺ Hᵀ. Its rows of considered states are left out;
    the covariance is then (1 − K H) P (1 − K H)ᵀ + K Kᵀ (Joseph's form), of which the two factors
    are the rows.
    """
    gain = joint.root @ (np.swapaxes(joint.root, 1, 2) @ expected.linear) * free[:, None]
    first = refer_to_prior(prior, x, expected)
    step = gain @ first.residual[:, :, None]
    over = np.swapaxes(gain, 1, 2)
    rows = np.concatenate([np.swapaxes(prior.root, 1, 2) - first.linear @ over, over], axis=1)
    return Belief(prior.x + step[:, :, 0].T, lower_root(rows), prior.t_s)


def _belief(x: Array, known: Array, t_s: Array) -> Belief:
    """Return the belief of means x with the information root R."""
    rows = np.swapaxes(np.linalg.inv(known), 1, 2)
    return Belief(x, np.swapaxes(upper_triangle(rows), 1, 2), t_s)
