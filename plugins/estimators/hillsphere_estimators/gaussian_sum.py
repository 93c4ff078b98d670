"""A filter whose belief is a Gaussian mixture, for all cases at once: the choice for wide priors.

References
----------
.. [1] Alspach, Sorenson (1972), Nonlinear Bayesian estimation using Gaussian sum approximations,
   IEEE Trans. Automatic Control 17(4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.curvature import curved_points, expand
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.innovations import (
    WhitenedInnovation,
    apply_gate,
    usable_at,
    whiten,
)
from hillsphere_estimators.linearisation import noise_between
from hillsphere_estimators.mixture import Mixture, MixtureBelief, mixture_of
from hillsphere_estimators.mixture_update import expand_in_parts, update_mixture
from hillsphere_estimators.sigma_points import SigmaRule, transform_motion, update_mask
from hillsphere_estimators.specs import GaussianSumSpec
from hillsphere_estimators.state_angles import state_angles
from hillsphere_estimators.unscented import belief_of_images

__all__ = ["GaussianSum", "refuse_angles"]


def refuse_angles(model: EstimationModel, n: int) -> None:
    """Refuse a model some of whose states are angles: mixtures take states for numbers on a line.

    Parameters
    ----------
    model : EstimationModel
        The model.
    n : int
        Number of states.

    Raises
    ------
    InputError
        If it has such states.
    """
    if angles := state_angles(model, n):
        raise InputError(
            f"mixtures take states for numbers on a line, but states {list(angles)} of the model "
            "are angles; take an estimator of type unscented or iterated_extended"
        )


class GaussianSum:
    """A Gaussian-sum filter [1]_; `hillsphere.interfaces.Estimator`.

    Its beliefs are `hillsphere_estimators.mixture.MixtureBelief`. Each component moves by the
    unscented transform; the update is that of `hillsphere_estimators.mixture_update`.

    Parameters
    ----------
    spec : GaussianSumSpec
        Its parameters.
    """

    considers = False
    """It estimates all states, see `hillsphere.interfaces.Estimator`."""

    def __init__(self, spec: GaussianSumSpec) -> None:
        self.spec = spec
        self.rule = SigmaRule()

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times; see `hillsphere.interfaces.Estimator`.

        Raises
        ------
        InputError
            If states of the model are angles, of which the means of components would not be points
            on a circle, or a case is predicted backward over process noise.
        """
        refuse_angles(model, len(belief.x))
        mixture, unresolved = mixture_of(belief)
        owner = mixture.owner
        images = transform_motion(
            self.rule, _ComponentModel(model, owner), mixture.lanes(belief.t_s), t_to_s[owner],
            control[:, owner],
        )  # fmt: skip
        # the noise at the mean of a case, as in other filters
        noise = noise_between(model, belief, t_to_s, control)[owner]
        moved = belief_of_images(images, noise, t_to_s[owner])
        after = Mixture(owner, mixture.weight, moved.x, moved.root)
        return MixtureBelief.of_mixture(after, t_to_s, unresolved)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`.

        Raises
        ------
        InputError
            If the model has considered states: the weights of components would estimate them. If
            states of the model are angles.
        """
        spec = self.spec
        refuse_angles(model, len(belief.x))
        layout, used = usable_at(belief, measurements)
        if update_mask(model, len(belief.x)) is not None:
            raise InputError(
                "the Gaussian-sum filter estimates all states, but the model has considered ones; "
                "take an estimator of type unscented or iterated_extended"
            )
        mixture, before = mixture_of(belief)

        def expand_at(at: Mixture) -> WhitenedInnovation:
            return _expand_measurement(model, at, belief.t_s, layout, measurements, used)

        first = _moments_of_innovation(mixture, expand_in_parts(mixture, expand_at), used)
        if spec.gate_sigmas is not None:
            first = apply_gate(layout, first, spec.gate_sigmas)
            used = first.used
        after, unresolved = update_mixture(
            mixture, expand_at, belief.t_s, spec.components, spec.curvature
        )
        made = MixtureBelief.of_mixture(after, belief.t_s, np.maximum(before, unresolved))
        return made, first.innovation(measurements.sigma)


def _expand_measurement(
    model: EstimationModel,
    at: Mixture,
    t_s: Array,
    layout: Layout,
    measurements: MeasurementSet,
    used: NDArray[np.bool_],
) -> WhitenedInnovation:
    """Return the innovations of components, expanded to second order.

    Parameters
    ----------
    model : EstimationModel
        Measurement model.
    at : Mixture
        M components of N cases.
    t_s : ndarray, shape (N,)
        Times, s.
    layout : Layout
        Kinds of the m rows.
    measurements : MeasurementSet
        Values and standard deviations of the noise, of N cases.
    used : ndarray of bool, shape (m, N)
        Rows that are used.

    Returns
    -------
    WhitenedInnovation
        Of M components.
    """
    owner, lanes = at.owner, at.lanes(t_s)
    points = curved_points(lanes)
    n, each, many = points.shape
    shown = layout.fitting(
        model.observe(points.reshape(n, -1), np.tile(lanes.t_s, each), np.tile(owner, each))
    ).reshape(-1, each, many)
    shift, linear, bent = expand(layout.difference(shown[:, 1:], shown[:, :1]), n)
    own = measurements.of_cases(owner)
    return whiten(layout, own, used[:, owner], shown[:, 0], shift, linear, bent)


@dataclass(frozen=True)
class _ComponentModel:
    """The motion of a model for components, whose cases are `owner` (M,)."""

    model: EstimationModel
    owner: Integers

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        return self.model.advance(x, t0_s, t1_s, control, self.owner[case])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return self.model.process_noise(x, t0_s, t1_s, control)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return self.model.observe(x, t_s, self.owner[case])


def _moments_of_innovation(
    mixture: Mixture, expected: WhitenedInnovation, used: NDArray[np.bool_]
) -> WhitenedInnovation:
    """Return the innovation (N) of mixtures from those of their components."""
    if len(mixture.owner) == mixture.cases:
        return expected
    weight = mixture.weight[:, None]
    starts = mixture.starts()
    mean = np.add.reduceat(weight * expected.residual, starts, axis=0)
    spread = expected.residual - mean[mixture.owner]

    def root(rows: Array) -> Array:
        squares = np.swapaxes(rows, 1, 2) @ rows
        total = np.add.reduceat(mixture.weight[:, None, None] * squares, starts, axis=0)
        # a case that is not a number must not stop the others
        value, vector = np.linalg.eigh(np.where(np.isfinite(total), total, 0.0))
        return np.asarray(np.sqrt(np.maximum(value, 0.0))[:, :, None] * np.swapaxes(vector, 1, 2))

    bent = np.concatenate([expected.bent, spread[:, None]], axis=1)
    return WhitenedInnovation(mean, root(expected.linear), root(bent), used)
