r"""Scaled sigma points and what becomes of them, all cases in one call.

With λ = α²(n + κ) − n the points are x and x ± √(n + λ) S_j, S_j the columns of the covariance's
root. Their images lie at y_0 and y_0 + e_i; with w = 1/(2(n + λ)) and ē = w Σ e_i

.. math::

    \bar y = y_0 + \bar e, \quad
    P_y = w \sum_i e_i e_i^T + (β - α^2) \bar e \bar e^T.

That is the scaled unscented transform [1]_ [2]_ written about the image of the mean instead of the
mean of the images: the same numbers, but the weight of the middle point, −1/α² in size, has gone,
and with it the digits that it costs and the covariance's doubtful sign. For β ≥ α² the right side
is a sum of squares, whose root is found without forming it.

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
    """Where sigma points lie and what they weigh.

    Parameters
    ----------
    alpha, beta, kappa : float
        α > 0, β ≥ α², κ > −n.

    Raises
    ------
    InputError
        If α or β is none of these: a covariance might be negative.
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
        """Return √(n + λ), how many standard deviations out the points of n states lie."""
        square = self.alpha**2 * (n + self.kappa)
        if square <= 0.0:
            raise InputError(
                f"sigma points of {n} states need kappa > {-n}, got {self.kappa:g}; take 0"
            )
        return float(np.sqrt(square))


@dataclass(frozen=True)
class Images:
    """Images of the sigma points of N cases, without common parts.

    Parameters
    ----------
    middle : ndarray, shape (m, N)
        Image of the mean.
    shift : ndarray, shape (m, N)
        Mean of the images less that, ē.
    odd : ndarray, shape (N, n, m)
        Half the differences between opposite points, √(2w)(e₊ − e₋)/2: rows that go with the
        rows of Sᵀ. Their sum of products is what a linear map would give.
    even : ndarray, shape (N, n + 1, m)
        Half their sums, √(2w)(e₊ + e₋)/2, and √(β − α²) ē: what no linear map gives; it goes with
        nothing of the states.
    """

    middle: Array
    shift: Array
    odd: Array
    even: Array


def sigma_points(belief: Belief, reach: float) -> Array:
    """Return the sigma points (n, 2n + 1, N): the mean, n points ahead, n behind."""
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
    """Return the images of sigma points under the motion to other times.

    Parameters
    ----------
    rule : SigmaRule
        Where they lie.
    model : EstimationModel
        How states move.
    belief : Belief
        Of which they are points.
    t_to_s : ndarray, shape (N,)
        Times, s.
    control : ndarray, shape (p, N)
        Controls.

    Returns
    -------
    Images
        Of n rows.
    """
    n, cases = belief.x.shape
    reach = rule.reach(n)
    points = sigma_points(belief, reach)
    each = 2 * n + 1
    there = model.advance(
        points.reshape(n, -1), _repeat_cases(belief.t_s, each), _repeat_cases(t_to_s, each),
        _repeat_cases(control, each), _case_of_points(each, cases),
    ).reshape(n, each, cases)  # fmt: skip
    return _form_images(rule, there[:, 0], there[:, 1:] - there[:, :1], reach)


def transform_measurement(
    rule: SigmaRule, model: EstimationModel, belief: Belief, layout: Layout
) -> Images:
    """Return the images of sigma points under the measurements.

    Parameters
    ----------
    rule : SigmaRule
        Where they lie.
    model : EstimationModel
        What sensors show.
    belief : Belief
        Of which they are points.
    layout : Layout
        Kinds of the m rows.

    Returns
    -------
    Images
        Of m rows; those not measured may be anything.
    """
    n, cases = belief.x.shape
    reach = rule.reach(n)
    points = sigma_points(belief, reach)
    each = 2 * n + 1
    shown = layout.fitting(
        model.observe(
            points.reshape(n, -1), _repeat_cases(belief.t_s, each), _case_of_points(each, cases)
        )
    ).reshape(-1, each, cases)
    return _form_images(rule, shown[:, 0], layout.difference(shown[:, 1:], shown[:, :1]), reach)


def update_mask(model: EstimationModel, n: int) -> Array | None:
    """Return 1 for states that measurements change and 0 for others (n,), or None if all are."""
    # not by the protocol: isinstance looks at every method, at each update anew
    held = getattr(model, "considered", None)
    if held is None:
        return None
    held = np.asarray(held, dtype=bool)
    if held.shape != (n,):
        raise InputError(f"considered must be ({n},), one for each state, got {held.shape}")
    return np.where(held, 0.0, 1.0) if held.any() else None


def _repeat_cases(values: Array, each: int) -> Array:
    """Return what the cases (…, N) have for `each` points of them, (…, each N)."""
    *rows, cases = values.shape
    many = np.empty((*rows, each, cases))
    many[...] = values[..., None, :]
    return many.reshape(*rows, each * cases)


@lru_cache(maxsize=64)
def _case_of_points(each: int, cases: int) -> Integers:
    found = np.tile(np.arange(cases), each)
    found.flags.writeable = False
    return found


def _form_images(rule: SigmaRule, middle: Array, off: Array, reach: float) -> Images:
    m, many, cases = off.shape
    half = many // 2
    ahead, behind = off[:, :half], off[:, half:]
    parts = np.empty((m, many + 1, cases))
    np.subtract(ahead, behind, out=parts[:, :half])
    both = np.add(ahead, behind, out=parts[:, half:many])
    shift = both.sum(axis=1) * (0.5 / reach**2)
    parts[:, :many] *= 0.5 / reach
    parts[:, many] = np.sqrt(rule.beta - rule.alpha**2) * shift
    # contiguous by cases: what follows are products of many small matrices
    rows = np.ascontiguousarray(parts.transpose(2, 1, 0))
    return Images(middle, shift, rows[:, :half], rows[:, half:])
