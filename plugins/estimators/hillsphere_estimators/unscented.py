"""The unscented Kalman filter in square-root form, for all cases at once.

Prediction and update are one QR decomposition each, of rows whose products are the covariance. No
covariance is formed or subtracted, so that none becomes indefinite. With the rows [Z X] of
predicted measurements and states in units of the noise, and the unit matrix for the noise itself,

    [Z X; 1 0] = Q [U V; 0 W],  U upper triangular,

the innovation covariance is Uᵀ U, the gain (U⁻¹ V)ᵀ, and Wᵀ W the updated covariance.

The linear update takes the mean slope over the prior for the slope at the posterior. It is
inconsistent where the prior is so wide that the measurements are curved across it. Two remedies are
offered:

- "tempered": the likelihood is applied in several powers, each small enough for curvature to stay
  below the noise, with new sigma points for each (progressive Bayes, [1]_);
- "iterated": the measurements are linearised about the posterior, repeatedly (posterior
  linearisation filter, [2]_).

The second is a Gauss-Newton iteration, which may diverge or oscillate. A long step to x is
therefore halved until it reduces [3]_

    |S⁻¹ (x − x̄)|² + ν(x)ᵀ (1 + Ω)⁻¹ ν(x),

S the root of the prior covariance, ν the innovation in units of the noise, and Ω the covariance of
the curvature over the sigma points, which is held during the halving. A case that has still not
converged after all iterations takes the tempered update.

References
----------
.. [1] Hanebeck, Briechle, Rauh (2003), Progressive Bayes: a new framework for nonlinear state
   estimation, SPIE 5099.
.. [2] García-Fernández, Svensson, Morelande, Särkkä (2015), Posterior linearization filter:
   principles and implementation using sigma points, IEEE Trans. Signal Processing 63(20).
.. [3] Raitoharju, Svensson, García-Fernández, Piché (2018), Damped posterior linearization filter,
   IEEE Signal Processing Letters 25(4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.casewise import CasewiseEstimator, drop_failed
from hillsphere_estimators.convergence import step_in_sigmas
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.gauss_newton import NEVER_HALVED_SIGMAS, halve_rising_steps
from hillsphere_estimators.innovations import (
    WhitenedInnovation,
    apply_gate,
    refer_to_prior,
    usable_at,
    whiten,
)
from hillsphere_estimators.linearisation import noise_between
from hillsphere_estimators.roots import (
    fix_signs,
    lower_root,
    solve_root,
    sort_roots,
    triangularise,
    unit,
)
from hillsphere_estimators.sigma_points import (
    Images,
    SigmaRule,
    transform_measurement,
    transform_motion,
    update_mask,
)
from hillsphere_estimators.specs import BatchedUnscentedSpec

__all__ = ["BatchedUnscented", "belief_of_images", "linear_update"]

_POWER_GROWTH = 10.0
"""Largest factor from one power of the likelihood to the next. The curvature at a belief says
little of the error that the powers before have left, so that a power that grows at once to all that
is left is again inconsistent; with a factor near 1 the number of powers grows for nothing."""
_DIVERGING_SIGMAS = 1.0
"""Last step, in standard deviations, beyond which a case counts as diverging and is updated in
powers. Shorter steps move within the posterior, where either update is as good."""


class BatchedUnscented(CasewiseEstimator):
    """An unscented Kalman filter in square-root form; `hillsphere.interfaces.Estimator`.

    Parameters
    ----------
    spec : BatchedUnscentedSpec
        Its parameters.
    """

    def __init__(self, spec: BatchedUnscentedSpec) -> None:
        self.spec = spec
        self.rule = SigmaRule(spec.alpha, spec.beta, spec.kappa)

    def _predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at other times."""
        noise = noise_between(model, belief, t_to_s, control)
        images = transform_motion(self.rule, model, belief, t_to_s, control)
        return belief_of_images(images, noise, t_to_s)

    def _update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation, NDArray[np.bool_]]:
        """Return the belief after measurements, the innovation, and which cases have failed."""
        spec = self.spec
        layout, used = usable_at(belief, measurements)
        free = update_mask(model, len(belief.x))

        expect = _Expectation(self.rule, model, layout, measurements)
        first, failed = drop_failed(expect(belief, used))
        prior, sorted_root = belief, sort_roots(belief.root, first.linear)
        if sorted_root is not None:
            prior = Belief(belief.x, sorted_root, belief.t_s)
            first, failed = drop_failed(expect(prior, used))
        if spec.gate_sigmas is not None:
            first = apply_gate(layout, first, spec.gate_sigmas)
        # one linear update leaves out the gain of considered states at once
        once = spec.update == "plain" or (spec.update == "iterated" and spec.iterations == 1)
        nis: Array | None = None
        if spec.update == "tempered":
            after = self._update_tempered(prior, first, expect)
        else:
            after, nis = _linear_update_with_nis(prior, first, 1.0, free if once else None)
        if spec.update == "iterated":
            after = self._update_iterated(belief, prior, after, first, expect)
        if free is not None and not once:
            # Schmidt's update, linearised about the solution for all states
            expected = expect(after, first.used)
            after = linear_update(prior, _relinearise(after, prior, expected), 1.0, free)
        return after, first.innovation(measurements.sigma, nis), failed

    def _update_tempered(
        self, belief: Belief, first: WhitenedInnovation, expect: _Expectation
    ) -> Belief:
        """Apply the likelihood in powers that add up to 1, each with new sigma points.

        A power is the largest for which the variance that curvature adds stays below that of the
        noise divided by the power. The last power is what is left, whatever the curvature.

        Parameters
        ----------
        belief : Belief
            Before the measurements.
        first : WhitenedInnovation
            The innovation at that belief, after the gate.
        expect : _Expectation
            The innovations at other beliefs.
        """
        result = _Results(belief)
        now, used, expected = belief, first.used, first
        left = np.ones(len(belief.t_s))
        last = np.full(left.shape, np.inf)
        for k in range(self.spec.powers):
            if k:
                expected = expect(now, used)
            # largest variance that curvature adds to a row, in units of the noise's
            bend = np.sum(expected.bent**2, axis=1).max(axis=1, initial=0.0)
            power = np.minimum(np.minimum(1.0 / np.maximum(bend, 1.0), _POWER_GROWTH * last), left)
            # the powers have run out: the likelihood must be applied as a whole
            if k == self.spec.powers - 1:
                power = left
            now = linear_update(now, expected, power, None)
            left, last = left - power, power
            going = left > 0.0
            if not going.all():
                own = result.finish(now, going)
                if not own.size:
                    break
                now, expect, used = now.of_cases(own), expect.of_cases(own), used[:, own]
                left, last = left[own], last[own]
        return result.belief

    def _update_iterated(
        self,
        belief: Belief,
        prior: Belief,
        after: Belief,
        first: WhitenedInnovation,
        expect: _Expectation,
    ) -> Belief:
        """Repeat the update with the measurements linearised about the posterior; see the module.

        Parameters
        ----------
        belief, prior, after : Belief
            Before the measurements, the same with sorted roots (`sort_roots`), and after the first
            linear update.
        first : WhitenedInnovation
            The innovation at the prior, after the gate.
        expect : _Expectation
            The innovations at other beliefs.
        """
        result, now = _Results(after), after
        far = np.zeros(len(belief.t_s))
        for _ in range(1, self.spec.iterations):
            expected = expect(now, first.used)
            there = linear_update(prior, _relinearise(now, prior, expected), 1.0, None)
            far = step_in_sigmas(there, now)
            # far may be NaN: compared so that it counts as long
            long = ~(far <= NEVER_HALVED_SIGMAS)
            if long.any():
                rises = _rise_test(belief, now, expected, expect)
                there = halve_rising_steps(now, there, long, rises)
            now, moving = there, ~(far <= self.spec.tolerance_sigmas)
            if not moving.all():
                own = result.finish(now, moving)
                if not own.size:
                    return result.belief
                now, far, expect = now.of_cases(own), far[own], expect.of_cases(own)
                belief, prior = belief.of_cases(own), prior.of_cases(own)
                first = first.of_cases(own)
        leaping = ~(far <= _DIVERGING_SIGMAS)
        own = result.finish(now, leaping)
        if own.size:
            prior, first = prior.of_cases(own), first.of_cases(own)
            now = self._update_tempered(prior, first, expect.of_cases(own))
            result.finish(now, np.zeros(own.size, dtype=bool))
        return result.belief


