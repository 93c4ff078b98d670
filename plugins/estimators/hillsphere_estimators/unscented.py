"""The unscented Kalman filter in square-root form, on all cases at once.

Prediction and update are one orthogonal triangularisation each, of rows whose products are the
covariance: no covariance is formed and none is subtracted. With the rows [Z X] of expected
measurements and states in units of the noise, and the unit matrix for the noise,

    [Z X; 1 0] = Q [U V; 0 W],  U upper triangular,

the innovation's covariance is Uᵀ U, the gain (U⁻¹ V)ᵀ, and W is the root of the updated covariance.

Where a prior is wide beside what the measurements see, one linear update is inconsistent: it takes
the slope at the prior for that at the posterior. Two ways out are offered: the likelihood in
several powers, each small enough to be nearly linear, with sigma points drawn anew [1]_; or
linearisation about the posterior, repeated until it rests [2]_. The latter is Gauss's and Newton's
method: undamped it may leap to and fro for ever. So a long step to x is halved until, with the
spread of the points and the curvature Ω that they have seen held, it lessens [3]_

    |S⁻¹ (x − x̄)|² + ν(x)ᵀ (1 + Ω)⁻¹ ν(x),

S the root of the prior covariance and ν what was measured minus the mean of what the points about x
show, in units of the noise. A case that still leaps when its iterations run out takes the update
in powers.

References
----------
.. [1] Progressive Bayes: Hanebeck, Briechle, Rauh (2003), Progressive Bayes: a new framework for
   nonlinear state estimation, SPIE 5099.
.. [2] García-Fernández, Svensson, Morelande, Särkkä (2015), Posterior linearization filter:
   principles and implementation using sigma points, IEEE Trans. Signal Processing 63(20).
.. [3] Raitoharju, Svensson, García-Fernández, Piché (2018), Damped posterior linearization filter,
   IEEE Signal Processing Letters 25(4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.convergence import freeze_converged, regular_root, step_in_sigmas
from hillsphere_estimators.gauss_newton import NEVER_HALVED_SIGMAS, halve_rising_steps
from hillsphere_estimators.innovations import (
    WhitenedInnovation,
    apply_gate,
    refer_to_prior,
    usable_at,
    whiten,
)
from hillsphere_estimators.roots import fix_signs, lower_root, triangularise, unit
from hillsphere_estimators.sigma_points import (
    Images,
    SigmaRule,
    transform_measurement,
    transform_motion,
    update_mask,
)
from hillsphere_estimators.specs import BatchedUnscentedSpec

__all__ = ["BatchedUnscented", "belief_of_images", "linear_update"]

InnovationAt: TypeAlias = Callable[[Belief, NDArray[np.bool_]], WhitenedInnovation]

_POWER_GROWTH = 10.0
"""Of one power of the likelihood to the next, at most."""
_DIVERGING_SIGMAS = 1.0
"""Last step, in standard deviations, beyond which an iteration leads nowhere."""


class BatchedUnscented:
    """An unscented Kalman filter (see the module); `hillsphere.interfaces.Estimator`.

    Parameters
    ----------
    spec : BatchedUnscentedSpec
        Its parameters.
    """

    def __init__(self, spec: BatchedUnscentedSpec) -> None:
        self.spec = spec
        self.rule = SigmaRule(spec.alpha, spec.beta, spec.kappa)

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times; see `hillsphere.interfaces.Estimator`."""
        images = transform_motion(self.rule, model, belief, t_to_s, control)
        noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
        return belief_of_images(images, noise, t_to_s)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`."""
        spec = self.spec
        layout, used = usable_at(belief, measurements)
        free = update_mask(model, len(belief.x))

        def expect(at: Belief, rows: NDArray[np.bool_]) -> WhitenedInnovation:
            images = transform_measurement(self.rule, model, at, layout)
            return whiten(
                layout, measurements, rows, images.middle, images.shift, images.odd, images.even
            )

        first = expect(belief, used)
        if spec.gate_sigmas is not None:
            first = apply_gate(layout, first, spec.gate_sigmas)
        if spec.update == "tempered":
            after, nis = self._update_tempered(belief, first, expect, free), None
        else:
            after, nis = _linear_update_with_nis(belief, first, 1.0, free)
        if spec.update == "iterated":
            after = self._update_iterated(belief, after, first, expect, free)
        return after, first.innovation(measurements.sigma, nis)

    def _update_tempered(
        self, belief: Belief, first: WhitenedInnovation, expect: InnovationAt, free: Array | None
    ) -> Belief:
        """Take the likelihood power by power, each such that curvature stays below the noise.

        The power may not grow too fast either: the curvature at one power's belief says little of
        the error that the powers before have left.
        """
        after, left = belief, np.ones(len(belief.t_s))
        last = np.full(left.shape, np.inf)
        for k in range(self.spec.powers):
            expected = expect(after, first.used) if k else first
            bend = np.sum(expected.bent**2, axis=1).max(axis=1, initial=0.0)
            power = np.minimum(np.minimum(1.0 / np.maximum(bend, 1.0), _POWER_GROWTH * last), left)
            if k == self.spec.powers - 1:
                power = left
            after = freeze_converged(left > 0.0, linear_update(after, expected, power, free), after)
            left, last = left - power, power
            if not left.any():
                break
        return after

    def _update_iterated(
        self,
        belief: Belief,
        after: Belief,
        first: WhitenedInnovation,
        expect: InnovationAt,
        free: Array | None,
    ) -> Belief:
        """Linearise about the posterior until it rests; see the module."""
        moving = np.ones(len(belief.t_s), dtype=bool)
        far = np.zeros(len(belief.t_s))
        for _ in range(1, self.spec.iterations):
            expected = expect(after, first.used)
            there = linear_update(belief, _relinearise(after, belief, expected), 1.0, free)
            far = step_in_sigmas(there, after)
            # far may be NaN; a step that leaves states out does not lessen the sum that is watched
            long = moving & ~(far <= NEVER_HALVED_SIGMAS)
            if free is None and long.any():
                rises = _rise_test(belief, after, expected, expect)
                there = halve_rising_steps(after, there, long, rises)
            after = freeze_converged(moving, there, after)
            moving &= ~(far <= self.spec.tolerance_sigmas)
            if not moving.any():
                return after
        leaping = moving & ~(far <= _DIVERGING_SIGMAS)
        if leaping.any():
            after = freeze_converged(
                leaping, self._update_tempered(belief, first, expect, free), after
            )
        return after


def belief_of_images(images: Images, noise: Array, t_s: Array) -> Belief:
    """Return the belief that images of sigma points and process noise make.

    Parameters
    ----------
    images : Images
        Of n rows.
    noise : ndarray, shape (N, n, r)
        Roots of the noise's covariance.
    t_s : ndarray, shape (N,)
        Times, s.

    Returns
    -------
    Belief
        At these times.
    """
    rows = np.concatenate([images.odd, images.even, np.swapaxes(noise, 1, 2)], axis=1)
    return Belief(images.middle + images.shift, lower_root(rows), t_s)


def linear_update(
    belief: Belief, expected: WhitenedInnovation, power: Array | float, free: Array | None
) -> Belief:
    """Return the belief after measurements.

    Parameters
    ----------
    belief : Belief
        Before.
    expected : Expected
        The measurements; its linear rows go with the rows of the transposed root.
    power : ndarray, shape (N,), or float
        Of the likelihood: the noise's variance is divided by it.
    free : ndarray, shape (n,), or None
        1 for states that are estimated, 0 for those that are only considered (Schmidt's update:
        the optimal gain without the rows of these); None if all are.

    Returns
    -------
    Belief
        After.
    """
    return _linear_update_with_nis(belief, expected, power, free)[0]


def _linear_update_with_nis(
    belief: Belief, expected: WhitenedInnovation, power: Array | float, free: Array | None
) -> tuple[Belief, Array]:
    """Return the belief after measurements, and the normalised innovation squared (N,).

    The residual r is one more column, 0 beside Z and r beside the unit matrix: what Householder's
    reflections make of it begins with U⁻ᵀ r.
    """
    root_power = np.sqrt(power)
    each = root_power[:, None, None] if root_power.ndim else root_power
    cases, k, m = expected.linear.shape
    bent, n = expected.bent.shape[1], len(belief.x)
    residual = (root_power * expected.residual.T).T
    rows = np.zeros((cases, k + bent + m, m + n + 1))
    np.multiply(each, expected.linear, out=rows[:, :k, :m])
    rows[:, :k, m : m + n] = np.swapaxes(belief.root, 1, 2)
    np.multiply(each, expected.bent, out=rows[:, k : k + bent, :m])
    rows[:, k + bent :, :m] = unit(m)
    rows[:, k + bent :, m + n] = residual
    raw = triangularise(rows)
    white = raw[:, m + n, :m]
    if free is None:
        step = raw[:, m : m + n, :m] @ white[:, :, None]
        root = fix_signs(raw[:, m : m + n, m : m + n])
    else:
        upper = np.triu(np.swapaxes(raw[:, :m, :m], 1, 2))
        gain = np.swapaxes(np.linalg.solve(upper, np.swapaxes(raw[:, m : m + n, :m], 1, 2)), 1, 2)
        gain *= free[:, None]
        step = gain @ residual[:, :, None]
        states = rows[:, :, m : m + n]
        root = lower_root(states - rows[:, :, :m] @ np.swapaxes(gain, 1, 2))
    after = Belief(belief.x + step[:, :, 0].T, root, belief.t_s)
    return after, np.einsum("Nm,Nm->N", white, white)


def _relinearise(at: Belief, prior: Belief, expected: WhitenedInnovation) -> WhitenedInnovation:
    """Return what a linearisation about one belief says of measurements expected by another."""
    slopes = np.linalg.solve(np.swapaxes(regular_root(at), 1, 2), expected.linear)
    return refer_to_prior(
        prior, at.x, replace(expected, linear=np.asarray(slopes, dtype=np.float64))
    )


def _rise_test(
    prior: Belief, at: Belief, expected: WhitenedInnovation, expect: InnovationAt
) -> Callable[[Array], NDArray[np.bool_]]:
    """Return where states (n, N) have a greater sum of squares than a belief (see the module)."""
    cases, _, m = expected.bent.shape
    noise = np.broadcast_to(unit(m), (cases, m, m))
    spread = lower_root(np.concatenate([expected.bent, noise], axis=1))

    def squares(x: Array, residual: Array) -> Array:
        off = np.linalg.solve(regular_root(prior), (x - prior.x).T[:, :, None])
        missed = np.linalg.solve(spread, residual[:, :, None])
        return np.asarray(np.sum(off**2, axis=(1, 2)) + np.sum(missed**2, axis=(1, 2)))

    now = squares(at.x, expected.residual)

    def rises(x: Array) -> NDArray[np.bool_]:
        residual = expect(Belief(x, at.root, at.t_s), expected.used).residual
        return ~(squares(x, residual) <= now)

    return rises
