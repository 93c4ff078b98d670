r"""The Rauch–Tung–Striebel smoother in square-root form, linearised or by sigma points.

A belief x, P is predicted to x', P' with the cross-covariance C_x = Cov(x, x'). The smoother gain
is C = C_x P'⁻¹, and W Wᵀ = P − C P' Cᵀ is the covariance of x given x'. Backwards from the last
filtered belief

.. math::

    x_s = x + C (x'_s - x'), \quad P_s = W W^T + C P'_s C^T.

The covariance is a sum of squares, where the usual form P + C (P'_s − P') Cᵀ subtracts [1]_ [2]_.

Considered states are not smoothed: at each time they keep mean and covariance of the filter. The
others are smoothed as above, and their covariance is that of their errors although Schmidt's filter
is not the best one, since the error of x − C x' is uncorrelated with that of x', through which
alone those of later times depend on it. With the errors e of the filter after and e' before the
measurements, N = Cov(e, e') has the rows of P for states that are estimated and those of P' for
considered ones. The covariance X = Cov(e_s, e), of which the correlation of smoothed and considered
states is a part, follows backwards by

.. math:: X = W W^T + C\, (X_+ P_+^{-1} N_+)\, C^T, \quad X_K = P_K,

where + is the next time.

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
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.casewise import mark_failed, replace_failed
from hillsphere_estimators.linearisation import noise_between, transition
from hillsphere_estimators.roots import find_singular, lower_root, solve_root, upper_triangle
from hillsphere_estimators.sigma_points import SigmaRule, transform_motion, update_mask
from hillsphere_estimators.state_angles import state_angles, wrap_differences, wrap_means

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
    free : ndarray, shape (n,), optional
        1 for estimated states and 0 for considered ones; None if all are estimated.
    angles : tuple of int
        States that are angles.
    """

    predicted: Belief
    gain: Array
    rest: Array
    free: Array | None = None
    angles: tuple[int, ...] = ()


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
        Its belief `predicted` is the one that the filter of that kind predicts, NaN in cases that
        have failed.

    Raises
    ------
    InputError
        If a single case has failed, or a case is predicted backward over process noise.
    """
    belief, failed, control = replace_failed(belief, control)
    noise = noise_between(model, belief, t_to_s, control)
    before = np.swapaxes(belief.root, 1, 2)
    if rule is None:
        at = belief if about is None else Belief(about, belief.root, belief.t_s)
        x, phi = transition(model, at, t_to_s, control)
        if about is not None:
            off = wrap_differences(belief.x - about, state_angles(model, len(x)))
            x = x + (phi @ off.T[:, :, None])[:, :, 0].T
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
    cross = upper[:, :n, n:]
    solved = solve_root(predicted.root, cross, transposed=True)
    rest = np.swapaxes(upper[:, n:, n:], 1, 2)
    singular = find_singular(predicted.root)
    if singular.any():
        # what of V is not in the range of a singular U is not explained by x': it belongs to W
        alone = cross - np.swapaxes(predicted.root, 1, 2) @ solved
        alone = np.where(singular[:, None, None], alone, 0.0)
        more = lower_root(np.concatenate([np.swapaxes(rest, 1, 2), alone], axis=1))
        rest = np.where(singular[:, None, None], more, rest)
    failed = failed | ~predicted.finite
    if failed.any() and cases == 1:
        raise InputError(
            f"the prediction from {belief.t_s[0]:.12g} s to {t_to_s[0]:.12g} s is not finite"
        )
    angles = state_angles(model, n)
    return Link(
        wrap_means(mark_failed(predicted, failed), angles),
        np.swapaxes(solved, 1, 2),
        rest,
        update_mask(model, n),
        tuple(angles),
    )


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
        K of them; the last is that of the filter. Considered states are those of the filter at all
        times. A case that has failed at any time (NaN) has failed at all before.

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
    smoothed, cross = [later], later.covariance
    for belief, after, tie in zip(filtered[-2::-1], filtered[:0:-1], links[::-1], strict=True):
        off = wrap_differences(later.x - tie.predicted.x, tie.angles)
        step = tie.gain @ off.T[:, :, None]
        # P_s = W Wᵀ + (C S'_s)(C S'_s)ᵀ
        rows = np.concatenate([tie.rest, tie.gain @ later.root], axis=2)
        later = Belief(belief.x + step[:, :, 0].T, lower_root(np.swapaxes(rows, 1, 2)), belief.t_s)
        if tie.free is None:
            smoothed.append(wrap_means(later, tie.angles))
            continue
        cross = _cross_covariance(tie, after, cross, tie.free)
        smoothed.append(wrap_means(_hold_considered(later, belief, cross, tie.free), tie.angles))
    return smoothed[::-1]


def _cross_covariance(tie: Link, after: Belief, cross: Array, free: Array) -> Array:
    """Return X (N, n, n), see the module, from that of the next time.

    Parameters
    ----------
    tie : Link
        From this time to the next.
    after : Belief
        The filter's belief at the next time, after its measurements.
    cross : ndarray, shape (N, n, n)
        X of the next time.
    free : ndarray, shape (n,)
        0 for considered states.
    """
    both = np.where(free[:, None] > 0.0, after.covariance, tie.predicted.covariance)
    # P₊⁻¹ N₊ = S⁻ᵀ S⁻¹ N₊
    share = solve_root(after.root, solve_root(after.root, both), transposed=True)
    inner = tie.gain @ (cross @ share) @ np.swapaxes(tie.gain, 1, 2)
    return np.asarray(tie.rest @ np.swapaxes(tie.rest, 1, 2) + inner)


def _hold_considered(smoothed: Belief, filtered: Belief, cross: Array, free: Array) -> Belief:
    """Return a smoothed belief with the considered states, 0 in `free`, of the filter.

    The joint covariance of both is assembled over the standard deviations; its root is that of its
    eigenvalues, of which none is less than zero but by rounding.
    """
    estimated = free > 0.0
    x = np.where(estimated[:, None], smoothed.x, filtered.x)
    rows = estimated[:, None]
    covariance = np.where(rows & estimated, smoothed.covariance, cross)
    covariance = np.where(rows | ~estimated, covariance, np.swapaxes(cross, 1, 2))
    covariance = np.where(rows | estimated, covariance, filtered.covariance)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    size = np.where(sigma > 0.0, sigma, 1.0)
    scaled = covariance / (size[:, :, None] * size[:, None])
    sound: NDArray[np.bool_] = np.asarray(np.isfinite(scaled).all(axis=(1, 2)))
    scaled = np.where(sound[:, None, None], scaled, np.eye(len(free)))
    values, vectors = np.linalg.eigh(0.5 * (scaled + np.swapaxes(scaled, 1, 2)))
    root = size[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    belief = Belief(x, lower_root(np.swapaxes(root, 1, 2)), filtered.t_s)
    return mark_failed(belief, ~sound)
