"""Which mean elements are estimated, and in what coordinates: charts of the elements.

Two or three elements are their own coordinates. All six are estimated in equinoctial elements
a, e cos ϖ, e sin ϖ, t cos Ω, t sin Ω, λ (see `hillsphere_tracking.dynamics_brouwer.Equinoctial`),
so that circular and equatorial orbits need no special care.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.mean_elements import classical, equinoctial

__all__ = ["Chart", "EquinoctialElements", "SelectedElements"]

_HOUR = 3600.0
_FLOOR = 1e-7
"""Least e and tan(i/2) of an orbit in equinoctial elements: 0.7 m of a low orbit, and far enough
above rounding for the large parts of the derivatives by Ω, ω and M to cancel."""


class Chart(Protocol):
    """Coordinates of the elements that are estimated.

    `sense` (N,) is that of the nominal orbit (`mean_elements.retrograde_sign`); it stays with it.
    """

    @property
    def count(self) -> int:
        """How many there are, n."""
        ...

    def regularise(self, elements: Array, sense: Array) -> Array:
        """Return the elements (6, N), kept off the places where a derivative is not finite."""
        ...

    def columns(self, elements: Array, sense: Array) -> Array:
        """Return the derivatives (N, 6, n) of the elements (6, N) by the coordinates."""
        ...

    def project_slopes(
        self, by: Array, others: Sequence[int], elements: Array, sense: Array
    ) -> Array:
        """Return derivatives (k, n + len(others), N) by the coordinates, then some others.

        Of those (k, ≥ 6, N) by the elements, and by others that stand behind them.
        """
        ...

    def apply_step(self, elements: Array, step: Array, sense: Array) -> Array:
        """Return the elements (6, N) after a step (n, N) of the coordinates."""
        ...

    def carry(
        self, covariance: Array, before: Array, after: Array, slopes: Array, sense: Array
    ) -> None:
        """Carry the covariance (m, m, N) of n coordinates and m − n constants, in place.

        From one time to another, by mean elements (6, N) of both and the slopes (3, 3, N) of the
        later Ω, ω, M by a, e, i.
        """
        ...

    def prior(self, elements: Array, sigmas: Array, sense: Array) -> Array:
        """Return the covariance (N, n, n) for standard deviations (6,) of a, e, i, Ω, ω, M.

        That of e holds for both components of the eccentricity vector; that of ω is not used.
        """
        ...

    def walk(self, elements: Array, drift_m: float) -> Array:
        """Return growth rates (N, n) of the variances for a displacement, m, in an hour."""
        ...


class SelectedElements:
    """Some of the elements themselves.

    Parameters
    ----------
    rows : sequence of int
        Which: Ω, ω, M (3, 4, 5), and before them possibly a (0).
    """

    def __init__(self, rows: Sequence[int]) -> None:
        self.rows = list(rows)
        self.count = len(self.rows)
        self._unit = np.eye(6)[:, self.rows]
        self._turning = np.array([row - 3 for row in self.rows if row >= 3])
        self._powers = np.array([0.0 if row == 0 else -2.0 for row in self.rows])

    def regularise(self, elements: Array, sense: Array) -> Array:
        """Return the elements: every place is regular."""
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
        made = elements.copy()
        made[self.rows] += step
        return made

    def carry(
        self, covariance: Array, before: Array, after: Array, slopes: Array, sense: Array
    ) -> None:
        """Carry the covariance (m, m, N) in place."""
        if self.rows[0] == 0:
            turned = slopes[self._turning, 0]
            n = self.count
            covariance[1:n] += turned[:, None] * covariance[:1]
            covariance[:, 1:n] += covariance[:, :1] * turned

    def prior(self, elements: Array, sigmas: Array, sense: Array) -> Array:
        """Return the covariance (N, n, n)."""
        made = np.empty((elements.shape[1], self.count, self.count))
        made[:] = np.diag(sigmas[self.rows] ** 2)
        return made

    def walk(self, elements: Array, drift_m: float) -> Array:
        """Return growth rates (N, n) of the variances."""
        return np.asarray(drift_m * drift_m / _HOUR * elements[0][:, None] ** self._powers)


class EquinoctialElements:
    """All six elements, as equinoctial ones."""

    count = 6

    def regularise(self, elements: Array, sense: Array) -> Array:
        """Return the elements with e and tan(i/2), or cot(i/2), not below 1e-7."""
        made = elements.copy()
        made[1] = np.maximum(made[1], _FLOOR)
        least = 2.0 * np.arctan(_FLOOR)
        made[2] = np.where(
            sense > 0.0, np.maximum(made[2], least), np.minimum(made[2], np.pi - least)
        )
        return made

    def columns(self, elements: Array, sense: Array) -> Array:
        """Return the derivatives (N, 6, 6) of a, e, i, Ω, ω, M by the equinoctial elements."""
        e, (cw, sw), (cn, sn), tangent = _parts(elements, sense)
        tilt = 2.0 * sense / (1.0 + tangent * tangent)
        zero = np.zeros_like(e)
        made = np.zeros((elements.shape[1], 6, 6))
        made[:, 0, 0] = made[:, 5, 5] = 1.0
        made[:, 1, 1:3] = np.array([cw, sw]).T
        made[:, 2, 3:5] = np.array([tilt * cn, tilt * sn]).T
        by_node = np.array([zero, zero, zero, -sn / tangent, cn / tangent, zero]).T
        by_turned = np.array([zero, -sw / e, cw / e, zero, zero, zero]).T
        made[:, 3] = by_node
        made[:, 4] = by_turned - sense[:, None] * by_node
        made[:, 5] -= by_turned
        return made

    def project_slopes(
        self, by: Array, others: Sequence[int], elements: Array, sense: Array
    ) -> Array:
        """Return derivatives (k, 6 + len(others), N)."""
        own = by[:, :6].transpose(2, 0, 1) @ self.columns(elements, sense)
        return np.concatenate([own.transpose(1, 2, 0), by.take(others, axis=1)], axis=1)

    def apply_step(self, elements: Array, step: Array, sense: Array) -> Array:
        """Return the elements after a step; e is kept below 0.98, a above a third."""
        orbit = equinoctial(elements, sense) + step
        orbit[0] = np.maximum(orbit[0], elements[0] / 3.0)
        size = np.hypot(orbit[1], orbit[2])
        orbit[1:3] *= np.where(size > 0.98, 0.98 / np.maximum(size, 0.98), 1.0)
        return self.regularise(classical(orbit, sense), sense)

    def carry(
        self, covariance: Array, before: Array, after: Array, slopes: Array, sense: Array
    ) -> None:
        """Carry the covariance (m, m, N) in place."""
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

        Across the node the pole is taken to be no better known than the inclination.
        """
        by = self._by_elements(elements, sense)
        _, _, (cn, sn), tangent = _parts(elements, sense)
        columns = np.zeros((elements.shape[1], 6, 7))
        columns[:, :, [0, 2, 3, 5]] = by[:, :, [0, 2, 3, 5]] * sigmas[[0, 2, 3, 5]]
        columns[:, 1, 1] = columns[:, 2, 4] = sigmas[1]
        tilt = 0.5 * (1.0 + tangent * tangent)
        short = np.maximum(tilt * sigmas[2] - tangent * sigmas[3], 0.0)
        columns[:, 3, 6], columns[:, 4, 6] = -sn * short, cn * short
        return np.asarray(columns @ columns.transpose(0, 2, 1))

    def walk(self, elements: Array, drift_m: float) -> Array:
        """Return growth rates (N, 6) of the variances."""
        made = np.empty((elements.shape[1], 6))
        made[:] = ((drift_m / elements[0]) ** 2 / _HOUR)[:, None]
        made[:, 0] = drift_m**2 / _HOUR
        return made

    @staticmethod
    def _by_elements(elements: Array, sense: Array) -> Array:
        """Return the derivatives (N, 6, 6) of the equinoctial elements by a, e, i, Ω, ω, M."""
        e, (cw, sw), (cn, sn), tangent = _parts(elements, sense)
        tilt = 0.5 * sense * (1.0 + tangent * tangent)
        made = np.zeros((elements.shape[1], 6, 6))
        made[:, 0, 0] = made[:, 5, 4] = made[:, 5, 5] = 1.0
        made[:, 5, 3] = sense
        made[:, 1, 1], made[:, 1, 3], made[:, 1, 4] = cw, -e * sw * sense, -e * sw
        made[:, 2, 1], made[:, 2, 3], made[:, 2, 4] = sw, e * cw * sense, e * cw
        made[:, 3, 2], made[:, 3, 3] = tilt * cn, -tangent * sn
        made[:, 4, 2], made[:, 4, 3] = tilt * sn, tangent * cn
        return made


def _parts(
    elements: Array, sense: Array
) -> tuple[Array, tuple[Array, Array], tuple[Array, Array], Array]:
    """Return e, cosine and sine of ϖ and of Ω, and t."""
    _, e, i, node, perigee, _ = elements
    turned = perigee + sense * node
    tangent = np.tan(0.5 * np.where(sense > 0.0, i, np.pi - i))
    return e, (np.cos(turned), np.sin(turned)), (np.cos(node), np.sin(node)), tangent
