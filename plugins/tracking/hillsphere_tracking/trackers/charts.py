"""Charts: coordinates in which mean elements are estimated.

Two or three elements are estimated directly. All six are estimated as equinoctial elements
a, e cos ϖ, e sin ϖ, t cos Ω, t sin Ω, λ (see `hillsphere_tracking.dynamics_brouwer.Equinoctial`),
which are regular for circular and equatorial orbits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.interfaces import Array
from hillsphere_tracking.mean_elements import classical, equinoctial

__all__ = ["Chart", "EquinoctialElements", "SelectedElements"]

_FLOOR = 1e-7
"""Least e and tan(i/2) of an orbit in equinoctial elements: 0.7 m of a low orbit, and far enough
above rounding for the large parts of the derivatives by Ω, ω and M to cancel."""


class Chart(Protocol):
    """Coordinates of the estimated elements.

    `sense` (N,) is the retrograde sign of the nominal orbit (`mean_elements.retrograde_sign`); it
    does not change during the estimation.
    """

    @property
    def count(self) -> int:
        """Number n of coordinates."""
        ...

    def regularise(self, elements: Array, sense: Array) -> Array:
        """Move elements (6, N) away from singularities, where a derivative is not finite."""
        ...

    def columns(self, elements: Array, sense: Array) -> Array:
        """Return the derivatives (N, 6, n) of the elements (6, N) by the coordinates."""
        ...

    def project_slopes(
        self, by: Array, others: Sequence[int], elements: Array, sense: Array
    ) -> Array:
        """Convert derivatives by the elements to derivatives by the coordinates (chain rule).

        `by` has the shape (k, ≥ 6, N): derivatives by the six elements, then by other quantities.
        The result has the shape (k, n + len(others), N); `others` are indices along the second axis
        of the quantities that are kept unchanged.
        """
        ...

    def apply_step(self, elements: Array, step: Array, sense: Array) -> Array:
        """Return the elements (6, N) after the coordinates change by a step (n, N)."""
        ...

    def carry(
        self, covariance: Array, before: Array, after: Array, slopes: Array, sense: Array
    ) -> None:
        """Propagate the covariance (m, m, N) of n coordinates and m − n constants, in place.

        `before` and `after` are the mean elements (6, N) at both times; `slopes` (3, 3, N) are the
        derivatives of the later Ω, ω, M by a, e, i.
        """
        ...

    def prior(self, elements: Array, sigmas: Array, sense: Array) -> Array:
        """Return the covariance (N, n, n) for standard deviations (6,) of a, e, i, Ω, ω, M.

        The standard deviation of e holds for both components of the eccentricity vector; the one
        of ω is not used.
        """
        ...

    def walk(self, elements: Array, drift_m: float) -> Array:
        """Return the growth rates (N, n), per second, of the variances of a random walk.

        After one hour each coordinate has a standard deviation that displaces the satellite by
        about `drift_m`.
        """
        ...


class SelectedElements:
    """Chart of selected elements, which are their own coordinates.

    Parameters
    ----------
    rows : sequence of int
        Indices of the elements: Ω, ω, M (3, 4, 5), optionally preceded by a (0).
    """

    def __init__(self, rows: Sequence[int]) -> None:
        self.rows = list(rows)
        self.count = len(self.rows)
        self._unit = np.eye(6)[:, self.rows]
        self._turning = np.array([row - 3 for row in self.rows if row >= 3])
        self._powers = np.array([0.0 if row == 0 else -2.0 for row in self.rows])

    def regularise(self, elements: Array, sense: Array) -> Array:
        """Return the elements unchanged: these coordinates have no singularities."""
        return elements

    def columns(self, elements: Array, sense: Array) -> Array:
        """Return the derivatives (N, 6, n)."""
        return np.broadcast_to(self._unit, (elements.shape[1], 6, self.count))

    def project_slopes(
        self, by: Array, others: Sequence[int], elements: Array, sense: Array
    ) -> Array:
        """Return derivatives (k, n + len(others), N)."""
        return by.take([*self.rows, *others], axis=1)

    def apply_step(self, elements: Array, step: Array, sense: Array) -> Array:
        """Return the elements after a step."""
        stepped = elements.copy()
        stepped[self.rows] += step
        return stepped

    def carry(
        self, covariance: Array, before: Array, after: Array, slopes: Array, sense: Array
    ) -> None:
        """Propagate the covariance (m, m, N) in place: P ← Φ P Φᵀ."""
        # Φ differs from 1 only in the column of a, whose error changes the rates of Ω, ω and M.
        if self.rows[0] == 0:
            turned = slopes[self._turning, 0]
            n = self.count
            covariance[1:n] += turned[:, None] * covariance[:1]
            covariance[:, 1:n] += covariance[:, :1] * turned

    def prior(self, elements: Array, sigmas: Array, sense: Array) -> Array:
        """Return the covariance (N, n, n)."""
        covariance = np.empty((elements.shape[1], self.count, self.count))
        covariance[:] = np.diag(sigmas[self.rows] ** 2)
        return covariance

    def walk(self, elements: Array, drift_m: float) -> Array:
        """Return growth rates (N, n) of the variances."""
        return np.asarray(drift_m * drift_m / HOUR_S * elements[0][:, None] ** self._powers)


class EquinoctialElements:
    """Chart of all six elements in equinoctial coordinates."""

    count = 6

    def regularise(self, elements: Array, sense: Array) -> Array:
        """Return the elements with e and tan(i/2), or cot(i/2), not below 1e-7."""
        regular = elements.copy()
        regular[1] = np.maximum(regular[1], _FLOOR)
        least = 2.0 * np.arctan(_FLOOR)
        regular[2] = np.where(
            sense > 0.0, np.maximum(regular[2], least), np.minimum(regular[2], np.pi - least)
        )
        return regular

    def columns(self, elements: Array, sense: Array) -> Array:
        """Return the derivatives (N, 6, 6) of a, e, i, Ω, ω, M by the equinoctial elements."""
        e, (cw, sw), (cn, sn), tangent = _parts(elements, sense)
        tilt = 2.0 * sense / (1.0 + tangent * tangent)
        zero = np.zeros_like(e)
        slopes = np.zeros((elements.shape[1], 6, 6))
        slopes[:, 0, 0] = slopes[:, 5, 5] = 1.0
        slopes[:, 1, 1:3] = np.array([cw, sw]).T
        slopes[:, 2, 3:5] = np.array([tilt * cn, tilt * sn]).T
        by_node = np.array([zero, zero, zero, -sn / tangent, cn / tangent, zero]).T
        by_turned = np.array([zero, -sw / e, cw / e, zero, zero, zero]).T
        slopes[:, 3] = by_node
        slopes[:, 4] = by_turned - sense[:, None] * by_node
        slopes[:, 5] -= by_turned
        return slopes

    def project_slopes(
        self, by: Array, others: Sequence[int], elements: Array, sense: Array
    ) -> Array:
        """Return derivatives (k, 6 + len(others), N)."""
        own = by[:, :6].transpose(2, 0, 1) @ self.columns(elements, sense)
        return np.concatenate([own.transpose(1, 2, 0), by.take(others, axis=1)], axis=1)

    def apply_step(self, elements: Array, step: Array, sense: Array) -> Array:
        """Return the elements after a step, with e below 0.98 and a at least a third of before.

        A step beyond that would leave the theory or the ellipses; a later measurement, or another
        linearisation, corrects the rest.
        """
        orbit = equinoctial(elements, sense) + step
        orbit[0] = np.maximum(orbit[0], elements[0] / 3.0)
        size = np.hypot(orbit[1], orbit[2])
        orbit[1:3] *= np.where(size > 0.98, 0.98 / np.maximum(size, 0.98), 1.0)
        return self.regularise(classical(orbit, sense), sense)

    def carry(
        self, covariance: Array, before: Array, after: Array, slopes: Array, sense: Array
    ) -> None:
        """Propagate the covariance (m, m, N) in place: P ← Φ P Φᵀ."""
        # Φ = ∂(equinoctial)/∂(later elements) · ∂(later)/∂(earlier elements) · ∂(earlier)/∂(equin.)
        by_elements = np.zeros((before.shape[1], 6, 6))
        by_elements[:] = np.eye(6)
        by_elements[:, 3:, :3] = slopes.transpose(2, 0, 1)
        transition = self._by_elements(after, sense) @ by_elements @ self.columns(before, sense)
        inward = covariance.transpose(2, 0, 1).copy()
        inward[:, :6] = transition @ inward[:, :6]
        inward[:, :, :6] = inward[:, :, :6] @ transition.transpose(0, 2, 1)
        covariance[:] = inward.transpose(1, 2, 0)

    def prior(self, elements: Array, sigmas: Array, sense: Array) -> Array:
        """Return the covariance (N, 6, 6).

        The orbit's pole is assumed to be known across the node no better than along it, where the
        inclination's standard deviation holds: for a small inclination the node's standard
        deviation alone would make the pole too certain.
        """
        by = self._by_elements(elements, sense)
        _, _, (cn, sn), tangent = _parts(elements, sense)
        columns = np.zeros((elements.shape[1], 6, 7))
        columns[:, :, [0, 2, 3, 5]] = by[:, :, [0, 2, 3, 5]] * sigmas[[0, 2, 3, 5]]
        # both components of the eccentricity vector, independent of the perigee's direction
        columns[:, 1, 1] = columns[:, 2, 4] = sigmas[1]
        tilt = 0.5 * (1.0 + tangent * tangent)
        # the part that the node's standard deviation falls short of, across the node
        short = np.maximum(tilt * sigmas[2] - tangent * sigmas[3], 0.0)
        columns[:, 3, 6], columns[:, 4, 6] = -sn * short, cn * short
        return np.asarray(columns @ columns.transpose(0, 2, 1))

    def walk(self, elements: Array, drift_m: float) -> Array:
        """Return growth rates (N, 6) of the variances."""
        rates = np.empty((elements.shape[1], 6))
        rates[:] = ((drift_m / elements[0]) ** 2 / HOUR_S)[:, None]
        rates[:, 0] = drift_m**2 / HOUR_S
        return rates

    @staticmethod
    def _by_elements(elements: Array, sense: Array) -> Array:
        """Return the derivatives (N, 6, 6) of the equinoctial elements by a, e, i, Ω, ω, M."""
        e, (cw, sw), (cn, sn), tangent = _parts(elements, sense)
        tilt = 0.5 * sense * (1.0 + tangent * tangent)
        slopes = np.zeros((elements.shape[1], 6, 6))
        slopes[:, 0, 0] = slopes[:, 5, 4] = slopes[:, 5, 5] = 1.0
        slopes[:, 5, 3] = sense
        slopes[:, 1, 1], slopes[:, 1, 3], slopes[:, 1, 4] = cw, -e * sw * sense, -e * sw
        slopes[:, 2, 1], slopes[:, 2, 3], slopes[:, 2, 4] = sw, e * cw * sense, e * cw
        slopes[:, 3, 2], slopes[:, 3, 3] = tilt * cn, -tangent * sn
        slopes[:, 4, 2], slopes[:, 4, 3] = tilt * sn, tangent * cn
        return slopes


def _parts(
    elements: Array, sense: Array
) -> tuple[Array, tuple[Array, Array], tuple[Array, Array], Array]:
    """Return e, (cos ϖ, sin ϖ), (cos Ω, sin Ω) and t = tan(i/2) or cot(i/2)."""
    _, e, i, node, perigee, _ = elements
    turned = perigee + sense * node
    tangent = np.tan(0.5 * np.where(sense > 0.0, i, np.pi - i))
    return e, (np.cos(turned), np.sin(turned)), (np.cos(node), np.sin(node)), tangent
