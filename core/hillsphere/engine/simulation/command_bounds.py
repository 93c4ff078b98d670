"""Bounds of an affine law's command over a sub-step, without intervals for its states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.enclosures import LinearRows, growth
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.engine.dynamics.system import PlantBounds
from hillsphere.interfaces.loop import ContinuousLaw

__all__ = ["AffineLaw", "PlantUnderCommand", "affine_law"]

_SAME_STEP = 1.0 + 1e-6
"""Factor on a step's length for which the bound is computed. Nominally equal steps differ by the
rounding of times; since the bound increases with the length, that of a slightly longer step serves
all of them."""
_TUBES = 16
"""Number of step lengths whose bound is cached: those of legs, their sub-steps, and bisections."""
_MARGIN = 1e-9
"""Relative margin for the rounding of matrix products of some tens of terms."""


@dataclass(frozen=True, eq=False)
class PlantUnderCommand:
    """A plant whose command is only known to lie in a box, given by the last rows of p."""

    plant: PlantBounds
    parameters: int
    linear: LinearRows | None = None

    def rates(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the rates, for any change of the command within its box."""
        moving = any(part.rate is not None for part in y)
        change = iv.EVERYTHING if moving else None
        u = [Bound(row, change, change) for row in p[self.parameters :]]
        return self.plant.rates(t, y, p[: self.parameters], u)

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the plant's events."""
        return self.plant.events(t, y, p[: self.parameters])


