"""The unscented Kalman filter in square-root form, on all cases at once.

Prediction and update are one orthogonal triangularisation each, of rows whose products are the
covariance: no covariance is formed and none is subtracted. With the rows [Z X] of expected
measurements and states in units of the noise, and the unit matrix for the noise,

    [Z X; 1 0] = Q [U V; 0 W],  U upper triangular,

the innovation's covariance is Uᵀ U, the gain (U⁻¹ V)ᵀ, and W is the root of the updated covariance.

Where a prior is wide beside what the measurements see, one linear update is inconsistent: it takes
the slope at the prior for that at the posterior. Two ways out are offered: the likelihood in
several powers, each small enough to be nearly linear, with sigma points drawn anew [1]_; or
linearisation about the posterior, repeated until it rests [2]_.

References
----------
.. [1] Progressive Bayes: Hanebeck, Briechle, Rauh (2003), Progressive Bayes: a new framework for
   nonlinear state estimation, SPIE 5099.
.. [2] García-Fernández, Svensson, Morelande, Särkkä (2015), Posterior linearization filter:
   principles and implementation using sigma points, IEEE Trans. Signal Processing 63(20).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.innovations import Expected, about_prior, gated, usable, whitened
from hillsphere_estimators.resting import distance, regular_root, rested
from hillsphere_estimators.roots import cleaned, lower_root, triangularised, unit
from hillsphere_estimators.sigma_points import Images, SigmaRule, considered, moved, seen
from hillsphere_estimators.specs import BatchedUnscentedSpec

__all__ = ["BatchedUnscented", "absorbed", "predicted"]

Expectation: TypeAlias = Callable[[Belief, NDArray[np.bool_]], Expected]

_GROWTH = 10.0
"""Of one power of the likelihood to the next, at most."""


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
        images = moved(self.rule, model, belief, t_to_s, control)
        noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
        return predicted(images, noise, t_to_s)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`."""
        spec = self.spec
        layout, used = usable(measurements)
        free = considered(model, len(belief.x))

        def expect(at: Belief, rows: NDArray[np.bool_]) -> Expected:
            images = seen(self.rule, model, at, layout)
            return whitened(
                layout, measurements, rows, images.middle, images.shift, images.odd, images.even
            )

        first = expect(belief, used)
        if spec.gate_sigmas is not None:
            first = gated(layout, first, spec.gate_sigmas)
        if spec.update == "tempered":
            after, nis = self._tempered(belief, first, expect, free), None
        else:
            after, nis = _weighed(belief, first, 1.0, free)
        if spec.update == "iterated":
            after = self._iterated(belief, after, first, expect, free)
        return after, first.innovation(measurements.sigma, nis)

    def _tempered(
        self, belief: Belief, first: Expected, expect: Expectation, free: Array | None
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
            power = np.minimum(np.minimum(1.0 / np.maximum(bend, 1.0), _GROWTH * last), left)
            if k == self.spec.powers - 1:
                power = left
            after = rested(left > 0.0, absorbed(after, expected, power, free), after)
            left, last = left - power, power
            if not left.any():
                break
        return after

    def _iterated(
        self,
        belief: Belief,
        after: Belief,
        first: Expected,
        expect: Expectation,
        free: Array | None,
    ) -> Belief:
        """Linearise about the posterior until it rests."""
        moving = np.ones(len(belief.t_s), dtype=bool)
        for _ in range(1, self.spec.iterations):
            expected = _about(after, belief, expect(after, first.used))
            again = rested(moving, absorbed(belief, expected, 1.0, free), after)
            moving &= distance(again, after) > self.spec.tolerance_sigmas
            after = again
            if not moving.any():
                break
        return after


def predicted(images: Images, noise: Array, t_s: Array) -> Belief:
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


def absorbed(
    belief: Belief, expected: Expected, power: Array | float, free: Array | None
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
    return _weighed(belief, expected, power, free)[0]


def _weighed(
    belief: Belief, expected: Expected, power: Array | float, free: Array | None
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
    raw = triangularised(rows)
    white = raw[:, m + n, :m]
    if free is None:
        step = raw[:, m : m + n, :m] @ white[:, :, None]
        root = cleaned(raw[:, m : m + n, m : m + n])
    else:
        upper = np.triu(np.swapaxes(raw[:, :m, :m], 1, 2))
        gain = np.swapaxes(np.linalg.solve(upper, np.swapaxes(raw[:, m : m + n, :m], 1, 2)), 1, 2)
        gain *= free[:, None]
        step = gain @ residual[:, :, None]
        states = rows[:, :, m : m + n]
        root = lower_root(states - rows[:, :, :m] @ np.swapaxes(gain, 1, 2))
    after = Belief(belief.x + step[:, :, 0].T, root, belief.t_s)
    return after, np.einsum("Nm,Nm->N", white, white)


def _about(at: Belief, prior: Belief, expected: Expected) -> Expected:
    """Return what a linearisation about one belief says of measurements expected by another."""
    slopes = np.linalg.solve(np.swapaxes(regular_root(at), 1, 2), expected.linear)
    return about_prior(prior, at.x, replace(expected, linear=np.asarray(slopes, dtype=np.float64)))
