"""A plant as guidance needs it: accelerations of the field along a path."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from hillsphere.dynamics import Derivatives, StepMap, System, Taylor, system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere.symbolic import parameter_names, variable_names

__all__ = ["Motion", "motion_of"]

_CONTROL = "u:"
_EXACT = 1e-12
"""Largest deviation, relative, of the rates of positions from the velocities, and of the
derivatives by the controls from the unit matrix: rounding, for a plant to which the formulation
applies."""


class Motion:
    r"""Second-order motion under a commanded acceleration.

    .. math:: \ddot r = f(r, \dot r, q, t) + a, \qquad \dot q = g(q, t)

    These are the d positions r of a plant, and its other states q (a true anomaly), which do not
    depend on r.

    Parameters
    ----------
    plant : Plant
        Its controls are the accelerations a, one per velocity, in the same order.

    Raises
    ------
    InputError
        If positions, velocities and controls are not as many, or another state depends on them.
    """

    def __init__(self, plant: Plant) -> None:
        self.states, self.scales = tuple(plant.states), plant.scales
        kinds = [(v.length, v.time) for v in plant.states]
        self.positions = [i for i, kind in enumerate(kinds) if kind == (1, 0)]
        self.velocities = [i for i, kind in enumerate(kinds) if kind == (1, -1)]
        moving = {*self.positions, *self.velocities}
        self.others = [i for i in range(len(kinds)) if i not in moving]
        self.axes = len(self.positions)
        names = [v.name for v in plant.states]
        if not self.axes == len(self.velocities) == len(plant.controls):
            raise InputError(
                "guidance needs as many positions as velocities and controls, one acceleration "
                f"each; the plant has the states {', '.join(names)} and "
                f"{len(plant.controls)} controls"
            )
        if not self.axes:
            raise InputError("guidance needs a plant that moves; this one has no positions")
        self.controls = tuple(v.name for v in plant.controls)
        self.system = system(plant, controls=True)
        self._slopes = Derivatives(self.system, [_CONTROL + name for name in self.controls])
        own = {names[i] for i in self.others}
        for i in self.others:
            rate = [self.system.rhs[i]]
            if strange := sorted((set(variable_names(rate)) - own) | set(parameter_names(rate))):
                raise InputError(
                    f"guidance needs states that are neither position nor velocity to go their "
                    f"own way; the rate of {names[i]} depends on {', '.join(strange)}"
                )

    def check(self, x: Array, t: float = 0.0) -> None:
        """Check at a state (n,) that velocities are rates of positions, controls accelerations.

        Raises
        ------
        InputError
            If they are not, or the rates are not finite there.
        """
        rate, slopes = self._slopes.both(x[:, None], None, t)
        if not (np.isfinite(rate).all() and np.isfinite(slopes).all()):
            raise InputError(f"the plant's rates are not finite at {x.tolist()}; inside a body?")
        n, d = len(x), self.axes
        given = slopes[:, n:, 0]
        wanted = np.zeros((n, d))
        wanted[self.velocities] = np.eye(d)
        moved = np.abs(rate[self.positions, 0] - x[self.velocities])
        size = _EXACT * max(1.0, float(np.max(np.abs(x[self.velocities]))))
        if not (np.abs(given - wanted) <= _EXACT).all() or not (moved <= size).all():
            raise InputError(
                "guidance needs a plant whose velocities are the rates of its positions, and whose "
                "controls are added to the accelerations"
            )

    @property
    def unit(self) -> Array:
        """SI size of one natural unit of each state (n,)."""
        return self.scales.of(self.states)

    def rate(self, x: Array, u: Array, t: Array) -> Array:
        """Return ẋ (n, N) at states (n, N) under the accelerations u (d, N), at times t (N,)."""
        return self._slopes.rate(x, np.ascontiguousarray(u), t)

    def field(self, x: Array, t: Array) -> tuple[Array, Array, Array]:
        """Return the accelerations without a command, and their derivatives.

        Parameters
        ----------
        x : ndarray, shape (n, N)
            States, SI.
        t : ndarray, shape (N,)
            Times.

        Returns
        -------
        acceleration : ndarray, shape (d, N)
            m/s².
        by_position, by_velocity : ndarray, shape (d, d, N)
            Exact derivatives.
        """
        rate, slopes = self._slopes.both(x, None, t)
        rows = slopes[self.velocities]
        return rate[self.velocities], rows[:, self.positions], rows[:, self.velocities]

    def assemble(self, r: Array, v: Array, q: Array) -> Array:
        """Return states (n, N) of positions (d, N), velocities (d, N) and others (m, N)."""
        x = np.empty((len(self.states), r.shape[1]))
        x[self.positions], x[self.velocities], x[self.others] = r, v, q
        return x

    def prescribe(self, start: Array, time_s: float, t: Array) -> Array:
        """Return the other states (m, K) at times t (K,) after a start.

        Parameters
        ----------
        start : ndarray, shape (n,)
            State at the start.
        time_s : float
            Time at the start.
        t : ndarray, shape (K,)
            Times since the start, in any order, not negative.
        """
        return np.asarray(self.prescribe_from(start[:, None], time_s, t)[:, :, 0])

    def prescribe_from(self, start: Array, time_s: float, t: Array) -> Array:
        """Return the other states (m, K, N) at times t (K,) after N starts (n, N)."""
        if not self.others:
            return np.empty((0, len(t), start.shape[1]))
        times, place = np.unique(t, return_inverse=True)
        begun = np.ascontiguousarray(start[self.others])
        others = self._clockwork.sample(begun, time_s + times, t0=time_s)
        return np.asarray(others[:, place])

    @cached_property
    def step_map(self) -> StepMap:
        """The motion under accelerations that are held, their run-time parameters."""
        return StepMap(self.system)

    @cached_property
    def series(self) -> Taylor:
        """The same by Taylor series; not for a field that is a function of arrays."""
        return Taylor(self.system)

    @cached_property
    def _clockwork(self) -> Taylor:
        """Propagates the other states alone."""
        base, rows = self.system, self.others
        alone: System = replace(
            base,
            states=tuple(base.states[i] for i in rows),
            x=tuple(base.x[i] for i in rows),
            rhs=tuple(base.rhs[i] for i in rows),
            run_time=(),
            events={},
            integral=None,
            unit=base.unit[rows],
            scale=base.scale[rows],
            mirrors={},
            external=None,
            switches=(),
        )
        return Taylor(alone)


_KNOWN: WeakKeyDictionary[Plant, Motion] = WeakKeyDictionary()


def motion_of(plant: Plant) -> Motion:
    """Return the motion of a plant, compiled once for as long as the plant lives."""
    if plant not in _KNOWN:
        _KNOWN[plant] = Motion(plant)
    return _KNOWN[plant]