@dataclass(frozen=True)
class _Expectation:
    """Innovations of measurements at any belief.

    Parameters
    ----------
    rule : SigmaRule
        Parameters of the sigma points.
    model : EstimationModel
        Measurement model.
    layout : Layout
        Kinds of the m rows.
    measurements : MeasurementSet
        Values and standard deviations of the noise, of N cases.
    case : ndarray of int, shape (N,), optional
        Numbers of these cases in the model; by default 0 to N − 1.
    """

    rule: SigmaRule
    model: EstimationModel
    layout: Layout
    measurements: MeasurementSet
    case: Integers | None = None

    def __call__(self, at: Belief, rows: NDArray[np.bool_]) -> WhitenedInnovation:
        """Return the innovations at a belief, of rows (m, N)."""
        images = transform_measurement(self.rule, self.model, at, self.layout, self.case)
        return whiten(
            self.layout, self.measurements, rows,
            images.middle, images.shift, images.odd, images.even,
        )  # fmt: skip

    def of_cases(self, cases: Integers) -> _Expectation:
        """Return those of some cases, by their indices."""
        case = cases if self.case is None else self.case[cases]
        return replace(self, measurements=self.measurements.of_cases(cases), case=case)


class _Results:
    """Beliefs of N cases that finish one after the other.

    Only the cases that go on are computed further: one that needs forty iterations must not take
    the others with it.

    Parameters
    ----------
    belief : Belief
        Before any case has finished; at its times.
    """

    def __init__(self, belief: Belief) -> None:
        self._x, self._root, self._t_s = np.array(belief.x), np.array(belief.root), belief.t_s
        self._going = np.arange(len(belief.t_s))

    def finish(self, now: Belief, going: NDArray[np.bool_]) -> Integers:
        """Take the results of the cases that do not go on.

        Parameters
        ----------
        now : Belief
            Of the cases that have not finished before.
        going : ndarray of bool
            Which of these go on.

        Returns
        -------
        ndarray of int
            Their indices among these.
        """
        done = np.flatnonzero(~going)
        own = self._going[done]
        self._x[:, own], self._root[own] = now.x[:, done], now.root[done]
        left = np.flatnonzero(going)
        self._going = self._going[left]
        return left

    @property
    def belief(self) -> Belief:
        """The beliefs of all cases."""
        return Belief(self._x, self._root, self._t_s)


