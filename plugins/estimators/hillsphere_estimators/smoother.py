r"""The Rauch–Tung–Striebel smoother in square-root form, linearised or by sigma points.

A belief x, P is predicted to x', P' with the cross-covariance C_x = Cov(x, x'). The smoother gain
is C = C_x P'⁻¹, and W Wᵀ = P − C P' Cᵀ is the covariance of x given x'. Backwards from the last
filtered belief

.. math::

    x_s = x + C (x'_s - x'), \quad P_s = W W^T + C P'_s C^T.

The covariance is a sum of squares, where the usual form P + C (P'_s − P') Cᵀ subtracts [1]_ [2]_.

References
----------
.. [1] Rauch, Tung, Striebel (1965), Maximum likelihood estimates of linear dynamic systems, AIAA
   Journal 3(8).
.. [2] Särkkä (2008), Unscented Rauch–Tung–Striebel smoother, IEEE Trans. Automatic Control 53(3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.convergence import regular_root
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.roots import lower_root, upper_triangle
from hillsphere_estimators.sigma_points import SigmaRule, transform_motion

__all__ = ["Link", "link", "smooth"]


@dataclass(frozen=True)
class Link:
    """The relation of a belief to the one predicted from it.

    Parameters
    ----------
    predicted : Belief
        The later one, before its measurements.
    gain : ndarray, shape (N, n, n)
        The smoother gain C.
    rest : ndarray, shape (N, n, n)
        W, lower triangular: root of the covariance of the earlier states given the later ones.
    """

    predicted: Belief
    gain: Array
    rest: Array


def link(
    model: EstimationModel,
    belief: Belief,
    t_to_s: Array,
    control: Array,
    rule: SigmaRule | None = None,
    about: Array | None = None,
) -> Link:
    """Predict a belief and return the smoother gain with it.

    Parameters
    ----------
    model : EstimationModel
        Motion model.
    belief : Belief
        After its measurements.
    t_to_s : ndarray, shape (N,)
        Later times, s.
    control : ndarray, shape (p, N)
        Controls.
    rule : SigmaRule, optional
        Sigma points; without it the motion is linearised.
    about : ndarray, shape (n, N), optional
        States about which it is linearised; the mean by default.

    Returns
    -------
    Link
        Its belief `predicted` is the one that the filter of that kind predicts.

    Raises
    ------
    InputError
        If the predicted covariance is singular, so that there is no gain.
    """
    noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
    before = np.swapaxes(belief.root, 1, 2)
    if rule is None:
        at = belief if about is None else Belief(about, belief.root, belief.t_s)
        x, phi = transition(model, at, t_to_s, control)
        if about is not None:
            x = x + (phi @ (belief.x - about).T[:, :, None])[:, :, 0].T
        odd, even = before @ np.swapaxes(phi, 1, 2), np.zeros((len(phi), 0, len(x)))
    else:
        images = transform_motion(rule, model, belief, t_to_s, control)
        x, odd, even = images.middle + images.shift, images.odd, images.even
    # rows of x' (left) and x (right): with [A B] = Q [U V; 0 Y], P' = Uᵀ U, C = (U⁻¹ V)ᵀ, W = Yᵀ;
    # the noise and the curvature are rows of x' alone
    cases, n = len(before), len(x)
    k = n + even.shape[1]
    rows = np.zeros((cases, k + noise.shape[2], 2 * n))
    rows[:, :n, :n], rows[:, n:k, :n] = odd, even
    rows[:, k:, :n] = np.swapaxes(noise, 1, 2)
    rows[:, :n, n:] = before
    upper = upper_triangle(rows)
    predicted = Belief(x, np.swapaxes(upper[:, :n, :n], 1, 2), t_to_s)
    own = np.swapaxes(regular_root(predicted), 1, 2)
    gain = np.swapaxes(np.linalg.solve(own, upper[:, :n, n:]), 1, 2)
    return Link(predicted, gain, np.swapaxes(upper[:, n:, n:], 1, 2))


def smooth(filtered: Sequence[Belief], links: Sequence[Link]) -> list[Belief]:
    """Return the beliefs at all times given all measurements.

    Parameters
    ----------
    filtered : sequence of Belief
        K beliefs, each after its own measurements.
    links : sequence of Link
        K − 1: from each to the next.

    Returns
    -------
    list of Belief
        K of them; the last is that of the filter.

    Raises
    ------
    InputError
        If there are not K − 1 links.
    """
    if len(links) != len(filtered) - 1:
        raise InputError(
            f"smoothing {len(filtered)} beliefs needs {len(filtered) - 1} links, got {len(links)}"
        )
    later = filtered[-1]
    smoothed = [later]
    for belief, tie in zip(filtered[-2::-1], links[::-1], strict=True):
        step = tie.gain @ (later.x - tie.predicted.x).T[:, :, None]
        # P_s = W Wᵀ + (C S'_s)(C S'_s)ᵀ
        rows = np.concatenate([tie.rest, tie.gain @ later.root], axis=2)
        later = Belief(belief.x + step[:, :, 0].T, lower_root(np.swapaxes(rows, 1, 2)), belief.t_s)
        smoothed.append(later)
    return smoothed[::-1]
