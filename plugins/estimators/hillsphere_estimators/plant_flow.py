"""The flow of a plant, with or without a law, compiled on first use and shared.

Models whose equations are equal share the compiled code, whichever plants they come from.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cached_property
from hashlib import sha256
from typing import Any, TypeVar

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.step_map import StepMap
from hillsphere.engine.dynamics.system import System, system
from hillsphere.engine.dynamics.tableaux import tableau
from hillsphere.engine.dynamics.variational import Derivatives
from hillsphere.engine.simulation.flow import closed_system, remember
from hillsphere.interfaces.loop import ContinuousLaw
from hillsphere.interfaces.plant import Plant

__all__ = ["PlantFlow"]

_MOST_COMPILED = 128
"""Compiled systems that are kept. One mission needs a few, a sweep that changes the equations at
every point many: without a bound their code fills the memory, with a small one it is compiled
again."""
_T = TypeVar("_T")
_COMPILED: dict[str, Any] = {}
"""Compiled objects by the digest of their equations; the oldest are dropped first."""


class PlantFlow:
    """The flow of a plant at nominal parameters, with its controls as run-time parameters.

    Parameters
    ----------
    plant : Plant
        n equations with p controls.
    law : ContinuousLaw or None
        Law that commands the plant. With one, states and run-time parameters are those of
        `hillsphere.engine.simulation.flow.closed_system`.
    method : {"rk6", "dop853"}
        Formula of the steps.

    Raises
    ------
    InputError
        If the formula is unknown.
    """

    def __init__(self, plant: Plant, law: ContinuousLaw | None, method: str) -> None:
        self._plant, self._law, self._method = plant, law, tableau(method).name

    @cached_property
    def steps(self) -> StepMap:
        """The step map.

        Raises
        ------
        InputError
            If the plant and the law do not fit.
        """
        plant, law, method = self._plant, self._law, self._method

        def make() -> StepMap:
            if law is None:
                equations = system(plant, controls=True, apart=True)
            else:
                equations, _ = closed_system(plant, law, (), apart=True)
            return _reuse_compiled(method, equations, lambda: StepMap(equations, method))

        # writing the equations takes longer than many flights: the same plant and law do it once
        return remember((plant, law), ("filter", method), make)

    def end(self, x: Array, duration: Array, steps: int, p: Array, t0_s: Array) -> Array:
        """Return the states (n, K) after `steps` steps; see `StepMap.propagate`.

        The checks of the arguments are left out: a filter calls this at each step with arrays that
        it has made itself.

        Parameters
        ----------
        x : ndarray, shape (n, K)
            States.
        duration, t0_s : ndarray, shape (K,)
            Length and start of the motion, s.
        steps : int
            Number of steps.
        p : ndarray, shape (k, K)
            Run-time parameters.

        Returns
        -------
        ndarray, shape (n, K)
            States at the end.

        Raises
        ------
        PropagationError
            If a lane becomes non-finite.
        """
        h = duration / steps
        start = here = np.ascontiguousarray(x)
        advance = self.steps.stepper.bind(h, p)
        there = np.empty_like(start)
        for j in range(steps):
            advance(here, there, t0_s + j * h)
            here, there = there, np.empty_like(start) if here is start else here
        if not np.isfinite(here).all():
            # again with all checks, whose error names the lane and says whether its start was
            # finite
            here = self.steps.propagate(x, duration, steps, p, t0_s)
        return here

    @cached_property
    def slopes(self) -> Derivatives:
        """Right-hand side and its derivatives, of the motion without controls."""

        def make() -> Derivatives:
            equations = system(self._plant)
            return _reuse_compiled("slopes", equations, lambda: Derivatives(equations))

        return remember((self._plant,), ("slopes",), make)


def _reuse_compiled(what: str, equations: System, make: Callable[[], _T]) -> _T:
    """Return the object that was made of equal equations before, or make it.

    Parameters
    ----------
    what : str
        Kind of the object, part of the key.
    equations : System
        Equations; those with external arrays are not shared.
    make : callable
        Makes the object.
    """
    if equations.external is not None:  # its arrays are those of one plant
        return make()
    terms = equations.time_terms
    digest = sha256("\0".join((what, *equations.run_time_names, *terms)).encode())
    for equation in (*equations.x, *equations.rhs, *terms.values()):
        digest.update(sha256(pickle.dumps(equation, 5)).digest())
    key = digest.hexdigest()
    if key not in _COMPILED:
        made = make()
        # dictionaries keep the order of insertion: the first key is the oldest
        while len(_COMPILED) >= _MOST_COMPILED:
            del _COMPILED[next(iter(_COMPILED))]
        _COMPILED[key] = made
    compiled: _T = _COMPILED[key]
    return compiled
