"""Libration points on the axis through the primary, and the planar motion beside them.

References
----------
.. [1] Szebehely, V., Theory of Orbits, Academic Press, 1967, chapters 4 and 5, section 10.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.dynamics import Derivatives, bracketed_roots
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Flow

__all__ = ["CollinearPoint", "collinear_point"]

_NEAREST, _FARTHEST, _SAMPLES = 1e-6, 1e2, 4000  # units of length, on the axis
_PLANE = np.ix_([0, 1, 3, 4], [0, 1, 3, 4])


@dataclass(frozen=True)
class CollinearPoint:
    """An equilibrium on the x axis next to the body, normalised.

    The linear planar oscillation is ξ = a cos ωt, η = −a κ sin ωt with η̇(0) = −a κ ω.

    Parameters
    ----------
    x : float
        Where it is; the body is at zero.
    frequency : float
        ω, of the planar oscillation.
    ratio : float
        κ, its axis ratio along y to along x.
    growth : float
        Rate of the unstable motion in the plane.
    """

    x: float
    frequency: float
    ratio: float
    growth: float

    @property
    def side(self) -> float:
        """1 beyond the body as seen from the primary, −1 between them."""
        return float(np.sign(self.x))


def collinear_point(flow: Flow, name: str) -> CollinearPoint:
    """Find L1 or L2, where the body's attraction balances the other accelerations of the frame.

    Parameters
    ----------
    flow : Flow
        States x, y, z, vx, vy, vz of a frame in which the body rests at the origin, its primary
        on the negative x axis.
    name : {"L1", "L2"}
        Which.

    Returns
    -------
    CollinearPoint
        The nearest balance outside the body's surface.

    Raises
    ------
    InputError
        If there is no such point, or no planar oscillation about it.
    """
    side = {"L1": -1.0, "L2": 1.0}.get(name)
    if side is None:
        raise InputError(f"a libration point beside a body is 'L1' or 'L2', got {name!r}")
    distance = np.geomspace(_NEAREST, _FARTHEST, _SAMPLES)
    distance = distance[_outside(flow, _at_rest(side * distance))]

    def outward(r: Array) -> Array:
        return np.asarray(side * flow.rate(_at_rest(side * r))[3])

    pull = outward(distance)
    # the body attracts nearby, the other terms repel farther out: the balance changes its sign
    turns = np.flatnonzero((pull[:-1] < 0.0) & (pull[1:] >= 0.0))
    if not turns.size:
        raise InputError(
            f"the plant has no point {name}: outside its body nothing balances the attraction"
        )
    i = turns[:1]
    r = bracketed_roots(outward, distance[i], distance[i + 1], pull[i], pull[i + 1], np.zeros(1))
    x = side * float(r[0])
    # linearised planar motion: eigenvalues ±λ (real, saddle) and ±iω (the oscillation)
    slopes = Derivatives(flow.system).both(_at_rest(np.array([x])))[1][:, :, 0]
    values, vectors = np.linalg.eig(slopes[_PLANE])
    k = int(np.argmax(values.imag))
    frequency = float(values[k].imag)
    # a real part beyond rounding means that the modes are not separate
    if frequency <= 0.0 or abs(values[k].real) > 1e-6 * frequency:
        raise InputError(f"there is no planar oscillation beside {name}, so no Lyapunov orbits")
    # the eigenvector's η is imaginary where its ξ is real, as the mirror xz wants it
    vector = vectors[:, k] / vectors[0, k]
    return CollinearPoint(
        x, frequency, -float(vector[3].real) / frequency, float(np.max(values.real))
    )


def _at_rest(x: Array) -> Array:
    return np.concatenate([x[None], np.zeros((5, x.size))])


def _outside(flow: Flow, x: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which states (6, N) are not inside the body, as far as the plant knows its surface."""
    if "impact" not in flow.system.events:
        return np.ones(x.shape[1], dtype=bool)
    level = flow.system.function(flow.system.events["impact"])
    return np.asarray(level(x, flow.system.parameters(None, x.shape[1]))[0] > 0.0)
