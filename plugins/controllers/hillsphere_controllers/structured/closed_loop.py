r"""Closed loops as static feedback of the plant augmented by the controller's states.

A controller of order k is a constant gain K on the plant with k integrators added. With D22 out of
the way, K₀ = (I − K D22)⁻¹ K, the closed loop is affine in K₀:

.. math::

    A_{cl} = A + B_2 K_0 C_2, \quad B_{cl} = B_1 + B_2 K_0 D_{21}, \quad
    C_{cl} = C_1 + D_{12} K_0 C_2, \quad D_{cl} = D_{11} + D_{12} K_0 D_{21}.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.requirements import Channel, DesignPlant
from hillsphere_controllers.structured.structure import Sizes, Structure
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["Closed", "Open", "OpenLoop"]


@dataclass(frozen=True)
class Closed:
    """Matrices of a closed loop, and those by which a change of K enters it, as dA = b2 dK c2.

    For several closed loops of one size the matrices have a first axis, that of the loops.

    Parameters
    ----------
    a, b, c, d : ndarray
        From w to z.
    b2, c2, d12, d21 : ndarray
        db = b2 dK d21, dc = d12 dK c2, dd = d12 dK d21.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    b2: Array
    c2: Array
    d12: Array
    d21: Array

    def at(self, place: int | Integers) -> Closed:
        """Return the loop, or the loops, at a place on the first axis."""
        return Closed(*(getattr(self, one.name)[place] for one in fields(self)))


@dataclass(frozen=True)
class Open:
    """Matrices of a plant with the controller's states, or of several of one size."""

    a: Array
    b1: Array
    b2: Array
    c1: Array
    c2: Array
    d11: Array
    d12: Array
    d21: Array
    d22: Array

    @staticmethod
    def stack(many: Sequence[Open]) -> Open:
        """Return several plants as one, with a first axis."""
        return Open(*(np.stack([getattr(m, one.name) for m in many]) for one in fields(Open)))

    def close_loop(self, gains: Array) -> Closed | None:
        """Return the closed loop with K; None if it is not well posed."""
        b2, c2, d12, d21, moved = self.b2, self.c2, self.d12, self.d21, gains
        if self.d22.any():
            left = np.eye(len(gains)) - gains @ self.d22
            right = np.eye(gains.shape[1]) - self.d22 @ gains
            # I − K D22 is nearly singular: the loop is not well posed in floating point
            if np.max(np.linalg.cond(left)) > 1e12:
                return None
            moved = _solve(left, np.broadcast_to(gains, (*left.shape[:-1], gains.shape[1])))
            # dK₀ = (I − K D22)⁻¹ dK (I − D22 K)⁻¹
            turned = left.swapaxes(-1, -2)
            b2, d12 = (_solve(turned, m.swapaxes(-1, -2)).swapaxes(-1, -2) for m in (b2, d12))
            c2, d21 = (_solve(right, m) for m in (c2, d21))
        bk, dk = self.b2 @ moved, self.d12 @ moved
        return Closed(
            self.a + bk @ self.c2,
            self.b1 + bk @ self.d21,
            self.c1 + dk @ self.c2,
            self.d11 + dk @ self.d21,
            b2, c2, d12, d21,
        )  # fmt: skip


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


