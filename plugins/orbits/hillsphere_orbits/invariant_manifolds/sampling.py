"""Invariant manifolds of an unstable periodic orbit, each trajectory of them sampled once.

Along the orbit γ of period T runs the Floquet mode v, v(t + T) = λ v(t). To first order a
trajectory of the unstable manifold is γ(t) + d v(t), and d and λd belong to the same trajectory one
period apart: the fundamental domain is d = ±δ λ^(p − 1) with p in [0, 1). Equal steps of p are
equal steps along the growth, so that steep strands of the manifold are met as often as flat ones;
nodes spaced equally in time miss them. For negative λ the mode changes sides every period: the
domain is that of two periods with λ², and one side holds everything. The stable manifold is the
same with time reversed.

References
----------
.. [1] Parker, T. S., Chua, L. O., Practical Numerical Algorithms for Chaotic Systems, Springer,
   1989, chapter 6 (fundamental domains of invariant manifolds).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import bracketed_roots
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.invariant_manifolds.flight import FlightEnds, Watch, fly
from hillsphere_orbits.spatial_qso_families.stability import excess, spectrum

__all__ = ["Leaves", "LocalManifold", "classify_manifolds", "leaves", "sides_are_images"]

_LEAST = 1.0 + 1e-5  # multiplier; nearer to 1 lie the scattered ones of every orbit
_BESIDE = 1.5  # sub-steps to the middle of those that hold a known zero, and one on either side
_SAME = 1e-6  # of states that a symmetry maps on one another, relative to their size


def classify_manifolds(monodromy: Array) -> tuple[str, ...]:
    """Classify orbits by their largest multiplier: whether `LocalManifold` can treat them.

    Parameters
    ----------
    monodromy : ndarray, shape (6, 6, N)
        Of the orbits.

    Returns
    -------
    tuple of str
        ``"unstable"``, ``"stable"`` or ``"complex"`` (multipliers off the unit circle that are
        not real: the manifold has two dimensions more and no single direction).
    """
    beyond, first = excess(monodromy), spectrum(monodromy)[0]
    return tuple(
        "stable"
        if out <= 0.0 or abs(m) <= _LEAST
        else "complex"
        if abs(m.imag) > 1e-9 * abs(m)
        else "unstable"
        for out, m in zip(beyond, first, strict=True)
    )


@dataclass(frozen=True, eq=False)
class LocalManifold:
    """An unstable orbit and its mode, on equal sub-steps of a period, or of two.

    Parameters
    ----------
    flow : Flow
        Equations, normalised.
    h : float
        Sub-step; negative for the stable manifold, which is flown backwards.
    orbit : ndarray, shape (n, K)
        States of the orbit at j·h.
    mode : ndarray, shape (n, K)
        v there; |v| = 1 at the start.
    growth : float
        Growth of the mode over the K sub-steps, > 1.
    multiplier : float
        λ of one period in the sense of flight, |λ| > 1.
    """

    flow: Flow
    h: float
    orbit: Array
    mode: Array
    growth: float
    multiplier: float

    @classmethod
    def of(
        cls, flow: Flow, x0: Array, period: float, steps: int, *, stable: bool = False
    ) -> LocalManifold:
        """Find the mode of an orbit.

        Parameters
        ----------
        flow : Flow
            Normalised.
        x0 : ndarray, shape (n,)
            A state of the orbit.
        period : float
            Its period.
        steps : int
            Sub-steps of a period.
        stable : bool
            Whether the stable manifold is meant.

        Returns
        -------
        LocalManifold
            Of the largest multiplier.

        Raises
        ------
        InputError
            If it is complex, or none is larger than 1.
        """
        # the stable manifold is the unstable one of the reversed flow
        h = (-period if stable else period) / steps
        way = flow.plain.trajectory(x0, h * steps, steps)[:, :-1]
        _, phi = flow.with_matrix(np.ascontiguousarray(way), h, 1)
        matrix = np.eye(len(x0))
        for j in range(steps):
            # product of the sub-steps' matrices: the same ones carry the mode, so that it closes
            # exactly
            matrix = phi[:, :, j] @ matrix
        values, vectors = np.linalg.eig(matrix)
        k = int(np.argmax(np.abs(values)))
        if abs(values[k].imag) > 1e-9 * abs(values[k]) or not abs(values[k]) > _LEAST:
            raise InputError(
                f"the orbit's largest multiplier is {values[k]:.6g}; a manifold needs a real one "
                "off the unit circle"
            )
        multiplier, v = float(values[k].real), vectors[:, k].real
        v = v * np.sign(v[np.argmax(np.abs(v))]) / np.linalg.norm(v)
        # a negative multiplier turns the mode round in one period: two make it return
        turns = 1 if multiplier > 0.0 else 2
        mode = np.empty((len(x0), turns * steps))
        for j in range(turns * steps):
            mode[:, j] = v
            # the mode is not renormalised along the orbit: its growth is the distance of a
            # trajectory
            v = phi[:, :, j % steps] @ v
        return cls(flow, h, np.tile(way, (1, turns)), mode, multiplier**turns, multiplier)

    @property
    def sides(self) -> tuple[int, ...]:
        """Signs of d that differ: both, or for a negative multiplier one."""
        return (1, -1) if self.multiplier > 0.0 else (1,)

    def starts(self, p: Array, side: int, start: float) -> tuple[Array, NDArray[np.int64]]:
        """Return first states (n, N) and their sub-steps (N,).

        Parameters
        ----------
        p : ndarray, shape (N,)
            Place in the fundamental domain, d = start · growth^(p − 1) at sub-step 0.
        side : int
            1 or −1.
        start : float
            Largest distance from the orbit up to and at the first state. Each trajectory is taken
            up as late as that allows: the linear part before is known without flying it.

        Returns
        -------
        x : ndarray, shape (n, N)
            Normalised.
        node : ndarray of int, shape (N,)
            Sub-steps since the start of the orbit.
        """
        d = start * self.growth ** (np.asarray(p, dtype=float) - 1.0)
        # largest distance up to each node, per unit of d
        largest = np.maximum.accumulate(np.linalg.norm(self.mode, axis=0))
        node = np.searchsorted(largest, start / d, side="right").astype(np.int64) - 1
        node = np.maximum(node, 0)  # p = 1 but for rounding
        return self.state(p, side, start, node), node

    def state(self, p: Array, side: int, start: float, node: NDArray[np.int64]) -> Array:
        """Return γ + d v (n, N) at sub-steps (N,), in the first domain."""
        d = side * start * self.growth ** (np.asarray(p, dtype=float) - 1.0)
        return np.ascontiguousarray(self.orbit[:, node] + d * self.mode[:, node])

    def on_orbit(self, step: NDArray[np.int64]) -> Array:
        """Return the orbit's states (n, …) at sub-steps (…), of any number."""
        return self.orbit[:, step % self.orbit.shape[1]]

    def most_steps(self, start: float, distance: float) -> int:
        """Return sub-steps by which every trajectory is farther from the orbit than a distance."""
        # a period multiplies the distance by `growth`: periods until it exceeds the distance for
        # sure
        least = float(np.min(np.linalg.norm(self.mode, axis=0)))
        domains = np.log(max(1.0, self.growth * distance / (start * least))) / np.log(self.growth)
        return int(np.ceil(domains + 1.0)) * int(self.orbit.shape[1])


