"""The normalised flow of a plant with its state transition matrix, compiled once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from hillsphere.dynamics import ArrayFunction, StepMap, System, Taylor, system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant

__all__ = ["XY_MIRROR", "Z_HALF_TURN", "Compiled", "Flow", "flow_of"]

XY_MIRROR = (1, 1, -1, 1, 1, -1)
"""Signs of x, y, z, vx, vy, vz under the mirror xy; planar orbits need equations that keep it."""
Z_HALF_TURN = (-1, -1, 1, -1, -1, 1)
"""The same under half a turn about z: Hill's equations keep it, the three-body problem does not."""

_LOCAL_ERROR = 1e-13
"""Of a step that chooses its length, natural units: a few hundred of them err by 1e-12 or so, which
is what `Flow.steps_for` asks of equal steps."""
_FLOWS: WeakKeyDictionary[Plant, Flow] = WeakKeyDictionary()


def flow_of(plant: Plant) -> Flow:
    """Return the normalised flow of a plant; stages that share a plant share its compiled code.

    Compiling takes a second, so it is kept for as long as the plant lives.
    """
    if plant not in _FLOWS:
        _FLOWS[plant] = Flow(system(plant, normalised=True))
    return _FLOWS[plant]


@dataclass(frozen=True, eq=False)
class Compiled:
    """A plant that takes its compiled flow along to another process, if it has one.

    There `flow_of` finds it within a tenth of the time that it would take to compile it.

    Parameters
    ----------
    plant : Plant
        The plant.
    """

    plant: Plant

    def __reduce__(self) -> tuple[Callable[[Plant, Flow | None], Compiled], tuple[Any, ...]]:
        flow = _FLOWS.get(self.plant)
        # functions of arrays need not be picklable, and their plants compile next to nothing
        outside = flow is not None and flow.system.external is not None
        return _adopt_flow, (self.plant, None if outside else flow)


def _adopt_flow(plant: Plant, flow: Flow | None) -> Compiled:
    if flow is not None:
        _FLOWS.setdefault(plant, flow)
    return Compiled(plant)


class Flow:
    """Flow of an autonomous system with its state transition matrix.

    One compiled map serves everything: lengths of flight differ from lane to lane, the number of
    sub-steps is common.

    Parameters
    ----------
    system : hillsphere.dynamics.System
        Equations of motion, usually normalised.

    Raises
    ------
    InputError
        If the equations depend on time: the orbits of a family would not be periodic.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self.names: tuple[str, ...] = tuple(v.name for v in system.states)
        self.map = StepMap(system, method="dop853", stm=True)
        # rates at two times, at states of no symmetry: any explicit time would show
        probe = np.linspace(0.9, 1.7, len(self.names))[:, None] * system.scale[:, None]
        if not np.array_equal(self.rate(probe, 0.0), self.rate(probe, 0.37), equal_nan=True):
            raise InputError(
                "periodic orbits need equations without explicit time; this plant's depend on it"
            )

    @cached_property
    def plain(self) -> StepMap:
        """The step map without the matrix: seven times as fast, for flights of many lanes."""
        return StepMap(self.system, method="dop853")

    @cached_property
    def adaptive(self) -> StepMap:
        """Steps chosen by their error, for terms that are functions of arrays: one is a flight."""
        return StepMap(self.system, method="dop853", tolerance=_LOCAL_ERROR)

    @cached_property
    def taylor(self) -> Taylor:
        """Propagator by Taylor series; an `ExternalInputs` plant has none."""
        return Taylor(self.system)

    @cached_property
    def _rate(self) -> ArrayFunction:
        outside = self.system.external
        symbols = (*self.system.x, *(outside.variables if outside else ()))
        return ArrayFunction(self.system.rhs, symbols, self.system.run_time_names)

    def rate(self, x: Array, t: float = 0.0) -> Array:
        """Return dx/dt (n, N) at x (n, N)."""
        cases = x.shape[1]
        p = self.system.parameters(None, cases)
        if self.system.external is not None:
            terms = self.system.external.values(x, np.full(cases, t), p)
            x = np.concatenate([x, terms])
        return self._rate(x, p, np.full(cases, t))

    def with_matrix(self, x: Array, duration: Array | float, steps: int) -> tuple[Array, Array]:
        """Return the states (n, N) after the durations (N,) and the matrices (n, n, N)."""
        end, phi = self.map.propagate(x, duration, steps)
        return end, phi

    def trajectory(self, x: Array, duration: Array | float, steps: int) -> Array:
        """Return the states (n, steps + 1, N) along the way, ends included."""
        return self.map.trajectory(x, duration, steps)

    def at_once(self, x: Array, h: Array) -> Array:
        """Return the states (n, N) after one sub-step of length h (N,)."""
        end: Array = self.map.step(x, h)[0]
        return end

    def steps_for(self, x: Array, duration: Array | float, tolerance: float = 1e-12) -> int:
        """Return sub-steps for which the error is rounding, by step doubling.

        The tolerance is relative to the largest state; the number that meets it is doubled, which
        divides the error of an eighth-order method by 256.
        """
        size = max(1.0, float(np.max(np.abs(x) / self.system.scale[:, None])))
        # twice the steps that meet the tolerance: a margin of 2⁸ for other members
        return 2 * self.map.choose_steps(x, duration, tolerance * size)

    def keeps(self, mirror: Sequence[int], x: Array, *, reverses_time: bool) -> bool:
        """Whether the equations are unchanged under a mirror, tried at sample states.

        Parameters
        ----------
        mirror : sequence of int
            Sign of each state.
        x : ndarray, shape (n, N)
            Where to try it.
        reverses_time : bool
            Whether the mirror also reverses time.

        Returns
        -------
        bool
            f(S x) = ±S f(x) to rounding at all samples.
        """
        # equivariance f(S x) = S f(x), or −S f(x) under time reversal
        sign = np.asarray(mirror, dtype=float)[:, None]
        here, there = self.rate(x), self.rate(sign * x)
        expected = (-sign if reverses_time else sign) * here
        size = np.max(np.abs(here), axis=0)
        return bool(np.all(np.abs(there - expected) <= 1e-13 * size))
