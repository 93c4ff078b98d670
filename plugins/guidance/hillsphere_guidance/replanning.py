"""Minimum-energy paths of many cases at once, planned again from the current states."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_guidance.motion import Motion
from hillsphere_guidance.splines import ClampedSpline, gauss_nodes

__all__ = ["Replanner"]

_NODES = 5
"""Quadrature nodes of each piece of the path. A path of degree 5 has an acceleration of degree 3,
whose square 5 nodes integrate exactly (degree 9 ≥ 6); the rest is for the field."""
_FIRST_ROUNDS, _ROUNDS = 25, 2
"""Gauss-Newton rounds of the first plan, from the cubic of free space, and of later ones, from the
rest of the last plan, which is nearly optimal. The numbers are fixed so that lanes do not wait for
each other: fewer first rounds leave a command that later samples correct."""
_MEAN_NODES = 4
"""Quadrature nodes of the mean command over one period, exact to degree 7 in time."""


class Replanner:
    """Splines of the least ∫|a|² in the full field, kept from sample to sample.

    The problem is that of `hillsphere_guidance.minimum_energy`, for N cases in lockstep by
    Gauss-Newton rounds: many from the cubic path of free space at first, few from the rest of the
    last path later.

    Parameters
    ----------
    motion : Motion
        Motion of the plant.
    control_points : int
        Number of control points of each axis.
    """

    def __init__(self, motion: Motion, control_points: int) -> None:
        self._motion, self._count = motion, control_points
        self._free = slice(2, control_points - 2)

    @property
    def rows(self) -> int:
        """Numbers of a path: control points times axes."""
        return self._count * self._motion.axes

    def plan(
        self,
        last: Array,
        before_s: float | None,
        left_s: float,
        t: Array,
        x: Array,
        goal: Array,
    ) -> Array:
        """Plan the rest of the flights.

        Parameters
        ----------
        last : ndarray, shape (rows, N)
            The paths planned before; zero where there is none.
        before_s : float or None
            Time since that plan; None for the first.
        left_s : float
            Time until the arrival.
        t : ndarray, shape (N,)
            Current times.
        x, goal : ndarray, shape (n, N)
            Current states, and states at the arrival.

        Returns
        -------
        ndarray, shape (rows, N)
            The paths; not finite where the search failed.
        """
        motion, spline = self._motion, ClampedSpline(left_s, self._count)
        points = self._outer(spline, x, goal)
        points[self._free] = self._cubic(spline, points)
        if before_s is not None:
            kept = self._restriction(before_s, left_s)[self._free]
            old = last.reshape(self._count, motion.axes, -1)
            rest = np.einsum("cb,bdN->cdN", kept, old)
            points[self._free] = np.where(last.any(axis=0), rest, points[self._free])
        place, weights = gauss_nodes(spline.breaks, _NODES)
        bases = [spline.basis(place, k) for k in range(3)]
        q = self._others(t, x, place)
        for _ in range(_FIRST_ROUNDS if before_s is None else _ROUNDS):
            points[self._free] += self._change(bases, np.sqrt(weights), place, t, q, points)
        return points.reshape(self.rows, -1)

    def command(self, plan: Array, left_s: float, hold_s: float, t: Array, x: Array) -> Array:
        """Return the mean command (d, N) of planned paths over the next `hold_s`."""
        motion, spline = self._motion, ClampedSpline(left_s, self._count)
        place, weights = gauss_nodes(np.array([0.0, hold_s]), _MEAN_NODES)
        points = plan.reshape(self._count, motion.axes, -1)
        r, v, a = (np.einsum("kc,cdN->dkN", spline.basis(place, k), points) for k in range(3))
        field, _, _ = self._field(r, v, self._others(t, x, place), place, t)
        return np.asarray(np.einsum("k,dkN->dN", weights / hold_s, a - field))

    def _outer(self, spline: ClampedSpline, x: Array, goal: Array) -> Array:
        """Return control points (c, d, N) that meet the states at both ends, the others zero."""
        motion = self._motion
        points = np.zeros((self._count, motion.axes, x.shape[1]))
        reach = spline.reach
        points[0] = x[motion.positions]
        points[1] = points[0] + reach * x[motion.velocities]
        points[-1] = goal[motion.positions]
        points[-2] = points[-1] - reach * goal[motion.velocities]
        return points

    def _cubic(self, spline: ClampedSpline, points: Array) -> Array:
        """Return the free control points of the optimum without a field."""
        second = spline.basis(np.linspace(0.0, spline.duration, 8 * self._count), 2)
        known = np.einsum("kc,cdN->kdN", second, points)
        inverse = np.linalg.pinv(second[:, self._free])
        return np.asarray(-np.einsum("ck,kdN->cdN", inverse, known))

    def _restriction(self, before_s: float, left_s: float) -> Array:
        """Return the matrix from a path's control points to those of its rest.

        It is a least-squares fit at eight points per control point.
        """
        old = ClampedSpline(left_s + before_s, self._count)
        new = ClampedSpline(left_s, self._count)
        place = np.linspace(0.0, left_s, 8 * self._count)
        matrix = np.linalg.lstsq(new.basis(place), old.basis(before_s + place), rcond=None)[0]
        return np.asarray(matrix)

    def _others(self, t: Array, x: Array, place: Array) -> Array:
        """Return the states that are neither position nor velocity (m, K, N) at later times."""
        motion = self._motion
        others = np.empty((len(motion.others), len(place), x.shape[1]))
        if motion.others:
            for time in np.unique(t):
                own = t == time
                others[:, :, own] = motion.prescribe_from(x[:, own], float(time), place)
        return others

    def _field(
        self, r: Array, v: Array, q: Array, place: Array, t: Array
    ) -> tuple[Array, Array, Array]:
        """Return accelerations (d, K, N) and their derivatives (d, d, K, N) along paths."""
        shape = r.shape[1:]
        flat = [part.reshape(len(part), shape[0] * shape[1]) for part in (r, v, q)]
        times = (place[:, None] + t).ravel()
        fields = self._motion.field(np.ascontiguousarray(self._motion.assemble(*flat)), times)
        f, by_r, by_v = (part.reshape(*part.shape[:-1], *shape) for part in fields)
        return f, by_r, by_v

    def _change(
        self, bases: list[Array], weights: Array, place: Array, t: Array, q: Array, points: Array
    ) -> Array:
        """Return the Gauss-Newton change (free, d, N) of control points."""
        d, cases = self._motion.axes, points.shape[2]
        r, v, a = (np.einsum("kc,cdN->dkN", basis, points) for basis in bases)
        f, by_r, by_v = self._field(r, v, q, place, t)
        low, mid, top = (basis[:, self._free] * weights[:, None] for basis in bases)
        free = low.shape[1]
        slopes = np.empty((cases, d, len(place), free, d))
        for i in range(d):
            for j in range(d):
                part = by_r[i, j].T[:, :, None] * low + by_v[i, j].T[:, :, None] * mid
                slopes[:, i, :, :, j] = (top - part) if i == j else -part
        table = slopes.reshape(cases, d * len(place), free * d)
        rest = np.moveaxis((a - f) * weights[:, None], -1, 0).reshape(cases, -1, 1)
        # columns of unit length: the normal equations square the condition, scaling lowers it
        size = np.sqrt(np.add.reduce(table * table, axis=1))[:, None]
        table = table / size
        turned = np.swapaxes(table, 1, 2)
        normal = turned @ table
        good = np.isfinite(normal).all(axis=(1, 2))
        # a failed case is NaN; solving it with the others would raise an error for all
        change = np.full((cases, free * d, 1), np.nan)
        if good.any():
            change[good] = np.linalg.solve(normal[good], -(turned @ rest)[good])
        return np.moveaxis((change[:, :, 0] / size[:, 0]).reshape(cases, free, d), 0, -1)
