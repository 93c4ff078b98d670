"""Biases as additional states of a model, estimated or considered.

A bias b enters by constant matrices: B b is added to the measurements, C b to the controls (an
error of thrust, or an acceleration that is not modelled, if the plant takes it as a control), and
T b to the attitudes of the spacecraft, which all sensors of a spacecraft share.
Between measurements it is a first-order Gauss–Markov process of correlation time τ and constant
standard deviation σ:

    b' = e^(−Δt/τ) b + w,  Var w = σ² (1 − e^(−2Δt/τ)).

A considered bias is not estimated, but its uncertainty and its correlation with the states are
carried along, so that the covariance of the states accounts for it (Schmidt's filter) [1]_.

References
----------
.. [1] Schmidt (1966), Application of state-space methods to navigation problems, Advances in
   Control Systems 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, ConsiderModel, EstimationModel, Integers
from hillsphere_estimators.state_angles import state_angles

__all__ = ["BiasAugmentedModel", "BiasStates"]


@runtime_checkable
class _TurnedModel(Contract, Protocol):
    def observe_turned(self, x: Array, t_s: Array, case: Integers, turns: Array) -> Array:
        """Return the measurements (m, K) with the attitudes (3 S, K), rad."""
        ...


@dataclass(frozen=True)
class BiasStates:
    """Parameters of k biases.

    Parameters
    ----------
    sigma : ndarray, shape (k,)
        Standard deviations, positive, each in the unit of the bias.
    time_s : ndarray, shape (k,)
        Correlation times; infinite for constants.
    shown : ndarray, shape (m, k)
        B: what the biases add to the measured rows, SI. Rows of directions cannot have any.
    commanded : ndarray, shape (p, k)
        C: what they add to the controls, SI.
    considered : ndarray of bool, shape (k,)
        Biases that are not estimated.
    turned : ndarray, shape (3 S, k), optional
        T: what they add to the attitudes of S spacecraft, rad, three components each. Left out:
        nothing, and the scene's attitudes are those of the model.

    Raises
    ------
    InputError
        If the shapes do not fit, or a standard deviation or correlation time is not positive.
    """

    sigma: Array
    time_s: Array
    shown: Array
    commanded: Array
    considered: NDArray[np.bool_]
    turned: Array | None = None

    def __post_init__(self) -> None:
        k = len(self.sigma)
        shapes = np.shape(self.time_s), np.shape(self.considered)
        ends = np.shape(self.shown)[1:], np.shape(self.commanded)[1:]
        if shapes != ((k,), (k,)) or ends != ((k,), (k,)):
            raise InputError(
                f"{k} biases need time_s and considered ({k},), shown (m, {k}) and commanded "
                f"(p, {k}); got {shapes[0]}, {shapes[1]}, {np.shape(self.shown)} and "
                f"{np.shape(self.commanded)}"
            )
        if self.turned is not None and np.shape(self.turned)[1:] != (k,):
            raise InputError(f"turned must be (3 S, {k}), got {np.shape(self.turned)}")
        if not ((self.sigma > 0.0).all() and (self.time_s > 0.0).all()):
            raise InputError("standard deviations and correlation times of biases must be positive")


class BiasAugmentedModel:
    """An `EstimationModel` of the n states of another model followed by k biases; see the module.

    Parameters
    ----------
    model : EstimationModel
        Without biases.
    states : int
        Its number of states, n.
    biases : BiasStates
        The biases.

    Notes
    -----
    A bias of the controls is constant during the motion between two times: the steps must be short
    beside its correlation time.
    """

    def __init__(self, model: EstimationModel, states: int, biases: BiasStates) -> None:
        self._model, self._n, self.biases = model, states, biases
        own = model.considered if isinstance(model, ConsiderModel) else np.zeros(states, bool)
        self._considered = np.concatenate([own, biases.considered])

    def append_biases(self, belief: Belief) -> Belief:
        """Return a belief with the biases appended, of zero mean and variance σ²."""
        n, k, cases = len(belief.x), len(self.biases.sigma), len(belief.t_s)
        root = np.zeros((cases, n + k, n + k))
        root[:, :n, :n] = belief.root
        root[:, n:, n:] = np.diag(self.biases.sigma)
        return Belief(np.concatenate([belief.x, np.zeros((k, cases))]), root, belief.t_s)

    @property
    def considered(self) -> NDArray[np.bool_]:
        """Whether a state or bias is considered and not estimated, (n + k,)."""
        return self._considered

    @property
    def angles(self) -> Sequence[int]:
        """Rows of the states that are angles: those of the model without biases."""
        return state_angles(self._model, self._n)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states later; see `hillsphere.interfaces.EstimationModel`."""
        own, bias = self._split(x)
        commanded = control + self.biases.commanded @ bias
        there = self._model.advance(own, t0_s, t1_s, commanded, case)
        return np.concatenate([there, self._decay(t1_s - t0_s) * bias])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots of the noise; see `hillsphere.interfaces.EstimationModel`."""
        own, bias = self._split(x)
        noise = self._model.process_noise(own, t0_s, t1_s, control + self.biases.commanded @ bias)
        cases, n, r = noise.shape
        k = len(bias)
        root = np.zeros((cases, n + k, r + k))
        root[:, :n, :r] = noise
        rows = np.arange(k)
        # 1 − e^(−2Δt/τ) without cancellation for times that are short beside τ
        driven = -np.expm1(-2.0 * (t1_s - t0_s) / self.biases.time_s[:, None])
        root[:, n + rows, r + rows] = (self.biases.sigma[:, None] * np.sqrt(driven)).T
        return root

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the measurements (m, N) of perfect sensors plus B b."""
        own, bias = self._split(x)
        turned = self.biases.turned
        if turned is None:
            perfect = self._model.observe(own, t_s, case)
        elif isinstance(self._model, _TurnedModel):
            perfect = self._model.observe_turned(own, t_s, case, turned @ bias)
        else:
            raise InputError(f"a {type(self._model).__name__} has no attitude that could be turned")
        return np.asarray(perfect + self.biases.shown @ bias)

    def _split(self, x: Array) -> tuple[Array, Array]:
        """Return the n states and the k biases of x (n + k, N)."""
        return np.ascontiguousarray(x[: self._n]), x[self._n :]

    def _decay(self, dt_s: Array) -> Array:
        """Return e^(−Δt/τ) (k, N)."""
        return np.asarray(np.exp(-dt_s / self.biases.time_s[:, None]))
