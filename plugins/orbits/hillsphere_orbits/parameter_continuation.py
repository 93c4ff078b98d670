"""Continuation of periodic orbits in the parameters of the equations (gravity, rates).

The parameters move along a straight line, p(s) = p₀ + s (p₁ − p₀), and its fraction s joins the
unknowns z of an orbit. With one quantity Q held (an integral, the period, an amplitude) the
equations F(z, s) = 0, Q(z, s) = const again have a curve of solutions, which any tool for a
`correction.Problem` follows: in natural steps of s, or by pseudo-arclength, which passes the folds
where s turns back. dF/ds is exact: the compiled flow carries the derivatives by the parameters.

References
----------
.. [1] Doedel, E. J., et al., Computation of periodic solutions of conservative systems with
   application to the 3-body problem, Int. J. Bifurcation and Chaos 13, 2003, p. 1353.
.. [2] Allgower, E. L., Georg, K., Introduction to Numerical Continuation Methods, SIAM, 2003,
   chapters 2 (natural parameter) and 6 (pseudo-arclength).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.dynamics import ArrayFunction, StepMap, Taylor, system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere.products import PeriodicOrbits
from hillsphere.symbolic import gradient, parameter
from hillsphere_orbits.members import Quantity
from hillsphere_orbits.shooting import Shooting

__all__ = [
    "Conditions",
    "HeldQuantity",
    "ParameterFlow",
    "ParameterPath",
    "ParameterProblem",
    "hold_integral",
    "hold_orbit_quantity",
]

_COARSE = 1e-6
"""Tolerance of a first flight that only measures how much the transition matrix magnifies
errors."""
_ROUNDING = 1e-14  # rounding, relative to the largest element of the matrix


@runtime_checkable
class Conditions(Shooting, Contract, Protocol):
    """A shooting problem whose equations can be evaluated on another flow than its own."""

    def conditions(self, start: Array, end: Array, phi: Array, rate: Array) -> tuple[Array, Array]:
        """Return F and dF/dz from the flow over z[-1]; derivatives by parameters follow dF/dz."""
        ...

    def with_steps(self, steps: int) -> Conditions:
        """Return the same problem with another number of sub-steps."""
        ...


@dataclass(frozen=True)
class ParameterPath:
    """A straight line in the space of a plant's parameters.

    Parameters
    ----------
    names : tuple of str
        Of the k parameters that change.
    start, end : ndarray, shape (k,)
        Their values at the fractions 0 and 1, SI.
    """

    names: tuple[str, ...]
    start: Array
    end: Array

    @classmethod
    def of(
        cls, plant: Plant, to: Mapping[str, float], start: Mapping[str, float] | None = None
    ) -> ParameterPath:
        """Return the path from a plant's own values, or those given, to others.

        Parameters
        ----------
        plant : Plant
            Whose parameters.
        to : mapping of str to float
            Values at the end, SI, by name (``"gravity.gm"``, ``"mean_motion"``).
        start : mapping of str to float, optional
            Values at the start, SI, where they are not the plant's own.

        Raises
        ------
        InputError
            If a name is unknown, nothing changes, or a value is not finite.
        """
        own = {q.name: q.value for q in plant.parameters()}
        if unknown := sorted({*to, *(start or {})} - set(own)):
            raise InputError(
                f"{type(plant).__name__} has no parameter {unknown[0]!r}; it has {', '.join(own)}"
            )
        names = tuple(to)
        first = np.array([(start or {}).get(name, own[name]) for name in names])
        last = np.array([to[name] for name in names], dtype=float)
        if not names or np.array_equal(first, last):
            raise InputError("no parameter changes along the path: give another value at its end")
        if not (np.isfinite(first).all() and np.isfinite(last).all()):
            raise InputError(f"parameters must be finite, got {first} to {last}")
        return cls(names, first, last)

    def at(self, fraction: Array) -> Array:
        """Return the parameters (k, N) at fractions (N,); exact at 0 and 1."""
        return np.asarray((1.0 - fraction) * self.start[:, None] + fraction * self.end[:, None])

    @property
    def change(self) -> Array:
        """Derivative of the parameters by the fraction, (k,)."""
        return np.asarray(self.end - self.start)


class ParameterFlow:
    """Normalised flow of a plant with some of its parameters set lane by lane.

    Units are the plant's own natural ones, whatever the parameters: they do not change on the way.

    Parameters
    ----------
    plant : Plant
        Wholly symbolic equations.
    names : sequence of str
        Parameters that are set at run time.

    Raises
    ------
    InputError
        If a name is unknown, or the plant has terms that are functions of arrays: nothing says how
        these depend on parameters.
    """

    def __init__(self, plant: Plant, names: Sequence[str]) -> None:
        self.plant = plant
        self.system = system(plant, run_time=names, normalised=True)
        self.map = StepMap(self.system, stm=True, parameters=names)
        self._rate = ArrayFunction(self.system.rhs, self.system.x, self.system.run_time_names)

    def rate(self, x: Array, p: Array) -> Array:
        """Return dx/dt (n, N) at states (n, N) and parameters (k, N)."""
        return self._rate(x, p, np.zeros(x.shape[1]))

    @cached_property
    def taylor(self) -> Taylor:
        """Another propagator, by Taylor series, to check orbits with."""
        return Taylor(self.system)

    @cached_property
    def integral(self) -> ArrayFunction | None:
        """Integral of motion and its derivatives by states and parameters; None without one."""
        expression = self.system.integral
        if expression is None:
            return None
        by = [*self.system.x, *(parameter(name) for name in self.system.run_time_names)]
        return self.system.function(expression, *gradient(expression, by))


@dataclass(frozen=True)
class ParameterProblem:
    """Periodic orbits of equations whose parameters change.

    Unknowns are those of the shooting problem, then ``fraction``; one condition short of a curve
    (add what is held).

    Parameters
    ----------
    base : Conditions
        The orbits' equations, evaluated on `flow` instead of their own flow.
    flow : ParameterFlow
        Of the same plant, with the parameters of `path`.
    path : ParameterPath
        The parameters.
    """

    base: Conditions
    flow: ParameterFlow
    path: ParameterPath

    @classmethod
    def of(cls, base: Shooting, plant: Plant, path: ParameterPath) -> ParameterProblem:
        """Return the problem of a plant's orbits along a path; compiles the flow.

        Raises
        ------
        InputError
            If the shooting problem cannot be evaluated on another flow, or for the reasons of
            `ParameterFlow`.
        """
        if not isinstance(base, Conditions):
            raise InputError(
                f"the parameters of a {type(base).__name__} cannot be varied: it has no method "
                "'conditions'; SymmetricShooting and PeriodicShooting have"
            )
        return cls(base, ParameterFlow(plant, path.names), path)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return (*self.base.unknowns, "fraction")

    def state(self, z: Array) -> Array:
        """Return the initial states (n, N), normalised."""
        return self.base.state(z[:-1])

    def period(self, z: Array) -> Array:
        """Return the full periods (N,), normalised."""
        return self.base.period(z[:-1])

    def with_steps(self, steps: int) -> ParameterProblem:
        """Return the same problem with another number of sub-steps."""
        return replace(self, base=self.base.with_steps(steps))

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return the shooting problem's residual and its exact derivatives, by the fraction too."""
        start, p = self.state(z), self.path.at(z[-1])
        end, phi = self.flow.map.propagate(start, z[-2], self.base.steps, p)
        n = len(end)
        # chain rule: dx/ds = Σ ∂x/∂p_k · dp_k/ds, the column of the fraction
        along = np.einsum("ikN,k->iN", phi[:, n:], self.path.change)[:, None]
        wide = np.concatenate([phi[:, :n], along], axis=1)
        return self.base.conditions(start, end, wide, self.flow.rate(end, p))

    def monodromy(self, z: Array) -> Array:
        """Return the state transition matrices over one period (n, n, N)."""
        x, period = self.state(z), self.period(z)
        # problems that shoot over half a period need twice the sub-steps for a whole one
        whole = max(1, round(float(np.max(period / z[-2], initial=1.0))))
        _, phi = self.flow.map.propagate(x, period, whole * self.base.steps, self.path.at(z[-1]))
        return np.ascontiguousarray(phi[:, : len(x)])

    def integral(self, z: Array) -> Array:
        """Return the integral of motion (N,), normalised; NaN where the plant has none."""
        if self.flow.integral is None:
            return np.full(z.shape[1], np.nan)
        return np.asarray(self.flow.integral(self.state(z), self.path.at(z[-1]))[0])

    def steps_for(self, z: Array, tolerance: float) -> int:
        """Return sub-steps that keep a tolerance, or rounding where that is more; with a margin."""
        x, p, choose = self.state(z), self.path.at(z[-1]), self.flow.map.choose_steps
        _, phi = self.flow.map.propagate(x, z[-2], choose(x, z[-2], _COARSE, p), p)
        # an unstable orbit magnifies rounding by its matrix: a tolerance below that cannot be met
        floor = _ROUNDING * float(np.max(np.abs(phi[:, : len(x)])))
        size = max(1.0, float(np.max(np.abs(x))))
        # twice as many: other members of the branch may pass closer than those tried
        return 2 * choose(x, z[-2], max(tolerance * size, floor), p)

    def orbits(self, z: Array, labels: tuple[str, ...]) -> PeriodicOrbits:
        """Return orbits, each at its own parameters; closure by Taylor series."""
        x, period, s = self.state(z), self.period(z), self.flow.system
        end = self.flow.taylor.propagate(x, period, self.path.at(z[-1])) if x.size else x
        scales = self.flow.plant.scales
        return PeriodicOrbits(
            frame=s.frame,
            states=tuple(v.name for v in s.states),
            x0=x * s.unit[:, None],
            period_s=period * s.time_unit_s,
            integral=self.integral(z),
            monodromy=self.monodromy(z),
            residual=np.linalg.norm(end - x, axis=0),
            labels=labels,
            length_m=scales.length_m,
            time_s=scales.time_s,
        )


