"""Reference orbits and trajectories: states at any time, and the growth of deviations."""

from __future__ import annotations

from functools import cached_property
from math import ceil

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import StageError
from hillsphere.interfaces import Array, Plant
from hillsphere.products import PeriodicOrbits, Trajectories
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.nonlinear_stability.sampled_orbits import retrace
from hillsphere_orbits.spatial_qso_families.stability import is_stable, spectrum

__all__ = ["ReferencePath", "paths_of_flights", "paths_of_orbits", "unstable_left_subspace"]

_PIECE = 0.5
"""Longest piece, natural units, over which a matrix is integrated: its elements stay of order one
to a hundred, and longer ones are products of such, never inverted."""
_SPACING = 0.05
"""Longest step of the table of states, natural units: Hermite's cubic errs by its fourth power over
384, about 2e-8 of the orbit."""
_ACCURACY = 1e-11
"""Error of the flow over one piece, natural units: below that of the interpolation."""
_NEWTON = 5
"""Steps of Gauss and Newton's iteration for the nearest point. Their number is fixed, so that a
case does not depend on the others of its batch; from the last correction's phase these are
enough."""
_LONGEST = 0.3
"""Longest change of a time at once, natural units."""
_SAME_EQUATIONS = 1e-6
"""Largest gap, natural units, between one state of a flight and the next one propagated from it. It
is wider than for periodic orbits: flights may come from other programs, in fewer digits."""
_UNSTABLE = 1.0 + 1e-6
"""Modulus of a multiplier from which its direction is unstable. The double multiplier 1 of a
periodic orbit splits by the root of rounding, some 1e-7, and must not count."""
_GROWS = 10.0
"""Growth from which a direction of an aperiodic reference counts as unstable, over its first half,
after it has turned to the direction of fastest growth along the second. The shear along an orbit,
which grows in proportion to time, makes twofold of that, and two- to sixfold with the swings of the
motion."""