@dataclass(eq=False)
class AffineLaw:
    """A law on held measurements, ẋ_c = A z + a and u = C z + c with z = (x_c, r, y).

    Parameters
    ----------
    plant : PlantUnderCommand
        The plant that the law controls.
    a, c : ndarray, shape (m, m + 2q) and (p, m + 2q)
        Matrices.
    a0, c0 : ndarray, shape (m, 1) and (p, 1)
        Constants.
    inputs : int
        Number q of rows of reference and of measurement.
    """

    plant: PlantUnderCommand
    a: Array
    c: Array
    a0: Array
    c0: Array
    inputs: int
    tubes: dict[float, Array] = field(default_factory=dict)

    @property
    def states(self) -> int:
        """Number of states of the plant."""
        return len(self.plant.plant.unit)

    def command(self, y: Array, p: Array, h: float, held: Array) -> tuple[Array, Array]:
        """Bound the executed command in the sub-steps of a leg.

        Measurement and reference are held, so that ẋ_c(τ) = exp(Aτ) ẋ_c(0). The command therefore
        differs from that at the start of a sub-step by at most |C| G |ẋ_c(0)|, with G from
        `hillsphere.engine.dynamics.enclosures`.

        Parameters
        ----------
        y : ndarray, shape (steps + 1, rows, B)
            States of plant, law and effort at the ends of the sub-steps.
        p : ndarray, shape (k, B)
            Run-time parameters of the closed system.
        h : float
            Length of the longest sub-step.
        held : ndarray, shape (steps or 1, k, B)
            Run-time parameters of the sub-steps, which differ from `p` in the feedforward.

        Returns
        -------
        lo, hi : ndarray, shape (p, B)
            Bounds.
        """
        start, size = self._about(y, p, h, held)
        return (start - size).min(axis=0), (start + size).max(axis=0)

    def departure(self, y: Array, p: Array, middle: Array, h: float, held: Array) -> Array:
        """Bound |u − middle| in each sub-step; `middle` is (p, B), the rest as for `command`.

        Returns
        -------
        ndarray, shape (steps, p, B)
            Bounds.
        """
        start, size = self._about(y, p, h, held)
        start -= middle
        np.abs(start, out=start)
        start += size
        return start

    def _about(self, y: Array, p: Array, h: float, held: Array) -> tuple[Array, Array]:
        """Return the commands at the start of the sub-steps (steps, p, B), and their change."""
        m, count, q = len(self.a), len(self.c), self.inputs
        first, n = self.plant.parameters, y.shape[1] - 1 - len(self.a)
        begin = first + count + count**2
        seen = p[begin : begin + 2 * q]  # reference, measurement
        x = y[:-1, n : n + m]
        largest = max(float(np.abs(seen).max(initial=0.0)), float(np.abs(x).max(initial=0.0)))
        start = self.c[:, :m] @ x
        start += self.c[:, m:] @ seen + self.c0
        size = (_MARGIN * largest) * np.abs(self.c).sum(axis=1, keepdims=True)
        if m:
            # |u(τ) − u(0)| ≤ |C| G |ẋ_c(0)| with ẋ_c(0) = A z + a, see `command`.
            tube = self._tube(h)
            rate = self.a[:, :m] @ x
            rate += self.a[:, m:] @ seen + self.a0
            np.abs(rate, out=rate)
            rate += (_MARGIN * largest) * np.abs(self.a).sum(axis=1, keepdims=True)
            size = tube @ rate + size
        start += held[:, first : first + count]
        gain = p[first + count : begin]
        if (gain == np.eye(count).reshape(-1, 1)).all():
            return start, size
        gain = gain.reshape(count, count, -1)
        size = np.broadcast_to(size, start.shape)
        done = np.einsum("ijB,sjB->siB", gain, start)
        reach = np.einsum("ijB,sjB->siB", np.abs(gain), size) * (1.0 + _MARGIN)
        reach += _MARGIN * np.abs(done)
        return done, reach

    def _tube(self, h: float) -> Array:
        """Return |C| G (p, m) for a step of length h, see `enclosures`."""
        for known, tube in self.tubes.items():
            if h <= known <= _SAME_STEP**2 * h:
                return tube
        if len(self.tubes) >= _TUBES:
            self.tubes.clear()
        m, h = len(self.a), _SAME_STEP * h
        # For an unstable law and a long step the bound may overflow; it is then infinite.
        with np.errstate(over="ignore", invalid="ignore"):
            tube = np.abs(self.c[:, :m]) @ growth(self.a[:, :m], h) * (1.0 + 2.0 * _MARGIN)
        self.tubes[h] = tube
        return tube


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def affine_law(law: ContinuousLaw, plant: PlantBounds, run_time: int) -> AffineLaw | None:
    """Return the law in affine form; None if it is not affine or its measurement is not held."""
    m, q = len(law.states), law.inputs
    if law.measurement != "held":
        return None
    total = m + 2 * q
    columns = np.eye(total)
    slopes = [Bound(iv.EVERYTHING, iv.point(columns[i])) for i in range(total)]
    zeros = [Bound.of(0.0)] * total
    parts: list[tuple[Array, Array]] = []
    try:
        for function in (law.derivative, law.control):
            # The arguments of a law are its states, the measurement, then the reference.
            told = [
                tuple(s[i:j])
                for s in (slopes, zeros)
                for i, j in ((0, m), (m + q, total), (m, m + q))
            ]
            coefficients = function(
                told[0],
                told[1],
                told[2],
                Bound(iv.EVERYTHING, iv.EVERYTHING),
            )
            at_zero = function(told[3], told[4], told[5], Bound(iv.EVERYTHING))
            matrix, constant = (
                np.zeros((len(coefficients), total)),
                np.zeros((len(coefficients), 1)),
            )
            for i, (e, z) in enumerate(zip(coefficients, at_zero, strict=True)):
                low, high = Bound.of(e).rate or iv.point(0.0)
                matrix[i], constant[i] = 0.5 * (low + high), Bound.of(z).value[0]
                if not np.max(high - low) <= 1e-12 * np.max(np.abs(matrix[i]) + 1e-300):
                    return None
            parts.append((matrix, constant))
    except TypeError:
        return None
    (a, a0), (c, c0) = parts
    if not all(np.isfinite(part).all() for part in (a, a0, c, c0)):
        return None
    return AffineLaw(PlantUnderCommand(plant, run_time), a, c, a0, c0, q)
