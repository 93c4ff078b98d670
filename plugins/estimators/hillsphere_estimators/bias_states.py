"""Biases as further states of a model: constant or wandering, estimated or only reckoned with.

A bias b enters by constant matrices: the sensors show B b more, the controls are C b larger than
commanded (an error of thrust, or an acceleration that is not modelled, where the plant takes it as
a control). Between measurements it decays with its correlation time τ and is driven by noise that
holds its standard deviation σ (Gauss–Markov):

    b' = e^(−Δt/τ) b + w,  Var w = σ² (1 − e^(−2Δt/τ)).

A considered bias is never estimated, but its uncertainty and its correlation with the states are
carried along, so that the filter does not believe more than it may (Schmidt's filter) [1]_.

References
----------
.. [1] Schmidt (1966), Application of state-space methods to navigation problems, Advances in
   Control Systems 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, ConsiderModel, EstimationModel, Integers

__all__ = ["BiasAugmentedModel", "BiasStates"]


@dataclass(frozen=True)
class BiasStates:
    """k biases and how they enter.

    Parameters
    ----------
    sigma : ndarray, shape (k,)
        Standard deviations, positive, each in the bias's own unit.
    time_s : ndarray, shape (k,)
        Correlation times; infinite for constants.
    shown : ndarray, shape (m, k)
        B: what they add to the measured rows, SI. Those of directions cannot have any.
    commanded : ndarray, shape (p, k)
        C: what they add to the controls, SI.
    considered : ndarray of bool, shape (k,)
        Which are not estimated.
    """

    sigma: Array
    time_s: Array
    shown: Array
    commanded: Array
    considered: NDArray[np.bool_]

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
        if not ((self.sigma > 0.0).all() and (self.time_s > 0.0).all()):
            raise InputError("standard deviations and correlation times of biases must be positive")


class BiasAugmentedModel:
    """An `EstimationModel` of a model's n states and k biases behind them (see the module).

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
    Between two times a bias of the controls is held: take steps short beside its correlation time.
    """

    def __init__(self, model: EstimationModel, states: int, biases: BiasStates) -> None:
        self._model, self._n, self.biases = model, states, biases
        own = model.considered if isinstance(model, ConsiderModel) else np.zeros(states, bool)
        self._considered = np.concatenate([own, biases.considered])

    def append_biases(self, belief: Belief) -> Belief:
        """Return a belief of the n states with the biases appended, zero and uncertain by σ."""
        n, k, cases = len(belief.x), len(self.biases.sigma), len(belief.t_s)
        root = np.zeros((cases, n + k, n + k))
        root[:, :n, :n] = belief.root
        root[:, n:, n:] = np.diag(self.biases.sigma)
        return Belief(np.concatenate([belief.x, np.zeros((k, cases))]), root, belief.t_s)

    @property
    def considered(self) -> NDArray[np.bool_]:
        """Which of the n + k states are not estimated."""
        return self._considered

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
        driven = -np.expm1(-2.0 * (t1_s - t0_s) / self.biases.time_s[:, None])
        root[:, n + rows, r + rows] = (self.biases.sigma[:, None] * np.sqrt(driven)).T
        return root

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return what sensors show, biases and all."""
        own, bias = self._split(x)
        return np.asarray(self._model.observe(own, t_s, case) + self.biases.shown @ bias)

    def _split(self, x: Array) -> tuple[Array, Array]:
        return np.ascontiguousarray(x[: self._n]), x[self._n :]

    def _decay(self, dt_s: Array) -> Array:
        return np.asarray(np.exp(-dt_s / self.biases.time_s[:, None]))
