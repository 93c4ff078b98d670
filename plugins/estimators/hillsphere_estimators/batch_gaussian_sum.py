"""Batch estimation with Gaussian mixtures: the states at the start, for wide priors.

The measurements of an arc update a mixture of the states at the start, as
`hillsphere_estimators.mixture_update` does, one time after the other and then in growing groups.
The motion has no process noise. Several modes are kept, with their weights.

Where one mode is left, Gauss-Newton steps from its mean lead to the most probable states for the
prior and all measurements. If the measurements are linear enough across the covariance there, this
normal distribution is the result: it has lost nothing to curvature that counted as noise while
little was known. Otherwise the mixture is the result.

The rows of a group are compressed by QR decomposition: the columns of the states, of the curvature
and the residual are all that an update needs, however many rows there are [1]_.

References
----------
.. [1] Bierman (1977), Factorization methods for discrete sequential estimation, chapter V.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.casewise import refuse_no_cases
from hillsphere_estimators.curvature import curved_points, expand
from hillsphere_estimators.gaussian_sum import refuse_angles
from hillsphere_estimators.innovations import WhitenedInnovation, usable, whiten
from hillsphere_estimators.mixture import (
    Mixture,
    MixtureBelief,
    find_modes,
    mixture_of,
)
from hillsphere_estimators.mixture_update import update_mixture
from hillsphere_estimators.roots import upper_triangle
from hillsphere_estimators.sigma_points import update_mask

__all__ = ["batch_gaussian_sum"]

_NEAR = 4.0
"""Distance of the best fit from the mean of the mixture, in standard deviations of each state, at
most: in a linear problem both agree, and farther off the fit belongs to another mode."""
_SINGLY = 16
"""Times whose measurements update the mixture one after the other. The next groups have 2, 4, 8, …
times: every group is predicted from the start, so that single times would take their number squared
in model evaluations, and groups are curved no more once the states are known."""
_FAINT = 1e-6
"""Squares of a column of curvature, in units of the noise's variance, that are left out of a group:
a thousand times with ten such columns add a hundredth of that variance."""


def batch_gaussian_sum(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array] | None = None,
    *,
    components: int = 100,
    curvature: float = 0.05,
) -> MixtureBelief:
    """Return the states at the start of N cases, given all measurements.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements; its process noise is not used.
    prior : Belief
        States at the start; as wide as they are unknown.
    measurements : sequence of MeasurementSet
        At K times, in order.
    controls : sequence of ndarray, shape (p, N), optional
        K: before each time.
    components : int
        Components of a case at most.
    curvature : float
        Largest variance that curvature may add to all measurements of a component together, in
        units of the noise's variance, without a split.

    Returns
    -------
    MixtureBelief
        Mixture with its mean and covariance; `hillsphere_estimators.mixture.find_modes` gives its
        modes.

    Raises
    ------
    InputError
        If there is no case, not one control for each time, a limit is not positive, or the model
        has considered states or states that are angles.
    """
    refuse_no_cases(prior)
    cases = len(prior.t_s)
    if controls is None:
        controls = [np.zeros((0, cases))] * len(measurements)
    if len(controls) != len(measurements):
        raise InputError(
            f"there must be one control before each of {len(measurements)} times, got "
            f"{len(controls)}"
        )
    if components < 1 or not curvature > 0.0:
        raise InputError(
            f"components and curvature must be above zero, got {components} and {curvature:g}"
        )
    refuse_angles(model, len(prior.x))
    if update_mask(model, len(prior.x)) is not None:
        raise InputError("the batch estimates all states, but the model has considered ones")
    start, before = mixture_of(prior)

    unresolved = before.copy()
    mixture, first, size = start, 0, 1
    while first < len(measurements):
        last = min(first + size, len(measurements))

        def expand_at(at: Mixture, first: int = first, last: int = last) -> WhitenedInnovation:
            return _expand_arc(model, at, prior.t_s, measurements[:last], controls[:last], first)

        mixture, more = update_mixture(mixture, expand_at, prior.t_s, components, curvature)
        unresolved = np.maximum(unresolved, more)
        first = last
        if first >= _SINGLY:
            size *= 2
    found = MixtureBelief.of_mixture(mixture, prior.t_s, unresolved)
    return _finish_linear(model, prior, found, measurements, controls, curvature)


def _finish_linear(
    model: EstimationModel,
    prior: Belief,
    found: MixtureBelief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
    curvature: float,
) -> MixtureBelief:
    """Replace mixtures by the normal distribution of the best fit where that is good enough."""
    mixture, before = mixture_of(found)
    single = np.bincount(find_modes(found).owner) == 1
    # a prior that is a mixture itself is not normal: its best fit has no linear prior
    if not single.any() or len(mixture_of(prior)[0].owner) > mixture.cases:
        return found
    fit = batch_least_squares(model, prior, measurements, controls, start=found.x)
    at = Mixture.of(fit.belief)
    expected = _expand_arc(model, at, prior.t_s, measurements, controls, 0)
    bend = np.sum(expected.bent**2, axis=(1, 2))
    # the fit must also be where the mixture is: its steps may lead elsewhere
    off = np.linalg.solve(found.root, (fit.belief.x - found.x).T[:, :, None])
    near = np.sum(off**2, axis=(1, 2)) <= _NEAR**2 * len(prior.x)
    linear = single & fit.settled & (bend <= curvature) & near
    kept = mixture.take(~linear[mixture.owner]) if not linear.all() else None
    parts = at.take(linear) if linear.any() else None
    both = [m for m in (kept, parts) if m is not None]
    made = Mixture(
        np.concatenate([m.owner for m in both]),
        np.concatenate([m.weight for m in both]),
        np.concatenate([m.x for m in both], axis=1),
        np.concatenate([m.root for m in both]),
    )
    whole = made.take(np.arange(len(made.owner)))
    return MixtureBelief.of_mixture(whole, prior.t_s, np.where(linear, 0.0, before))


def _expand_arc(
    model: EstimationModel,
    at: Mixture,
    t_s: Array,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
    first: int,
) -> WhitenedInnovation:
    """Return the compressed innovations from the time `first` on, expanded about M components.

    There is a row for each column of `WhitenedInnovation` that is notable in any component at any
    of the times: at most the n states, all of curvature, and the residual.
    """
    owner = at.owner
    points = curved_points(at.lanes(t_s))
    n, each, many = points.shape
    lane = np.tile(owner, each)
    x, now = points.reshape(n, -1), t_s[lane]
    last = len(measurements)
    # rows before those of the residual, which stays the last column
    notable, upper = np.zeros(0, dtype=bool), np.zeros((many, 1, 1))
    for k, (measured, control) in enumerate(zip(measurements, controls, strict=True)):
        later = measured.t_s[lane]
        x, now = model.advance(x, now, later, control[:, lane], lane), later
        if k < first:
            continue
        layout, used = usable(measured)
        shown = layout.fitting(model.observe(x, now, lane)).reshape(-1, each, many)
        shift, linear, bent = expand(layout.difference(shown[:, 1:], shown[:, :1]), n)
        own = whiten(
            layout, measured.of_cases(owner), used[:, owner], shown[:, 0], shift, linear, bent
        )
        if last - first == 1 and layout.rows <= n + n * (n + 1) // 2:
            # fewer rows than the compressed ones
            return own
        columns = np.concatenate([own.linear, own.bent], axis=1)
        if not len(notable):
            notable = np.arange(columns.shape[1]) < n
            upper = np.zeros((many, n + 1, n + 1))
        # most curvature vanishes once the states are known, and its columns are most of the work
        more = notable | ~(np.sum(columns**2, axis=2).max(axis=0) <= _FAINT)
        if (more != notable).any():
            places = np.append(np.cumsum(more)[notable] - 1, more.sum())
            wider = np.zeros((many, more.sum() + 1, more.sum() + 1))
            wider[:, places[:, None], places] = upper
            notable, upper = more, wider
        columns = np.concatenate([columns[:, notable], own.residual[:, None]], axis=1)
        upper = upper_triangle(np.concatenate([upper, np.swapaxes(columns, 1, 2)], axis=1))
    rows = np.swapaxes(upper, 1, 2)
    q = rows.shape[1] - 1
    used = np.ones((q + 1, many), dtype=bool)
    return WhitenedInnovation(rows[:, q], rows[:, :n], rows[:, n:q], used)