@dataclass(frozen=True, eq=False)
class Leaves:
    """Trajectories of one side of a manifold.

    Parameters
    ----------
    p : ndarray, shape (N,)
        Place in the fundamental domain.
    side : int
        1 or −1.
    start : ndarray, shape (n, N)
        First states.
    node : ndarray of int, shape (N,)
        Sub-step of the orbit at which they begin.
    ends : FlightEnds
        Ends and zeros, their times counted from the first state; zeros before `left` are not read.
    left : ndarray, shape (N,)
        Length of flight at the last moment when the distance from the orbit, both at the same
        time, is ε; NaN if there is none.
    """

    p: Array
    side: int
    start: Array
    node: NDArray[np.int64]
    ends: FlightEnds
    left: Array


def leaves(
    local: LocalManifold,
    watch: Watch,
    p: Array,
    side: int,
    *,
    start: float,
    distance: float,
    duration: float,
    ends: tuple[str, ...] = (),
    node: NDArray[np.int64] | None = None,
    near: Array | None = None,
) -> Leaves:
    """Fly trajectories of a manifold.

    Parameters
    ----------
    local : LocalManifold
        Orbit and mode.
    watch : Watch
        Functions whose zeros are wanted.
    p : ndarray, shape (N,)
        Places in the fundamental domain.
    side : int
        1 or −1.
    start : float
        Largest distance from the orbit at the first states, Euclidean norm of the normalised state.
    distance : float
        ε in the same norm, larger than `start`.
    duration : float
        How long they fly after they have left ε for the last time, > 0.
    ends : tuple of str
        Watched functions whose fall ends a flight.
    node : ndarray of int, shape (N,), optional
        Sub-steps of the orbit, in the first domain, at which to take the trajectories up, instead
        of as late as `start` allows.
    near : ndarray, shape (N,), optional
        Length of each flight, > 0, beside which zeros are wanted, instead of all after `left`.

    Returns
    -------
    Leaves
        The trajectories.
    """
    h, flow = local.h, local.flow
    if node is None:
        x, node = local.starts(p, side, start)
    else:
        x = local.state(p, side, start, node)
    within = np.zeros(p.size, dtype=np.int64)
    state_within = x.copy()
    reach = duration / abs(h)

    begin = node

    def goes_on(
        lanes: NDArray[np.intp], first: int, way: Array
    ) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        count = way.shape[1]
        step = first + np.arange(count)
        away = way - local.on_orbit(begin[lanes] + step[:, None])
        close = np.sum(away * away, axis=0) <= distance * distance
        some = np.flatnonzero(close.any(axis=0))
        # last sub-step within ε: the trajectory may return to the neighbourhood of the orbit
        last = count - 1 - np.argmax(close[::-1, some], axis=0)
        within[lanes[some]] = first + last
        state_within[:, lanes[some]] = way[:, last, some]
        # one sub-step more than the flight lasts, so that its end is bracketed
        length = np.clip(within[lanes] + int(reach) + 3 - first, 0, count)
        if near is not None:
            return length, np.abs(step[:-1, None] + 0.5 - near[lanes] / abs(h)) <= _BESIDE
        # zeros count from the last moment at ε on, which lies in the sub-step after `within`
        return length, step[:-1, None] >= within[lanes]

    most = local.most_steps(start, distance) + int(reach) + 3
    flown = fly(flow.plain, watch, x, h, goes_on, most, ends)
    left = within * h + _leaving(local, state_within, node + within, distance)
    return Leaves(p, side, x, node, flown, left)


