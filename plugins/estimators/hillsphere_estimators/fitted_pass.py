"""A filter and a smoother linearised about one trajectory; see `refit`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers, LinearisedModel
from hillsphere_estimators.constant_errors import ConstantErrors
from hillsphere_estimators.gauss_newton import linearise_measurements
from hillsphere_estimators.innovations import WhitenedInnovation, refer_to_prior, usable
from hillsphere_estimators.remainders import CURVED, measurement_curvature
from hillsphere_estimators.smoother import Link, link, smooth
from hillsphere_estimators.state_angles import state_angles, wrap_differences
from hillsphere_estimators.unscented import linear_update

__all__ = ["AllEstimated", "AtRest", "FittedPass", "pass_about", "score_constant_errors"]


@dataclass(frozen=True)
class FittedPass:
    """Filter and smoother about one trajectory, at K sets of measurements of N cases.

    Parameters
    ----------
    smoothed, predicted, filtered : list of Belief
        K: given all measurements, those before a set, and those up to it.
    links : list of Link
        K − 1: between the filtered beliefs.
    whitened : list of WhitenedInnovation
        K: innovations in units of the noise.
    innovations : list of Innovation
        K: the same in SI units.
    likelihood : ndarray, shape (N,)
        Logarithm of the likelihood of all measurements, but for a constant.
    """

    smoothed: list[Belief]
    predicted: list[Belief]
    filtered: list[Belief]
    links: list[Link]
    whitened: list[WhitenedInnovation]
    innovations: list[Innovation]
    likelihood: Array


class AllEstimated:
    """A model without considered states: a fit estimates all."""

    def __init__(self, model: EstimationModel) -> None:
        self.advance = model.advance
        self.observe = model.observe
        self.process_noise = model.process_noise
        self.angles = getattr(model, "angles", ())
        if isinstance(model, LinearisedModel):
            self.transition = model.transition
            self.sensitivity = model.sensitivity


class AtRest:
    """A model whose motion over no time is none; discrete models move at each call."""

    def __init__(self, model: EstimationModel) -> None:
        self._model = model
        self.observe = model.observe
        self.process_noise = model.process_noise
        self.angles = getattr(model, "angles", ())

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states later; the same ones over no time."""
        if np.array_equal(t0_s, t1_s):
            return x
        return self._model.advance(x, t0_s, t1_s, control, case)


def pass_about(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array],
    steps: bool,
    path: list[Array],
    origin: Array,
) -> FittedPass:
    """Filter and smooth with motion and measurements linearised about a trajectory.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements, without considered states (`AllEstimated`).
    prior : Belief
        N cases before the first set of measurements, at its time or before.
    measurements : sequence of MeasurementSet
        K sets.
    controls : sequence of ndarray, shape (p, N)
        K: before each set.
    steps : bool
        Whether there is motion between the prior and the first set.
    path : list of ndarray, shape (n, N)
        K: the trajectory at the times of the sets.
    origin : ndarray, shape (n, N)
        The state at the time of the prior, if that is before the first set.

    Returns
    -------
    FittedPass
        Beliefs and innovations at each set.
    """
    filtered, links, innovations = list[Belief](), list[Link](), list[Innovation]()
    predicted, whitened = list[Belief](), list[WhitenedInnovation]()
    likelihood = np.zeros(len(prior.t_s))
    belief, angles = prior, state_angles(model, len(prior.x))
    for k, (measured, control, x) in enumerate(zip(measurements, controls, path, strict=True)):
        if k:
            links.append(link(model, filtered[-1], measured.t_s, control, about=path[k - 1]))
            belief = links[-1].predicted
        elif steps:
            belief = link(model, prior, measured.t_s, control, about=origin).predicted
        layout, used = usable(measured)
        # the derivatives by differences take their steps from the belief
        at = linearise_measurements(
            model, Belief(x, belief.root, measured.t_s), layout, measured, used
        )
        # of angles the whole turns that are nearest to the predicted ones
        near = belief.x + wrap_differences(x - belief.x, angles)
        expected = refer_to_prior(belief, near, at)
        covariance = expected.covariance()
        residual = expected.residual[:, :, None]
        nis = np.sum(residual * np.linalg.solve(covariance, residual), axis=(1, 2))
        likelihood = likelihood - 0.5 * (nis + np.linalg.slogdet(covariance)[1])
        innovations.append(Innovation(expected.residual.T, covariance, used, nis))
        predicted.append(belief)
        whitened.append(expected)
        filtered.append(linear_update(belief, expected, 1.0, None))
    return FittedPass(
        smooth(filtered, links), predicted, filtered, links, whitened, innovations, likelihood
    )


def score_constant_errors(
    model: EstimationModel, fit: FittedPass, measurements: Sequence[MeasurementSet]
) -> ConstantErrors:
    """Return the score of constant errors, of the sets that are linear over what precedes them.

    The point of the linearisation depends on the measurements. Where the derivatives change over
    the predicted belief, the innovation about the fit is not normal, and its mean is not zero.

    Parameters
    ----------
    model : EstimationModel
        Measurement model.
    fit : FittedPass
        Pass about the fitted trajectory.
    measurements : sequence of MeasurementSet
        K sets.

    Returns
    -------
    ConstantErrors
        Score and information; zero where no set is linear.
    """
    cases, states, m = len(fit.likelihood), len(fit.predicted[0].x), len(measurements[0].values)
    errors = ConstantErrors(cases, states, m)
    for k, (belief, smoothed) in enumerate(zip(fit.predicted, fit.smoothed, strict=True)):
        if k:
            errors.move(fit.links[k - 1], fit.filtered[k - 1])
        expected = fit.whitened[k]
        wide = Belief(smoothed.x, belief.root, belief.t_s)
        rms, mean = measurement_curvature(model, wide, measurements[k], expected.used)
        linear = np.asarray(rms.max(axis=0, initial=0.0) <= CURVED)
        errors.add(belief, expected, expected.covariance(), linear, mean)
    return errors
