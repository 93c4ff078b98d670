r"""Scaled sigma points and the unscented transform, for all cases in one call.

With λ = α²(n + κ) − n the sigma points of a belief of n states are its mean x and x ± √(n + λ) S_j,
S_j the columns of the covariance's root [1]_ [2]_. Let y_0 be the image of the mean under a
function, y_0 + e_i the images of the others and w = 1/(2(n + λ)) their weight. Mean and covariance
of the image are, with ē = w Σ e_i,

.. math::

    \bar y = y_0 + \bar e, \quad
    P_y = w \sum_i e_i e_i^T + (β - α^2) \bar e \bar e^T.

This is the scaled unscented transform (eq. 15 of [2]_) written about the image of the mean instead
of about the mean of the images. The result is the same, but the weight of the middle point, whose
size is 1/α², cancels. So the digits that it costs for a small α are kept, and for β ≥ α² the
covariance is a sum of squares: it cannot be indefinite, and its root follows from the terms without
forming it.

References
----------
.. [1] Julier (2002), The scaled unscented transformation, American Control Conference.
.. [2] Wan, van der Merwe (2000), The unscented Kalman filter for nonlinear estimation, eq. 15.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.linearisation import sensitivity, transition
from hillsphere_estimators.state_angles import lift_differences, state_angles

__all__ = [
    "Images",
    "SigmaRule",
    "sigma_points",
    "transform_measurement",
    "transform_motion",
    "update_mask",
]


@dataclass(frozen=True)
class SigmaRule:
    """Parameters of the scaled sigma points.

    Parameters
    ----------
    alpha : float
        Scale of the points about the mean, α > 0.
    beta : float
        Weight of the curvature in the covariance, β ≥ α²; 2 is best for normal distributions.
    kappa : float
        Second scale, κ > −n.

    Raises
    ------
    InputError
        If α = 0 or β < α²: a covariance might be indefinite.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha**2 <= self.beta:
            raise InputError(
                f"sigma points need alpha > 0 and beta of at least its square, got alpha = "
                f"{self.alpha:g} and beta = {self.beta:g}; for normal distributions take beta = 2"
            )

    def reach(self, n: int) -> float:
        """Return √(n + λ) = α √(n + κ), the distance of the points in standard deviations.

        Parameters
        ----------
        n : int
            Number of states.

        Raises
        ------
        InputError
            If κ ≤ −n.
        """
        square = self.alpha**2 * (n + self.kappa)
        if square <= 0.0:
            raise InputError(
                f"sigma points of {n} states need kappa > {-n}, got {self.kappa:g}; take 0"
            )
        return float(np.sqrt(square))


@dataclass(frozen=True)
class Images:
    """Images of the sigma points of N cases, separated into odd and even parts.

    Of the deviations e₊ and e₋ of two opposite points the half difference is what a linear function
    gives, the half sum comes from curvature alone.

    Parameters
    ----------
    middle : ndarray, shape (m, N)
        Image of the mean, y_0.
    shift : ndarray, shape (m, N)
        Mean of the images minus y_0, ē.
    odd : ndarray, shape (N, n, m)
        √(2w) (e₊ − e₋)/2. These rows belong to the rows of Sᵀ: their product with these is the
        covariance of states and images.
    even : ndarray, shape (N, n + 1, m)
        √(2w) (e₊ + e₋)/2 and, as the last row, √(β − α²) ē. These rows are uncorrelated with the
        states.
    """

    middle: Array
    shift: Array
    odd: Array
    even: Array


def sigma_points(belief: Belief, reach: float) -> Array:
    """Return the sigma points of a belief.

    Parameters
    ----------
    belief : Belief
        Belief of N cases of n states.
    reach : float
        √(n + λ), see `SigmaRule.reach`.

    Returns
    -------
    ndarray, shape (n, 2n + 1, N)
        The mean, the n points x + √(n + λ) S_j, the n points x − √(n + λ) S_j.
    """
    n, cases = belief.x.shape
    points = np.empty((n, 2 * n + 1, cases))
    steps = reach * np.ascontiguousarray(belief.root.transpose(1, 2, 0))
    middle = belief.x[:, None]
    points[:, :1] = middle
    np.add(middle, steps, out=points[:, 1 : n + 1])
    np.subtract(middle, steps, out=points[:, n + 1 :])
    return points


def transform_motion(
    rule: SigmaRule, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
) -> Images:
    """Pass the sigma points of a belief through the motion to other times.

    Parameters
    ----------
    rule : SigmaRule
        Parameters of the sigma points.
    model : EstimationModel
        Motion model.
    belief : Belief
        Belief of N cases of n states.
    t_to_s : ndarray, shape (N,)
        Times to which the points move, s.
    control : ndarray, shape (p, N)
        Controls, the same for all points of a case.

    Returns
    -------
    Images
        Images of n rows, without process noise.
    """
    n, cases = belief.x.shape
    reach = rule.reach(n)
    points = sigma_points(belief, reach)
    each = 2 * n + 1
    there = model.advance(
        points.reshape(n, -1), _repeat_cases(belief.t_s, each), _repeat_cases(t_to_s, each),
        _repeat_cases(control, each), _case_of_points(each, cases),
    ).reshape(n, each, cases)  # fmt: skip
    off, angles = there[:, 1:] - there[:, :1], state_angles(model, n)
    if angles:
        _, phi = transition(model, belief, t_to_s, control)
        off = lift_differences(off, _predict_differences(phi, belief, reach), angles)
    return _form_images(rule, there[:, 0], off, reach)