class HeldQuantity(Protocol):
    """A quantity of an orbit and its parameters that may be held."""

    def __call__(self, z: Array) -> tuple[Array, Array]:
        """Return values (N,) and gradients (m, N) at unknowns with the fraction, z (m, N)."""
        ...


def hold_orbit_quantity(quantity: Quantity) -> HeldQuantity:
    """Return a quantity of the orbit alone (amplitude, period) as one that may be held."""

    def held(z: Array) -> tuple[Array, Array]:
        values, slopes = quantity(z[:-1])
        return values, np.concatenate([slopes, np.zeros((1, z.shape[1]))])

    return held


def hold_integral(problem: ParameterProblem) -> HeldQuantity:
    """Return the integral of motion as a quantity that may be held.

    Raises
    ------
    InputError
        If the plant has none.
    """
    compiled = problem.flow.integral
    if compiled is None:
        raise InputError(
            f"{type(problem.flow.plant).__name__} has no integral of motion to hold; hold the "
            "period or the amplitude"
        )
    names = [v.name for v in problem.flow.system.states]
    rows = [1 + names.index(name) for name in problem.base.unknowns[:-1]]

    def held(z: Array) -> tuple[Array, Array]:
        values = compiled(problem.state(z), problem.path.at(z[-1]))
        # derivative of the integral by the fraction, through the parameters
        along = np.einsum("kN,k->N", values[1 + len(names) :], problem.path.change)
        slopes = [values[rows], np.zeros((1, z.shape[1])), along[None]]
        return values[0], np.concatenate(slopes)

    return held