class OpenLoop:
    """A plant augmented by the controller's states, prepared to be closed many times.

    Parameters
    ----------
    plant : DesignPlant
        Plant and channels.
    structure : Structure
        Of the controller: its order, numbers of u and y.

    Attributes
    ----------
    channels : list of tuple
        Outputs, inputs (as index arrays) and `Channel`.
    weights : list of float
        Of each channel: its own times the plant's, or one over the limit.
    open : Open
        Matrices.

    Raises
    ------
    InputError
        If the plant is in discrete time, or sizes or channels do not fit.
    """

    def __init__(self, plant: DesignPlant, structure: Structure) -> None:
        system, k = plant.system, structure.order
        nu, ny = structure.controls, structure.measurements
        what = f"plant {plant.name!r}" if plant.name else "the plant"
        (p, m), n = system.shape, system.order
        if system.dt_s is not None:
            raise InputError(
                f"{what} is in discrete time; design for its image in continuous time "
                "(systems.bilinear.continuous), and map the controller back"
            )
        if nu >= m or ny >= p:
            raise InputError(
                f"{what} has {m} inputs and {p} outputs: with {nu} controls and {ny} measurements "
                "no w or no z is left"
            )
        scaled, _ = balance_states(system)
        self.name, self.plant = what, plant
        m1, p1 = m - nu, p - ny
        # k integrators: their inputs are the first k controls, their states the first k
        # measurements
        a, b2 = np.zeros((n + k, n + k)), np.zeros((n + k, k + nu))
        c2, d22 = np.zeros((k + ny, n + k)), np.zeros((k + ny, k + nu))
        a[:n, :n], d22[k:, k:] = scaled.a, scaled.d[p1:, m1:]
        b2[:n, k:], b2[n:, :k] = scaled.b[:, m1:], np.eye(k)
        c2[k:, :n], c2[:k, n:] = scaled.c[p1:], np.eye(k)
        self.open = Open(
            a=a,
            b1=np.vstack([scaled.b[:, :m1], np.zeros((k, m1))]),
            b2=b2,
            c1=np.hstack([scaled.c[:p1], np.zeros((p1, k))]),
            c2=c2,
            d11=scaled.d[:p1, :m1],
            d12=np.hstack([np.zeros((p1, k)), scaled.d[:p1, m1:]]),
            d21=np.vstack([np.zeros((k, m1)), scaled.d[p1:, :m1]]),
            d22=d22,
        )
        self.channels = [self._place(channel, p1, m1) for channel in plant.channels]
        if not self.channels:
            raise InputError(f"{what} has no channel")
        self.weights = [
            plant.weight * c.weight if c.limit is None else c.weight / c.limit
            for c in plant.channels
        ]
        if not plant.weight > 0.0:
            raise InputError(f"{what}: a weight must be > 0, got {plant.weight}")
        poles = np.abs(np.linalg.eigvals(scaled.a)) if n else np.ones(1)
        # the plant's typical rate is the geometric mean of its poles; integrators do not count
        there = poles[poles > 1e-8 * max(float(poles.max()), 1e-300)]
        self.rate = float(np.exp(np.mean(np.log(there)))) if there.size else 1.0
        self._scaled, self._size = scaled, (p1, m1)
        self.sizes = self._sizes(scaled, m1, p1)

    def _place(self, channel: Channel, p1: int, m1: int) -> tuple[Integers, Integers, Channel]:
        rows = np.arange(p1) if channel.outputs is None else np.array(channel.outputs, dtype=int)
        columns = np.arange(m1) if channel.inputs is None else np.array(channel.inputs, dtype=int)
        for indices, count, kind in ((rows, p1, "outputs z"), (columns, m1, "inputs w")):
            if not indices.size or indices.min() < 0 or indices.max() >= count:
                raise InputError(f"{self.name} has {count} {kind}, a channel asks for {indices}")
        if channel.norm == "h2":
            direct = self.open.d11[np.ix_(rows, columns)].any()
            if direct or (self.open.d12[rows].any() and self.open.d21[:, columns].any()):
                raise InputError(
                    f"{self.name}: an H2 norm is infinite with a direct term from w to z (D11, or "
                    "D12 and D21 together); filter w or y"
                )
        return rows, columns, channel

    def _sizes(self, scaled: LtiSystem, m1: int, p1: int) -> Sizes:
        def lengths(matrix: Array) -> Array:
            norms = np.linalg.norm(matrix, axis=0)
            return np.where(norms > 0.0, norms, 1.0)

        u = self.rate / lengths(scaled.b[:, m1:]) if scaled.order else lengths(scaled.d[:, m1:])
        y = lengths(scaled.c[p1:].T) if scaled.order else lengths(scaled.d[p1:].T)
        return Sizes(u, y, self.rate)

    def sizes_at(self, omega: float) -> Sizes:
        """Return typical sizes of u and y for a loop with a bandwidth, rad/s.

        Each u makes some z of order one at that frequency; each y is the response to w of order one
        or to such u.
        """
        p1, m1 = self._size
        gains = np.abs(self._scaled.response(np.array([omega]))[0])
        reach = gains[:p1, m1:].max(axis=0, initial=0.0)
        u = 1.0 / np.where(reach > 0.0, reach, 1.0)
        y = np.maximum(
            gains[p1:, :m1].max(axis=1, initial=0.0), (gains[p1:, m1:] * u).max(axis=1, initial=0.0)
        )
        return Sizes(u, np.where(y > 0.0, y, 1.0), omega)

    def close(self, gains: Array) -> Closed | None:
        """Return the closed loop with K; None if it is not well posed."""
        return self.open.close_loop(gains)