class ReferencePath:
    """One reference, periodic or not, as nodes in time; normalised.

    Parameters
    ----------
    flow : Flow
        Equations that it solves, of n states.
    t : ndarray, shape (J + 1,)
        Times of the nodes, rising from zero.
    x : ndarray, shape (n, J + 1)
        States there.
    monodromy : ndarray, shape (n, n), or None
        Of a periodic orbit, whose last node is one period after the first; None for a path that
        ends. States beyond the end of such a path are those of its free motion.
    """

    def __init__(self, flow: Flow, t: Array, x: Array, monodromy: Array | None = None) -> None:
        self.flow, self._t, self._x = flow, t, x
        self.monodromy = monodromy
        self.period = None if monodromy is None else float(t[-1])
        self.length = np.inf if monodromy is not None else float(t[-1])
        self._step = _PIECE / flow.map.choose_steps(self.probe, _PIECE, _ACCURACY)

    @property
    def probe(self) -> Array:
        """Some of the nodes, shape (n, ≤ 128), by which steps are chosen."""
        return np.ascontiguousarray(self._x[:, :: max(1, self._x.shape[1] // 64)])

    @property
    def amplitude(self) -> Array:
        """Largest size of the first three states, shape (3,)."""
        return np.asarray(np.max(np.abs(self._x[:3]), axis=1))

    def states(self, t: Array) -> Array:
        """Return the states (n, K) at times (K,)."""
        left, here = self._place(t)
        dt = here - self._t[left]
        steps = max(1, ceil(float(np.max(np.abs(dt), initial=0.0)) / self._step))
        start = np.ascontiguousarray(self._x[:, left])
        return np.asarray(self.flow.plain.propagate(start, dt, steps))

    def interpolate(self, t: Array) -> tuple[Array, Array]:
        """Return states and their rates (n, K) at times (K,), by cubics between the nodes."""
        left, here = self._place(t)
        h = self._t[left + 1] - self._t[left]
        s = np.minimum((here - self._t[left]) / h, 1.0)
        a, b = self._x[:, left], self._x[:, left + 1]
        da, db = self._rate[:, left] * h, self._rate[:, left + 1] * h
        # Hermite's cubic in s = (t − t_left)/h, and its derivative
        c2, c3 = 3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db
        return a + s * (da + s * (c2 + s * c3)), (da + s * (2.0 * c2 + 3.0 * s * c3)) / h

    def fastest(self, unit: Array) -> float:
        """Return an upper bound of the speed of `interpolate`, positions in units (3,) of SI.

        The slope of a cubic is at most the largest of its Bernstein coefficients: those at the
        nodes and one between.
        """
        h = np.diff(self._t)
        a, b = self._rate[:3, :-1], self._rate[:3, 1:]
        between = 3.0 * np.diff(self._x[:3], axis=1) / h - a - b
        most = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(between)) * unit[:, None]
        return float(np.sqrt(np.sum(most**2, axis=0)).max())

    def nearest(self, x: Array, t: Array) -> Array:
        """Return the times (K,), near to given ones, at which the path comes nearest to x (n, K).

        In the first six states, by Gauss and Newton's iteration; within the path if it ends.
        """
        for _ in range(_NEWTON):
            here, rate = self.interpolate(t)
            # minimum of |x − x_ref(t)|²: the change is the projection of the gap on the rate
            gap, rate = (x - here)[:6], rate[:6]
            change = np.sum(gap * rate, axis=0) / np.sum(rate**2, axis=0)
            t = np.clip(t + np.clip(change, -_LONGEST, _LONGEST), -np.inf, self.length)
        return np.maximum(t, 0.0) if self.period is None else t

    def floquet_gains(self, t: Array) -> Array:
        r"""Return gains (p, n, K) of the least impulse that nulls the unstable component.

        :math:`W_v^{+} W` at the nodes, for the p = 3 velocities; between them it is interpolated
        in a line.
        """
        left, here = self._place(t)
        s = (here - self._t[left]) / (self._t[left + 1] - self._t[left])
        gains = self._gains
        return np.asarray(gains[..., left] + s * (gains[..., left + 1] - gains[..., left]))

    def transitions(self, t: Array, duration: Array | float) -> Array:
        """Return the matrices (n, n, K) from times t (K,) over durations (K,) or one duration."""
        long = np.broadcast_to(np.asarray(duration, dtype=float), t.shape)
        pieces = max(1, ceil(float(np.max(long, initial=0.0)) / _PIECE))
        part = long / pieces
        start = t[None] + np.arange(pieces)[:, None] * part
        lanes = np.broadcast_to(part, start.shape).ravel()
        steps = max(1, ceil(float(np.max(lanes, initial=0.0)) / self._step))
        _, each = self.flow.with_matrix(self.states(start.ravel()), lanes, steps)
        n = each.shape[0]
        each = np.moveaxis(each.reshape(n, n, pieces, t.size), (2, 3), (0, 1))
        total = each[0]
        for piece in each[1:]:
            # Φ(t, t + T) as a product of short pieces, each of moderate size
            total = piece @ total
        return np.ascontiguousarray(np.moveaxis(total, 0, 2))

    def unstable_rows(self, t: Array) -> Array:
        r"""Return the left unstable directions at times t (K,), shape (m, n, K), orthonormal.

        A deviation δ has no unstable component where :math:`W(t)\,\delta = 0`. The rows are those
        of the left unstable invariant subspace of the monodromy matrix M(0), carried along the
        orbit: :math:`W(t) = W(t_1)\,\Phi(t_1, t)` backwards in time, the direction in which they
        grow, so that no matrix is inverted. m is zero for a stable orbit. Of an aperiodic path they
        are the directions that grow most, from its end backwards [1]_.

        References
        ----------
        .. [1] G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn (1980), Lyapunov characteristic
           exponents for smooth dynamical systems, Meccanica 15, p. 9.
        """
        times, table = self._unstable_rows
        here = self._place(t)[1]
        right = np.clip(np.searchsorted(times, here, side="left"), 0, times.size - 1)
        ahead = np.maximum(times[right] - here, 0.0)
        phi = np.moveaxis(self.transitions(here, ahead), 2, 0)
        # W(t) = W(t₁) Φ(t₁, t): carried backwards, in the direction in which the rows grow
        rows = table[right] @ phi
        return np.ascontiguousarray(np.moveaxis(_orthonormal(rows), 0, 2))

    @cached_property
    def _rate(self) -> Array:
        return self.flow.rate(self._x)

    @cached_property
    def _gains(self) -> Array:
        w = np.moveaxis(self.unstable_rows(self._t), 2, 0)
        if not w.shape[1]:
            return np.zeros((3, w.shape[2], self._t.size))
        # least impulse with W (δ + B Δv) = 0: Δv = −W_v⁺ W δ
        return np.ascontiguousarray(np.moveaxis(np.linalg.pinv(w[:, :, 3:6]) @ w, 0, 2))

    @property
    def unstable(self) -> int:
        """Number m of unstable directions."""
        return int(self._unstable_rows[1].shape[1])

    @cached_property
    def _unstable_rows(self) -> tuple[Array, Array]:
        """Return times (Q + 1,) and rows (Q + 1, m, n) of the left unstable directions."""
        end = float(self._t[-1])
        count = max(1, ceil(end / _PIECE))
        times = np.linspace(0.0, end, count + 1)
        matrices = np.moveaxis(self.transitions(times[:-1], np.diff(times)), 2, 0)
        periodic = self.monodromy
        w = self._growing(matrices) if periodic is None else unstable_left_subspace(periodic)
        rows = np.empty((count + 1, *w.shape))
        rows[-1] = w
        for k in range(count - 1, -1, -1):
            # orthonormalised after each piece: otherwise all rows turn to the fastest-growing one
            rows[k] = _orthonormal((rows[k + 1] @ matrices[k])[None])[0]
        return times, rows

    def _growing(self, matrices: Array) -> Array:
        """Return orthonormal rows (m, n) at the end, as many as there are unstable directions."""
        n = matrices.shape[1]
        w, growth = np.eye(n), np.zeros(n)
        for k in range(len(matrices) - 1, -1, -1):
            # Benettin's method: the logarithms of the diagonal of R sum to the growth of each
            # direction
            q, r = np.linalg.qr((w @ matrices[k]).T)
            w = q.T
            if 2 * k < len(matrices):
                growth += np.log(np.maximum(np.abs(np.diagonal(r)), np.finfo(float).tiny))
        m = int(np.count_nonzero(growth > np.log(_GROWS)))
        # any m rows at the end turn to the fastest-growing ones on the way back
        start: Array = np.linalg.qr(matrices[-1].T)[0].T[:m]
        return start

    def _place(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the node before each time, and the time, within the period of a periodic path."""
        here = np.asarray(t, dtype=float)
        if self.period is not None:
            here = np.mod(here, self.period)
        left = np.searchsorted(self._t, here, side="right") - 1
        return np.clip(left, 0, self._t.size - 2), here


def paths_of_orbits(plant: Plant, orbits: PeriodicOrbits) -> list[ReferencePath]:
    """Return periodic orbits as references.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    orbits : PeriodicOrbits
        N orbits.

    Returns
    -------
    list of ReferencePath
        One per orbit.

    Raises
    ------
    StageError
        If they do not solve the equations.
    """
    flow = flow_of(plant)
    period = retrace(flow.plain, orbits).period
    x = orbits.x0 / flow.system.unit[:, None]
    steps = max(1, ceil(0.5 * float(np.max(period)) / _SPACING))
    # half a period to either side: errors grow with the root of the multiplier only
    ahead = flow.plain.trajectory(x, 0.5 * period, steps)
    back = flow.plain.trajectory(x, -0.5 * period, steps)
    way = np.concatenate([ahead, back[:, steps - 1 :: -1]], axis=1)
    parts = np.linspace(0.0, 1.0, 2 * steps + 1)
    return [
        ReferencePath(
            flow,
            period[i] * parts,
            np.ascontiguousarray(way[:, :, i]),
            np.ascontiguousarray(orbits.monodromy[:, :, i]),
        )
        for i in range(period.size)
    ]


def paths_of_flights(plant: Plant, flights: Trajectories) -> list[ReferencePath]:
    """Return coasts as references.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    flights : Trajectories
        N coasts, each by two or more states along it.

    Returns
    -------
    list of ReferencePath
        One per coast; time counts from its first state.

    Raises
    ------
    StageError
        If a coast is no solution of the equations.
    """
    flow = flow_of(plant)
    system = flow.system
    if flights.frame != system.frame or flights.states != flow.names:
        raise StageError(
            f"the flights have states {', '.join(flights.states)} in {flights.frame}; this plant's "
            f"are {', '.join(flow.names)} in {system.frame}; name the plant that they were flown on"
        )
    paths = []
    for i, label in enumerate(flights.labels):
        given = np.isfinite(flights.t_s[:, i]) & np.isfinite(flights.x[:, :, i]).all(axis=0)
        if np.count_nonzero(given) < 2:
            raise StageError(f"flight {label!r} has fewer than two states; nothing can follow it")
        t = flights.t_s[given, i] / system.time_unit_s
        x = np.ascontiguousarray(flights.x[:, given, i] / system.unit[:, None])
        spans = np.diff(t)
        if not (spans > 0).all():
            raise StageError(f"flight {label!r}: its times must rise")
        steps = max(1, ceil(float(np.max(spans)) / _SPACING))
        way = flow.trajectory(np.ascontiguousarray(x[:, :-1]), spans, steps)
        gap = np.max(np.abs(way[:, -1] - x[:, 1:]) / system.scale[:, None], axis=0)
        worst = int(np.argmax(gap))
        if not gap[worst] <= _SAME_EQUATIONS:
            raise StageError(
                f"flight {label!r} does not solve the equations of this stage's plant: between "
                f"{t[worst] * system.time_unit_s:.6g} s and the next state it is off by "
                f"{gap[worst]:.1e} natural units; name the plant that it was flown on"
            )
        inner = t[:-1] + np.arange(steps)[:, None] / steps * spans
        times = np.append(inner.T.ravel(), t[-1]) - t[0]
        states = np.moveaxis(way[:, :-1], 2, 1).reshape(len(x), -1)
        paths.append(ReferencePath(flow, times, np.append(states, x[:, -1:], axis=1)))
    return paths


def unstable_left_subspace(monodromy: Array) -> Array:
    """Return orthonormal rows (m, n) that span the unstable subspace of left eigenvectors.

    Parameters
    ----------
    monodromy : ndarray, shape (n, n)
        Of one orbit, n = 6.

    Returns
    -------
    ndarray, shape (m, n)
        One row per multiplier outside the unit circle, real or complex.
    """
    if bool(is_stable(monodromy[:, :, None])[0]):
        return np.empty((0, len(monodromy)))
    m = int(np.count_nonzero(np.abs(spectrum(monodromy[:, :, None])) > _UNSTABLE))
    values, vectors = np.linalg.eig(monodromy.T)
    most = np.argsort(-np.abs(values), kind="stable")[:m]
    # real and imaginary parts span the plane of a complex pair, both of its vectors the same one
    both = np.concatenate([vectors[:, most].real, vectors[:, most].imag], axis=1)
    u, _, _ = np.linalg.svd(both)
    return np.ascontiguousarray(u[:, :m].T)


def _orthonormal(rows: Array) -> Array:
    """Return orthonormal rows (K, m, n) that span the same spaces as the given ones."""
    if not rows.shape[1]:
        return rows
    q, _ = np.linalg.qr(np.swapaxes(rows, 1, 2))
    return np.ascontiguousarray(np.swapaxes(q, 1, 2))