def belief_of_images(images: Images, noise: Array, t_s: Array) -> Belief:
    """Return the predicted belief of images of sigma points and process noise.

    Parameters
    ----------
    images : Images
        Images of n rows, from `transform_motion`.
    noise : ndarray, shape (N, n, r)
        Roots of the covariance of the process noise.
    t_s : ndarray, shape (N,)
        Times of the images, s.

    Returns
    -------
    Belief
        Mean y_0 + ē; the covariance is the sum of the squares of all rows.
    """
    rows = np.concatenate([images.odd, images.even, np.swapaxes(noise, 1, 2)], axis=1)
    return Belief(images.middle + images.shift, lower_root(rows), t_s)


def linear_update(
    belief: Belief, expected: WhitenedInnovation, power: Array | float, free: Array | None
) -> Belief:
    """Return the belief after the linear (Kalman) update with whitened measurements.

    Parameters
    ----------
    belief : Belief
        Before the measurements.
    expected : WhitenedInnovation
        The innovation; its linear rows belong to the rows of the transposed root of the belief.
    power : ndarray, shape (N,), or float
        Power of the likelihood: the variance of the noise is divided by it.
    free : ndarray, shape (n,), or None
        1 for estimated states and 0 for considered ones, whose rows of the optimal gain are left
        out (Schmidt's update); None if all are estimated.

    Returns
    -------
    Belief
        After the measurements.
    """
    return _linear_update_with_nis(belief, expected, power, free)[0]


