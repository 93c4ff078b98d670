"""Minimum-energy path between two states, ∫|a|²dt, as a spline in the full field."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array, GuidanceTask, GuidedFlight, Plant
from hillsphere_guidance.motion import Motion, motion_of
from hillsphere_guidance.specs import MinimumEnergySpec
from hillsphere_guidance.splines import ClampedSpline, gauss_nodes
from hillsphere_guidance.tasks import check_task

__all__ = ["MinimumEnergy"]

_NODES = 8
"""Quadrature nodes of each piece: with more the cost of a smooth field changes by rounding only."""
_STATIONARY = 1e-7
"""Largest slope of the cost, as a part of the residual times its steepest derivative (a cosine), at
which a stop of the search counts as a minimum. Rounding leaves 1e-10 (4e-10 and 7e-11 in the
packaged landings); a search that is stuck has a slope of the order of 1."""


class MinimumEnergy:
    r"""Path of the least :math:`\int |a|^2\,dt` between given states, in the field of any plant.

    Positions are clamped quintic B-splines of time, whose two outer control points at each end
    follow from the states there. The commanded acceleration follows by inverse dynamics,

    .. math:: a(t) = \ddot r - f(r, \dot r, q, t),

    so that path and command are consistent for any control points. The free control points minimise
    the integral. By Gauss quadrature it is a sum of squares with exact derivatives, minimised by
    the Levenberg-Marquardt method in a trust region [1]_ from the cubic path of free space. In a
    constant field the command is linear in time, as that of ZEM/ZEV guidance [2]_.

    Parameters
    ----------
    spec : MinimumEnergySpec
        Number of control points.

    References
    ----------
    .. [1] J. J. Moré (1978), The Levenberg-Marquardt algorithm: implementation and theory, Lecture
       Notes in Mathematics 630, Springer, 105-116.
    .. [2] Y. Guo, M. Hawkins, B. Wie (2013), Applications of generalized zero-effort-miss/
       zero-effort-velocity feedback guidance algorithm, Journal of Guidance, Control, and Dynamics
       36(3), 810-820.
    """

    def __init__(self, spec: MinimumEnergySpec) -> None:
        self.control_points = spec.control_points

    def plan(self, plant: Plant, task: GuidanceTask) -> GuidedFlight:
        """Plan a flight.

        Parameters
        ----------
        plant : Plant
            Equations of motion.
        task : GuidanceTask
            From where to where, in which time.

        Returns
        -------
        GuidedFlight
            The path and its command.

        Raises
        ------
        InputError
            If the plant or the task cannot be taken.
        ConvergenceError
            If no minimum is found.
        """
        motion = motion_of(plant)
        check_task(motion, task)
        return _SplinePath(motion, task, self.control_points).solve()


class _SplinePath:
    """The least-squares problem of one task.

    Parameters
    ----------
    motion : Motion
        Motion of the plant.
    task : GuidanceTask
        Start, end and duration.
    count : int
        Control points of each axis.
    """

    def __init__(self, motion: Motion, task: GuidanceTask, count: int) -> None:
        self._motion, self._task = motion, task
        self._spline = spline = ClampedSpline(task.duration_s, count)
        scales = motion.scales
        self._length = scales.length_m
        self._size = scales.length_m / scales.time_s**2
        t, weights = gauss_nodes(spline.breaks, _NODES)
        self._t = task.time_s + t
        # the square root of the quadrature's weight: the sum of squares is the integral
        self._weights = np.sqrt(weights / task.duration_s) / self._size
        self._bases = [spline.basis(t, k) for k in range(3)]
        self._q = motion.prescribe(task.start, task.time_s, t)
        self._ends = self._outer_points()
        self._free = slice(2, count - 2)

    def solve(self) -> GuidedFlight:
        """Minimise, and return the flight."""
        guess = self._cubic()
        minimum = least_squares(
            self._residuals,
            guess,
            jac=self._jacobian,
            method="trf",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=200,
        )
        residual, slopes = minimum.fun, minimum.jac
        # gradient Jᵀ r over the largest column of J times |r|: the cosine between the two
        size = np.linalg.norm(slopes, axis=0).max() * np.linalg.norm(residual)
        slope = float(np.abs(minimum.grad).max() / size) if size else 0.0
        if not np.isfinite(minimum.cost) or slope > _STATIONARY:
            raise ConvergenceError(
                f"minimum energy: after {minimum.nfev} evaluations the slope of the cost is still "
                f"{slope:.1e} of its size; give more time or another start, so that the path keeps "
                "clear of the body's centre"
            )
        points = self._points(minimum.x)
        return GuidedFlight(
            duration_s=self._task.duration_s,
            states=lambda t: self._states(points, t),
            command=lambda t: self._command(points, t),
            breaks_s=self._spline.breaks,
            account=f"{minimum.nfev} evaluations, slope of the cost {slope:.0e} of its size",
        )

    def _outer_points(self) -> Array:
        """Return the control points (n, d) fixed by the ends, the free ones zero."""
        task, motion = self._task, self._motion
        points = np.zeros((self._spline.control_points, motion.axes))
        reach = self._spline.reach
        start, speed = task.start[motion.positions], task.start[motion.velocities]
        points[0], points[1] = start, start + reach * speed
        points[-1] = task.end_position_m
        points[-2] = task.end_position_m - reach * task.end_velocity_m_s
        return points

    def _cubic(self) -> Array:
        """Return the free points of the optimum without a field, in natural units."""
        second = self._weights[:, None] * self._bases[2]
        known = second @ self._ends
        free = np.linalg.lstsq(second[:, self._free], -known, rcond=None)[0]
        return np.asarray(free.ravel() / self._length)

    def _points(self, z: Array) -> Array:
        """Return all control points (n, d) of the unknowns z."""
        points = self._ends.copy()
        points[self._free] = self._length * z.reshape(-1, self._motion.axes)
        return points

    def _residuals(self, z: Array) -> Array:
        """Return the weighted commands at the quadrature nodes."""
        points = self._points(z)
        r, v, a = (basis @ points for basis in self._bases)
        field, _, _ = self._motion.field(self._motion.assemble(r.T, v.T, self._q), self._t)
        return np.asarray((self._weights[:, None] * (a - field.T)).ravel())

    def _jacobian(self, z: Array) -> Array:
        """Return the derivatives of the residuals by z."""
        points = self._points(z)
        r, v = (self._bases[k] @ points for k in range(2))
        _, by_r, by_v = self._motion.field(self._motion.assemble(r.T, v.T, self._q), self._t)
        place, speed, rise = (basis[:, self._free] for basis in self._bases)
        eye = np.eye(self._motion.axes)
        # derivative of r̈ − f(r, ṙ) by the control points
        table = np.einsum("kc,ij->kicj", rise, eye)
        table -= np.einsum("ijk,kc->kicj", by_r, place) + np.einsum("ijk,kc->kicj", by_v, speed)
        table *= self._length * self._weights[:, None, None, None]
        return np.asarray(table.reshape(-1, z.size))

    def _states(self, points: Array, t: Array) -> Array:
        """Return the states (n, K) of a path at times (K,)."""
        r, v = ((self._spline.basis(t, k) @ points).T for k in range(2))
        q = self._motion.prescribe(self._task.start, self._task.time_s, t)
        return self._motion.assemble(r, v, q)

    def _command(self, points: Array, t: Array) -> Array:
        """Return the command (d, K) of a path at times (K,)."""
        field, _, _ = self._motion.field(self._states(points, t), self._task.time_s + t)
        return np.asarray((self._spline.basis(t, 2) @ points).T - field)
