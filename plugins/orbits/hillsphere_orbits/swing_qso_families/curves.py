"""Families of planar orbits of several revolutions, rebuilt from a product."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.correction import correct, tangents
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.shooting import (
    DoublySymmetricShooting,
    PeriodicShooting,
    Shooting,
    SymmetricShooting,
)
from hillsphere_orbits.swing_qso_families.products import SwingFamilies

__all__ = ["AXES", "FamilyTangents", "Swing", "at_positions", "swing_problem"]

AXES = {"x": "xz", "y": "yz"}
"""Axis that an orbit crosses perpendicularly → the mirror plane that this keeps."""

_FROZEN = ("z", "vz")
_SAME_EQUATIONS = 1e-7
"""Largest residual, natural units, of orbits that count as solutions of this plant's equations. An
orbit of several revolutions magnifies the rounding of its stored state, so that this is ten times
wider than for simple orbits."""
_ACCEPTED = 1e-9  # residual; Newton takes one more step from there
_ROUNDING = 1e-12  # accuracy of the flow that members are corrected with


def swing_problem(flow: Flow, axis: str, *, mirror: bool = True, other: bool = False) -> Shooting:
    """Return the equations of planar orbits that start on an axis.

    Parameters
    ----------
    flow : Flow
        States x, y, z, vx, vy, vz.
    axis : {"x", "y"}
        Where the orbits start.
    mirror : bool
        Whether they cross it perpendicularly there, so that half a period is solved; otherwise a
        full period from the section through the axis.
    other : bool
        Whether they cross the other axis perpendicularly too, a quarter of a period later, which
        then is solved.

    Returns
    -------
    Shooting
        With the default number of sub-steps.

    Raises
    ------
    InputError
        If the plant has no such mirror.
    """
    if not mirror:
        return PeriodicShooting(flow, "y" if axis == "x" else "x", _FROZEN)
    first, second = (_mirror(flow, each) for each in (axis, "y" if axis == "x" else "x"))
    if first is None or (other and second is None):
        names = " and ".join(AXES.values()) if other else AXES[axis]
        raise InputError(f"the plant names no mirror {names}: no orbits symmetric about it")
    if other and second is not None:
        return DoublySymmetricShooting(flow, first, _FROZEN, second=second)
    return SymmetricShooting(flow, first, _FROZEN)


def _mirror(flow: Flow, axis: str) -> tuple[int, ...] | None:
    return flow.system.mirrors.get(AXES[axis])


def at_positions(problem: Shooting, branch: Branch, u: Array) -> Array:
    """Return corrected unknowns (m, N) at positions u (N,) of a chain.

    Newton's iteration goes on to rounding, which a very unstable orbit magnifies: a residual that
    is far above the tolerance of other orbits is the best there is.

    Raises
    ------
    ConvergenceError
        If one of them cannot be corrected, or is not between its neighbours.
    """
    u = np.atleast_1d(np.asarray(u, dtype=float))
    if not u.size:
        return branch.z[:, :0]
    guess, planes = branch.guess(u)
    what, names = "orbit between two others", [f"position {value:.3f}" for value in u]
    z = correct(problem, guess, planes, tolerance=_ACCEPTED).require_converged(what, names)
    return branch.near(u, z, what, names)


@dataclass(frozen=True, eq=False)
class FamilyTangents:
    """Results of `Swing` for a family of N orbits that are costly, for another process to reuse.

    Parameters
    ----------
    steps : int
        Sub-steps to rounding.
    tangent : ndarray, shape (m, N)
        Unit tangents of its chain.
    """

    steps: int
    tangent: Array


class Swing:
    """Families of a product with the equations that their orbits solve.

    A position on family f is a number u from 0 to ``branch(f).size − 1``: the orbit ⌊u⌋ of its
    chain and the fraction of the way to the next one.

    Parameters
    ----------
    product : SwingFamilies
        The families.
    plant : Plant
        The equations with which they were computed.

    Raises
    ------
    StageError
        If the orbits do not solve these equations.
    """

    def __init__(self, product: SwingFamilies, plant: Plant) -> None:
        self.product = product
        self.flow = flow_of(plant)
        if product.curve.frame != self.flow.system.frame:
            raise StageError(
                f"the families' orbits are given in the frame {product.curve.frame}, the plant's "
                f"equations in {self.flow.system.frame}; give the plant of the families"
            )
        self._problems: dict[int, Shooting] = {}
        self._branches: dict[int, Branch] = {}

    @property
    def families(self) -> range:
        """Numbers of the families."""
        return range(len(self.product.n))

    def _start(self, family: int) -> tuple[Array, Array]:
        curve, system = self.product.curve, self.flow.system
        own = self.product.curve_family == family
        return curve.x0[:, own] / system.unit[:, None], curve.period_s[own] / system.time_unit_s

    def problem(self, family: int) -> Shooting:
        """Return the equations of a family's orbits, with sub-steps to rounding."""
        if family not in self._problems:
            self._problems[family] = self._validate_problem(family)
        return self._problems[family]

    def branch(self, family: int) -> Branch:
        """Return the chain of a family's orbits, from where it branches off."""
        if family not in self._branches:
            problem = self.problem(family)
            z = problem.unknowns_at(*self._start(family))
            self._branches[family] = self._chain(
                family, z, tangents(problem, z, np.gradient(z, axis=1))
            )
        return self._branches[family]

    def tangents(self, family: int) -> FamilyTangents:
        """Return the costly results for a family: sub-steps and tangents."""
        return FamilyTangents(self.problem(family).steps, self.branch(family).tangent)

    def learn(self, family: int, known: FamilyTangents) -> None:
        """Reuse the results that another process computed for a family."""
        if family in self._branches:
            return
        problem = self._equations(family).with_steps(known.steps)
        self._problems[family] = problem
        z = problem.unknowns_at(*self._start(family))
        self._branches[family] = self._chain(family, z, known.tangent)

    def _equations(self, family: int) -> Shooting:
        mirror = self.product.symmetry[family] != "none"
        return swing_problem(self.flow, self.product.axis[family], mirror=mirror)

    def _chain(self, family: int, z: Array, tangent: Array) -> Branch:
        return Branch(z, tangent, ("it branches off", self.product.ends[family]))

    def _validate_problem(self, family: int) -> Shooting:
        """Return the equations of a family's orbits, tried on some of them."""
        mirror = self.product.symmetry[family] != "none"
        problem = self._equations(family)
        x, period = self._start(family)
        z = problem.unknowns_at(x, period)
        # five members, ends included, stand for the family
        some = np.unique(np.linspace(0, z.shape[1] - 1, 5).astype(int))
        flown = 0.5 * period[some] if mirror else period[some]
        coarse = self.flow.map.choose_steps(x[:, some], flown, 1e-6)
        # an unstable orbit magnifies rounding, which no number of steps improves on
        size = float(np.max(np.abs(self.flow.with_matrix(x[:, some], flown, coarse)[1])))
        tolerance = max(_ROUNDING, 3e-14 * size)
        problem = problem.with_steps(self.flow.map.choose_steps(x[:, some], flown, tolerance))
        error = float(np.max(np.abs(problem.residual(z[:, some])[0])))
        if not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the orbits of family {self.product.name(family)} do not solve the equations of "
                f"this plant (residual {error:.1e}); give the plant with which they were computed"
            )
        return problem

    def at(self, family: int, u: Array) -> Array:
        """Return corrected unknowns (m, N) at positions u (N,); any number at one go.

        Raises
        ------
        ConvergenceError
            If one of them cannot be corrected.
        """
        return at_positions(self.problem(family), self.branch(family), u)

    def orbit(self, family: int, u: Array) -> tuple[Array, Array]:
        """Return the initial states (n, N) and periods (N,) at positions u, normalised."""
        z = self.at(family, u)
        problem = self.problem(family)
        return problem.state(z), problem.period(z)

    def exact(self, family: int, z: Array) -> Array:
        """Return the unknowns (m, N) corrected with the shortest step, from near guesses."""
        corrected = correct(self.problem(family), z, tolerance=_ACCEPTED)
        return corrected.require_converged(f"orbit of {self.product.name(family)}")
