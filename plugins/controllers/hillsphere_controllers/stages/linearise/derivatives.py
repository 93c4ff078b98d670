"""Derivatives of a plant's equations along a trajectory, at several values of its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import Derivatives, system
from hillsphere.engine.course import Rows
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_controllers.stages.linearise.parameters import Dispersed

__all__ = ["Slopes", "find_affine"]

_AFFINE = 1e-9
"""Curvature over the range of a parameter, relative to the change over it, below which the matrix
counts as affine."""
_ROUNDING = 1e-13
"""Rounding of the matrix itself, relative to its largest entry: a difference of this size is no
curvature."""


class Slopes:
    """Exact derivatives of a plant's rates by positions, velocities, controls and parameters.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    rows : Rows
        Of its states.
    dispersed : Dispersed
        The q parameters.
    start_s : float
        Time at the start of the trajectory.
    """

    def __init__(self, plant: Plant, rows: Rows, dispersed: Dispersed, start_s: float) -> None:
        self._rows, self.start_s = rows, start_s
        controls = [f"u:{v.name}" for v in plant.controls]
        self.equations = system(plant, run_time=dispersed.own, controls=True)
        """With the parameters, then the controls at run time."""
        self.controls = len(controls)
        """Number of controls."""
        if self.equations.external is not None and dispersed.own:
            raise InputError(
                f"dispersions: {dispersed.own[0]} and all other parameters are known to this plant "
                "by number only: its gravity is a function of arrays (a polyhedron, a table), of "
                "which no derivatives by parameters exist; leave dispersions out here and disperse "
                "the flights, or linearise a plant whose gravity is an expression (harmonics, "
                "ellipsoid)"
            )
        self._derivatives = Derivatives(self.equations, [*controls, *dispersed.own])

    def at(self, x: Array, u: Array, p: Array, t: Array) -> Derived:
        """Return the derivatives.

        Parameters
        ----------
        x, u, p, t : ndarray, shape (n, N), (m, N), (q, N), (N,)
            States, controls, parameters, SI, and times since the trajectory's start, s.

        Raises
        ------
        InputError
            If a rate there is not finite.
        """
        rate, jacobian = self._derivatives.both(x, np.concatenate([p, u]), t + self.start_s)
        if not (np.isfinite(rate).all() and np.isfinite(jacobian).all()):
            bad = int(np.flatnonzero(~np.isfinite(jacobian).all(axis=(0, 1)))[:1].sum())
            raise InputError(
                f"the plant's rates are not finite {t[bad]:.6g} s after the trajectory's start; is "
                "it inside a body, or a parameter out of its range?"
            )
        moving, n, m = self._rows.moving, len(rate), self.controls
        accelerated = self._rows.velocities
        return Derived(
            jacobian[np.ix_(moving, moving)],
            jacobian[moving, n : n + m],
            jacobian[accelerated, n + m :],
        )


@dataclass(frozen=True)
class Derived:
    """Jacobians at N states.

    Parameters
    ----------
    a : ndarray, shape (s, s, N)
        Of the rates of positions and velocities by these.
    b : ndarray, shape (s, m, N)
        By the controls.
    acceleration : ndarray, shape (r, q, N)
        Of the accelerations by the parameters.
    """

    a: Array
    b: Array
    acceleration: Array


def find_affine(middle: Array, up: Array, down: Array) -> NDArray[np.bool_]:
    """Return which of q parameters enter a matrix affinely, each by itself.

    Parameters
    ----------
    middle, up, down : ndarray, shape (q, ...)
        The matrix, or several, with each parameter in the middle of its bounds and at both.
    """
    # second and first difference over the range of each parameter
    rest, along = np.abs(up + down - 2.0 * middle), np.abs(up - down)
    axes = tuple(range(1, middle.ndim))
    slack = _AFFINE * along.max(axis=axes) + _ROUNDING * np.abs(middle).max(axis=axes)
    return np.asarray(rest.max(axis=axes) <= slack, dtype=bool)