def _linear_update_with_nis(
    belief: Belief, expected: WhitenedInnovation, power: Array | float, free: Array | None
) -> tuple[Belief, Array]:
    """Return the updated belief and the normalised innovation squared (N,).

    The residual r is one more column of the decomposition, 0 beside Z and r beside the unit matrix.
    The reflections turn it into a column that begins with U⁻ᵀ r, whose square is the NIS.
    """
    # noise of variance 1/power: rows of the measurements times √power, the noise's rows stay 1
    root_power = np.sqrt(power)
    each = root_power[:, None, None] if root_power.ndim else root_power
    cases, k, m = expected.linear.shape
    bent, n = expected.bent.shape[1], len(belief.x)
    residual = (root_power * expected.residual.T).T
    # rows: states, curvature (uncorrelated with the states), noise; columns: Z, X, residual
    rows = np.zeros((cases, k + bent + m, m + n + 1))
    np.multiply(each, expected.linear, out=rows[:, :k, :m])
    rows[:, :k, m : m + n] = np.swapaxes(belief.root, 1, 2)
    np.multiply(each, expected.bent, out=rows[:, k : k + bent, :m])
    rows[:, k + bent :, :m] = unit(m)
    rows[:, k + bent :, m + n] = residual
    # the raw result is transposed: its lower triangle holds Uᵀ, Vᵀ and Wᵀ
    raw = triangularise(rows)
    white = raw[:, m + n, :m]
    if free is None:
        # gain times residual = Vᵀ U⁻ᵀ r
        step = raw[:, m : m + n, :m] @ white[:, :, None]
        root = fix_signs(raw[:, m : m + n, m : m + n])
    else:
        upper = np.triu(np.swapaxes(raw[:, :m, :m], 1, 2))
        gain = np.swapaxes(np.linalg.solve(upper, np.swapaxes(raw[:, m : m + n, :m], 1, 2)), 1, 2)
        # Schmidt: considered states have no gain; the covariance is then that of X − Z Kᵀ, with the
        # noise's rows (Joseph's form), and not the optimal W
        gain *= free[:, None]
        step = gain @ residual[:, :, None]
        states = rows[:, :, m : m + n]
        root = lower_root(states - rows[:, :, :m] @ np.swapaxes(gain, 1, 2))
    after = Belief(belief.x + step[:, :, 0].T, root, belief.t_s)
    return after, np.einsum("Nm,Nm->N", white, white)


def _relinearise(at: Belief, prior: Belief, expected: WhitenedInnovation) -> WhitenedInnovation:
    """Return the innovation of a linearisation about `at` for the update of the prior.

    The linear rows, of the sigma points of `at`, are divided by its root: Sᵀ H = rows, H the
    slopes.
    """
    slopes = solve_root(at.root, expected.linear, transposed=True)
    return refer_to_prior(
        prior, at.x, replace(expected, linear=np.asarray(slopes, dtype=np.float64))
    )


def _rise_test(
    prior: Belief, at: Belief, expected: WhitenedInnovation, expect: _Expectation
) -> Callable[[Array, Integers], NDArray[np.bool_]]:
    """Return the function from states to where the sum of squares exceeds that of `at`.

    The sum is that of the module; the curvature Ω is held at the value of `expected`. The function
    takes states (n, K) of some cases, and their indices (K,).
    """
    cases, _, m = expected.bent.shape
    noise = np.broadcast_to(unit(m), (cases, m, m))
    # a root of 1 + Ω
    spread = lower_root(np.concatenate([expected.bent, noise], axis=1))

    def squares(x: Array, residual: Array, own: Integers) -> Array:
        off = solve_root(prior.root[own], (x - prior.x[:, own]).T[:, :, None])
        missed = np.linalg.solve(spread[own], residual[:, :, None])
        return np.asarray(np.sum(off**2, axis=(1, 2)) + np.sum(missed**2, axis=(1, 2)))

    now = squares(at.x, expected.residual, np.arange(cases))

    def rises(x: Array, own: Integers) -> NDArray[np.bool_]:
        there = Belief(x, at.root[own], at.t_s[own])
        residual = expect.of_cases(own)(there, expected.used[:, own]).residual
        return ~(squares(x, residual, own) <= now[own])

    return rises
