"""Cost and constraints of successive convex programming."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, GuidanceTask, Plant
from hillsphere_guidance.motion import motion_of
from hillsphere_guidance.sites import Ground

__all__ = ["Constraints", "Requirements", "Violations"]

_ENDS = 1e-9
"""Time, s, by which a node may lie before the beginning of the glide slope by rounding alone, and
still belongs to it."""
_SOLVER = 1e-6
"""Relative violation of a bound that counts as none: what an interior-point solver leaves. With a
smaller value flights that lie on a bound would be refused."""


@dataclass(frozen=True)
class Requirements:
    """Cost and limits of a flight under held commands.

    Parameters
    ----------
    objective : {"fuel", "energy"}
        ∫|a|dt or ∫|a|²dt.
    hold_s : float
        Time over which each command is held.
    minimum_m_s2, maximum_m_s2 : float or None
        Bounds of |a|.
    glide_slope_rad, glide_slope_time_s : float or None
        Least elevation over the horizon of the site, and the time before the end from which it is
        kept (None: from the start).
    tilt_rad : float or None
        Largest angle between the last command and the outward normal of the site.
    """

    objective: Literal["fuel", "energy"]
    hold_s: float
    minimum_m_s2: float | None = None
    maximum_m_s2: float | None = None
    glide_slope_rad: float | None = None
    glide_slope_time_s: float | None = None
    tilt_rad: float | None = None

    def cost(self, u: Array, weights: Array) -> float:
        """Return the cost of a command (d, N), natural units."""
        size = np.linalg.norm(u, axis=0)
        return float(weights @ (size if self.objective == "fuel" else size**2))

    def slope(self, u: Array) -> float:
        """Return the largest derivative of the cost by a command (d, N), natural units."""
        size = float(np.linalg.norm(u, axis=0).max())
        return 1.0 if self.objective == "fuel" or not size else 2.0 * size

    def convex_cost(self, cp: Any, u: Any, weights: Array, rules: list[Any]) -> Any:
        """Return the cost as an expression of cvxpy; its constraints are added to `rules`."""
        if self.objective == "energy":
            return cp.sum_squares(u @ np.diag(np.sqrt(weights)))
        size = cp.Variable(len(weights))
        rules.append(cp.norm(u, 2, axis=0) <= size)
        return weights @ size

    def constraints(self, plant: Plant, task: GuidanceTask, t: Array, size: float) -> Constraints:
        """Return the constraints of one task.

        Parameters
        ----------
        plant : Plant
            Equations of motion.
        task : GuidanceTask
            Start, end and duration.
        t : ndarray, shape (N + 1,)
            Times at which the command may change, and the end.
        size : float
            Natural unit of acceleration, m/s².

        Returns
        -------
        Constraints
            In natural units.

        Raises
        ------
        InputError
            If a constraint needs a landing site and there is none.
        """
        if task.up is None and (self.glide_slope_rad is not None or self.tilt_rad is not None):
            raise InputError(
                "glide slope and tilt are conditions at a landing site; give the descent a site"
            )
        try:
            ground: Ground | None = Ground(plant, task.start)
        except InputError:
            ground = None
        time = self.glide_slope_time_s
        kept = (
            np.empty(0, dtype=np.int64)
            if self.glide_slope_rad is None
            else 1 + np.flatnonzero(t[1:-1] >= (0.0 if time is None else t[-1] - time - _ENDS))
        )
        length = motion_of(plant).scales.length_m
        return Constraints(self, task, ground, kept, length, size)


@dataclass
class Violations:
    """Violations of constraints, in natural units, each with its name."""

    parts: list[tuple[str, Array]] = field(default_factory=list)

    def add(self, words: str, values: Array) -> None:
        """Add the positive part of values (violated where positive) under a name."""
        self.parts.append((words, np.maximum(values, 0.0)))

    @property
    def total(self) -> float:
        """Sum over all constraints."""
        return float(sum(values.sum() for _, values in self.parts))

    @property
    def largest(self) -> float:
        """Largest over all constraints."""
        return max(float(values.max(initial=0.0)) for _, values in self.parts)

    def words(self) -> str:
        """Return the violated constraints in words: ``"gaps between its steps of 0.02"``."""
        told = [
            f"{words} of {values.max():.1e}"
            for words, values in self.parts
            if values.max(initial=0.0) > _SOLVER
        ]
        return f"{' and '.join(told)} (natural units of the plant)" if told else "no violation"


@dataclass(frozen=True)
class Constraints:
    """The constraints of one task, in natural units.

    Parameters
    ----------
    wanted : Requirements
        The limits.
    task : GuidanceTask
        Start, end and duration.
    ground : Ground or None
        The surface above which the path must stay.
    kept : ndarray of int
        Numbers of the times, out of N + 1, at which the glide slope is kept.
    length : float
        Unit of length, m.
    size : float
        Unit of acceleration, m/s².
    """

    wanted: Requirements
    task: GuidanceTask
    ground: Ground | None
    kept: Any
    length: float
    size: float

    def violations(self, r: Array, u: Array) -> Violations:
        """Return the violations of positions (d, N + 1), m, and commands (d, N), natural units."""
        wanted, violations = self.wanted, Violations()
        force = np.linalg.norm(u, axis=0)
        if wanted.maximum_m_s2 is not None:
            most = wanted.maximum_m_s2 / self.size
            violations.add("commands beyond the maximum", force - most * (1.0 + _SOLVER))
        if wanted.minimum_m_s2 is not None:
            least = wanted.minimum_m_s2 / self.size
            violations.add("commands below the minimum", least * (1.0 - _SOLVER) - force)
        if wanted.tilt_rad is not None and self.task.up is not None:
            lean = np.cos(wanted.tilt_rad) * force[-1:] - self.task.up @ u[:, -1:]
            violations.add("a tilt at the end", lean - _SOLVER * force[-1:])
        if self.kept.size and wanted.glide_slope_rad is not None and self.task.up is not None:
            away = (r[:, self.kept] - self.task.end_position_m[:, None]) / self.length
            rise = np.sin(wanted.glide_slope_rad) * np.linalg.norm(away, axis=0)
            violations.add("places below the glide slope", rise - self.task.up @ away)
        if self.ground is not None:
            violations.add("places below the surface", -self.ground.height(r[:, 1:-1]))
        return violations

    def convex_rules(
        self, cp: Any, r: Array, moved: Any, last: Array, u: Any, rules: list[Any]
    ) -> Any:
        """Add the constraints, linearised about a path, to the rules of a cvxpy problem.

        Parameters
        ----------
        cp : module
            cvxpy.
        r : ndarray, shape (d, N + 1)
            Positions of the path, m.
        moved : cvxpy expression, shape (d, N - 1)
            Changes of the inner positions, natural units.
        last : ndarray, shape (d, N)
            Command of the path, natural units.
        u : cvxpy expression, shape (d, N)
            The new command.
        rules : list
            To which constraints are added.

        Returns
        -------
        cvxpy expression
            Sum of the slack variables of constraints on the path, to be penalised.
        """
        wanted, slack = self.wanted, 0.0
        if wanted.maximum_m_s2 is not None:
            rules.append(cp.norm(u, 2, axis=0) <= wanted.maximum_m_s2 / self.size)
        if wanted.minimum_m_s2 is not None:
            # |u| ≥ least is not convex. The half-space way·u ≥ least implies it, since |u| ≥ way·u.
            way = last / np.maximum(np.linalg.norm(last, axis=0), 1e-300)
            along = cp.sum(cp.multiply(way, u), axis=0)
            rules.append(along >= wanted.minimum_m_s2 / self.size)
        up = self.task.up
        if wanted.tilt_rad is not None and up is not None:
            # up·u ≥ cos(tilt) |u|: a second-order cone
            rules.append(np.cos(wanted.tilt_rad) * cp.norm(u[:, -1]) <= up @ u[:, -1])
        if self.kept.size and wanted.glide_slope_rad is not None and up is not None:
            away = (r[:, self.kept] - self.task.end_position_m[:, None]) / self.length
            place = away + moved[:, self.kept - 1]
            # a cone about the normal with its apex at the site; the slack keeps the problem
            # feasible
            below = cp.Variable(len(self.kept), nonneg=True)
            rise = np.sin(wanted.glide_slope_rad) * cp.norm(place, 2, axis=0)
            rules.append(rise <= up @ place + below)
            slack = slack + cp.sum(below)
        if self.ground is not None:
            inner = np.ascontiguousarray(r[:, 1:-1])
            # the surface to first order in the change of the position
            slope = self.ground.slopes(inner) * self.length
            under = cp.Variable(inner.shape[1], nonneg=True)
            height = self.ground.height(inner) + cp.sum(cp.multiply(slope, moved), axis=0)
            rules.append(height + under >= 0.0)
            slack = slack + cp.sum(under)
        return slack