def transform_measurement(
    rule: SigmaRule,
    model: EstimationModel,
    belief: Belief,
    layout: Layout,
    case: Integers | None = None,
) -> Images:
    """Pass the sigma points of a belief through the measurement model.

    Parameters
    ----------
    rule : SigmaRule
        Parameters of the sigma points.
    model : EstimationModel
        Measurement model.
    belief : Belief
        Belief of N cases.
    layout : Layout
        Kinds of the m rows. Angles and directions enter as differences from the central point, so
        that they do not wrap.
    case : ndarray of int, shape (N,), optional
        Numbers of the cases in the model; by default 0 to N − 1.

    Returns
    -------
    Images
        Images of m rows. Rows that no sensor measures at this time hold arbitrary values.
    """
    n, cases = belief.x.shape
    reach = rule.reach(n)
    points = sigma_points(belief, reach)
    each = 2 * n + 1
    numbers = _case_of_points(each, cases) if case is None else np.tile(case, each)
    shown = layout.fitting(
        model.observe(points.reshape(n, -1), _repeat_cases(belief.t_s, each), numbers)
    ).reshape(-1, each, cases)
    off = layout.difference(shown[:, 1:], shown[:, :1])
    if layout.angles and state_angles(model, n):
        _, slopes = sensitivity(model, belief, layout, case)
        off = lift_differences(off, _predict_differences(slopes, belief, reach), layout.angles)
    return _form_images(rule, shown[:, 0], off, reach)


def update_mask(model: EstimationModel, n: int) -> Array | None:
    """Return which states the measurements change, None if they change all.

    The others are considered states (Schmidt): their uncertainty counts, but they are not
    estimated.

    Parameters
    ----------
    model : EstimationModel
        Considered states are given by its attribute `considered`, if it has one.
    n : int
        Number of states.

    Returns
    -------
    ndarray, shape (n,), or None
        1 for estimated states, 0 for considered ones.

    Raises
    ------
    InputError
        If `considered` does not have n entries.
    """
    # not isinstance with the protocol, which would look up every method at each update
    considered = getattr(model, "considered", None)
    if considered is None:
        return None
    considered = np.asarray(considered, dtype=bool)
    if considered.shape != (n,):
        raise InputError(f"considered must be ({n},), one for each state, got {considered.shape}")
    return np.where(considered, 0.0, 1.0) if considered.any() else None


def _predict_differences(slopes: Array, belief: Belief, reach: float) -> Array:
    """Return the differences (m, 2n, N) of images by a function with constant slopes (N, m, n)."""
    ahead = reach * (slopes @ belief.root).transpose(1, 2, 0)
    return np.concatenate([ahead, -ahead], axis=1)


def _repeat_cases(values: Array, each: int) -> Array:
    """Return arrays of cases (…, N) repeated for their points, (…, each · N), points slowest."""
    *rows, cases = values.shape
    many = np.empty((*rows, each, cases))
    many[...] = values[..., None, :]
    return many.reshape(*rows, each * cases)


@lru_cache(maxsize=64)
def _case_of_points(each: int, cases: int) -> Integers:
    """Return the number of the case of each of `each` · N points, read-only."""
    numbers = np.tile(np.arange(cases), each)
    # the cached array is shared by all callers
    numbers.flags.writeable = False
    return numbers


def _form_images(rule: SigmaRule, middle: Array, off: Array, reach: float) -> Images:
    """Separate deviations from the middle point into their odd and even parts.

    Parameters
    ----------
    rule : SigmaRule
        Parameters of the sigma points.
    middle : ndarray, shape (m, N)
        Image of the mean.
    off : ndarray, shape (m, 2n, N)
        Deviations e_i of the other points, the second half opposite to the first.
    reach : float
        √(n + λ): w = 1/(2 reach²), √(2w) = 1/reach.
    """
    m, many, cases = off.shape
    half = many // 2
    ahead, behind = off[:, :half], off[:, half:]
    parts = np.empty((m, many + 1, cases))
    np.subtract(ahead, behind, out=parts[:, :half])
    both = np.add(ahead, behind, out=parts[:, half:many])
    # ē = w Σ e_i over opposite pairs
    shift = both.sum(axis=1) * (0.5 / reach**2)
    # √(2w)/2 = 1/(2 reach) makes the rows of both parts
    parts[:, :many] *= 0.5 / reach
    parts[:, many] = np.sqrt(rule.beta - rule.alpha**2) * shift
    # contiguous by cases, since products of many small matrices follow
    rows = np.ascontiguousarray(parts.transpose(2, 1, 0))
    return Images(middle, shift, rows[:, :half], rows[:, half:])