def _leaving(local: LocalManifold, x: Array, step: NDArray[np.int64], distance: float) -> Array:
    """Return the time within a sub-step (N,) at which the distance from the orbit reaches ε."""
    h, flow = local.h, local.flow
    orbit = np.ascontiguousarray(local.on_orbit(step))

    def beyond(tau: Array) -> Array:
        away = flow.plain.step(x, tau, strict=False) - flow.plain.step(orbit, tau)
        return np.asarray(np.linalg.norm(away, axis=0) - distance)

    zero, whole = np.zeros(step.size), np.full(step.size, h)
    low, high = beyond(zero), beyond(whole)
    tau = bracketed_roots(
        beyond, zero, np.where(high > 0.0, whole, 0.0), low, high, np.full(step.size, 1e-13)
    )
    return np.where((low <= 0.0) & (high > 0.0), tau, np.nan)


def sides_are_images(
    local: LocalManifold, places: Array, kept: tuple[tuple[int, ...], ...] | None = None
) -> bool:
    """Whether a symmetry of the equations maps one side of the manifold on the other.

    A sign change R of the axes that the equations keep maps the orbit on itself, half a period
    later (or at once), and the mode on its negative: as for the orbits of an odd number of
    revolutions about a body with three mirror planes.

    Parameters
    ----------
    local : LocalManifold
        Orbit and mode.
    places : ndarray, shape (6, N)
        States at which symmetries are tried, normalised.
    kept : tuple of tuples of int, optional
        Only these sign changes (of x, y, z) count.

    Returns
    -------
    bool
        True if it is enough to look at one side.
    """
    if local.multiplier < 0.0:
        return True
    candidates = kept or tuple(
        (i, j, k) for i in (1, -1) for j in (1, -1) for k in (1, -1) if (i, j, k) != (1, 1, 1)
    )
    steps = local.orbit.shape[1]
    for signs in candidates:
        mirror = (*signs, *signs)
        if not local.flow.keeps(mirror, places, reverses_time=False):
            continue
        turned = np.array(mirror)
        for node in {0, steps // 2} if steps % 2 == 0 else {0}:
            size = np.linalg.norm(local.orbit[:, node])
            # R γ(0) = γ(node) and R v(0) ∝ −v(node): the other side is the image of this one
            off = np.linalg.norm(turned * local.orbit[:, 0] - local.orbit[:, node])
            image, mode = turned * local.mode[:, 0], local.mode[:, node]
            if off <= _SAME * size and image @ mode < -(1.0 - _SAME) * np.linalg.norm(mode):
                return True
    return False
