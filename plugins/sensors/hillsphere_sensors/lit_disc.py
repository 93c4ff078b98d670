r"""The centroid of the part of an ellipsoid that a camera sees and the Sun lights.

With the semi-axes :math:`A = \mathrm{diag}(a, b, c)` a surface point is :math:`A n`, n on the unit
sphere, and its normal is along :math:`A^{-1} n`. A camera at p sees it if :math:`n \cdot q > 1`
with :math:`q = A^{-1} p`, which is a cap; the Sun, far away in the direction s, lights the
hemisphere :math:`n \cdot A^{-1} s > 0`. An aberration of the sphere by :math:`\kappa = 1/|q|` along
q,

.. math:: m_z = \frac{n_z - \kappa}{1 - \kappa n_z}, \quad
          m_{x,y} = \frac{\sqrt{1 - \kappa^2}\, n_{x,y}}{1 - \kappa n_z},

is conformal, and turns the limb into the great circle :math:`m_z = 0` and the terminator into a
plane section. Both planes contain the line through the two horns of the crescent. The half planes
that begin in this line, at angles ψ from the limb's to the terminator's, cut the sphere in arcs
from horn to horn, whose points have angles η about the centre of their circle. The area is
:math:`r\, d\psi\, d\eta`, with the distance r from the line. In these coordinates limb and
terminator are straight edges, the integrands are smooth up to them, and the ratio of the Lommel-
Seeliger law depends on ψ alone near the horns. Both integrals are Gauss-Legendre sums.

A point counts by its solid angle as seen by the camera times its radiance relative to a common
factor [1]_: 1 (``uniform``), :math:`\mu_0` (``lambert``) or :math:`\mu_0 / (\mu_0 + \mu)`
(``lommel_seeliger``), with the cosines :math:`\mu_0` of incidence and :math:`\mu` of emission.

References
----------
.. [1] Hapke (2012), Theory of Reflectance and Emittance Spectroscopy, 2nd ed., Cambridge, sec. 8.
"""

from __future__ import annotations

from functools import cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_sensors.spacecraft import rotate

__all__ = ["Law", "disc_centroid", "radiance"]

Law: TypeAlias = Literal["uniform", "lambert", "lommel_seeliger"]

_PARTLY, _NEARLY, _FULLY = (10, 14), (20, 20), (12, 20)
"""Nodes in ψ and η of a disc that is partly, nearly and fully lit. From eight radii away of a body
with axes in the ratio 2 : 1.4 : 1 they err by less than 1e-4 of its radius in the image."""
_NEAR_FULL = -0.5
"""Where on the limb (−1: opposite to the Sun) the horns of a nearly full disc are. Near −1 they
are close together, and the arcs change fast about ψ = 90°."""
_CLOSEST_HORNS = 0.05
"""Least half distance of the horns to which the nodes are fitted. A smaller one would thin them out
elsewhere; what lies between such horns is 1e-3 of the disc."""
_EVEN = 3.0
"""Width over which nodes are spread almost evenly: twice the interval of ψ."""
_AT_ONCE = 1_000_000
"""Nodes times lanes that are computed at once, which bounds the memory (8 MB an array)."""


def disc_centroid(
    place: Array,
    frame: Array,
    semi_axes_m: Array,
    light: Array | None = None,
    law: Law = "uniform",
    order: tuple[int, int] | None = None,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return where in the image the centroid of the visible, sunlit part of an ellipsoid is.

    Parameters
    ----------
    place : ndarray, shape (3, N)
        Positions of the camera in the axes of the body, m.
    frame : ndarray, shape (3, 3, N)
        Axes of the camera as rows, in those of the body; the third is the boresight.
    semi_axes_m : ndarray, shape (3,)
        Semi-axes, m.
    light : ndarray, shape (3, N), optional
        Directions to the Sun, of any length; left out: everything is lit.
    law : {"uniform", "lambert", "lommel_seeliger"}
        Photometric function.
    order : tuple of int, optional
        Nodes in ψ and η; by default few, and more in lanes in which almost the whole disc is lit.
        A multiple shows the error.

    Returns
    -------
    slopes : ndarray, shape (2, N)
        Weighted means of x/z and y/z in the axes of the camera; zero where nothing is visible.
    there : ndarray of bool, shape (N,)
        Whether anything is visible; from inside the body nothing is.
    """
    cases = place.shape[1]
    slopes, there = np.zeros((2, cases)), np.zeros(cases, dtype=bool)
    towards = place if light is None else light
    planes = _Planes(place, towards, semi_axes_m)
    groups = [(order or _PARTLY, planes.seen)]
    if order is None:
        full = planes.seen & (planes.horns <= -1.0)
        nearly = planes.seen & (planes.horns <= _NEAR_FULL) & ~full
        groups = [(_FULLY, full), (_NEARLY, nearly), (_PARTLY, planes.seen & ~(full | nearly))]
    for nodes, chosen in groups:
        lanes = np.flatnonzero(chosen)
        size = max(1, _AT_ONCE // (nodes[0] * nodes[1]))
        for first in range(0, lanes.size, size):
            some = lanes[first : first + size]
            own = planes if some.size == cases else _Planes(
                place[:, some], towards[:, some], semi_axes_m
            )  # fmt: skip
            slopes[:, some], there[some] = own.centroid(frame[:, :, some], law, nodes)
    return slopes, there


def radiance(law: Law, incidence: Array, emission: Array) -> Array:
    """Return the radiance of a lit surface over that of the Sun's light, and a constant factor.

    Parameters
    ----------
    law : {"uniform", "lambert", "lommel_seeliger"}
        Photometric function.
    incidence, emission : ndarray, shape (...)
        Cosines of the angles from the normal to the Sun and to the camera; with an incidence of
        zero or less the surface is dark.

    Returns
    -------
    ndarray, shape (...)
        Radiance, without unit.
    """
    lit = np.maximum(incidence, 0.0)
    if law == "uniform":
        return np.asarray(incidence > 0.0, dtype=float)
    if law == "lambert":
        return lit
    return np.asarray(lit / np.maximum(lit + np.maximum(emission, 0.0), 1e-300))


class _Planes:
    """Limb and terminator of N lanes, see the module; arrays (…, N).

    Parameters
    ----------
    place, light : ndarray, shape (3, N)
        Camera, m, and direction to the Sun, in the axes of the body.
    semi_axes_m : ndarray, shape (3,)
        Semi-axes, m.
    """

    def __init__(self, place: Array, light: Array, semi_axes_m: Array) -> None:
        self.place, self.axes = place, semi_axes_m[:, None]
        q, sun = place / self.axes, light / self.axes
        away = np.sqrt(np.sum(q * q, axis=0))
        outside = away > 1.0
        self.kappa = 1.0 / np.where(outside, away, 2.0)
        third = q / np.maximum(away, 1e-300)
        self.brightness = np.sqrt(np.sum(sun * sun, axis=0) / np.sum(light * light, axis=0))
        sun = sun / np.sqrt(np.sum(sun * sun, axis=0))
        along = np.sum(sun * third, axis=0)
        across = sun - along * third
        size = np.sqrt(np.sum(across * across, axis=0))
        # with the Sun behind the camera any axis across the line of sight serves
        other = np.eye(3)[np.argmin(np.abs(third), axis=0)].T
        other = other - np.sum(other * third, axis=0) * third
        across = np.where(size > 1e-12, across, other)
        first = across / np.sqrt(np.sum(across * across, axis=0))
        second = np.array([third[i - 2] * first[i - 1] - third[i - 1] * first[i - 2]
                           for i in range(3)])  # fmt: skip
        self.turn = np.stack([first, second, third], axis=1)
        self.root = np.sqrt((1.0 - self.kappa) * (1.0 + self.kappa))
        # n · sun is proportional to a m_x + b (m_z + κ)
        self.a, self.b = self.root * np.where(size > 1e-12, size, 0.0), along
        behind = -self.b * self.kappa
        steep = np.abs(behind) >= self.a
        self.horns = np.where(steep, np.copysign(1.0, behind), behind / np.where(steep, 1, self.a))
        """m_x of the horns: −1 if all of the disc is lit, 1 if nothing is."""
        self.seen = outside & (self.horns < 1.0)

    def centroid(
        self, frame: Array, law: Law, nodes: tuple[int, int]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return x/z and y/z (2, N) of the centroid, and whether anything is ahead."""
        kappa, root = self.kappa, self.root
        x, y, z, weight = self._arcs(nodes)
        shrink = 1.0 / (1.0 + kappa * z)
        # n − κ e_z along the line of sight, which vanishes at the limb
        over = (root * root) * z * shrink
        n = np.array([root * x * shrink, root * y * shrink, (z + kappa) * shrink])
        stretched = np.einsum("ijn,jn,jkn->ikn", frame, self.axes + 0.0 * self.place, self.turn)
        origin = rotate(frame, self.place)[:, None, None]
        u, v, ahead = rotate(stretched, n) - origin
        square = u * u + v * v + ahead * ahead
        # solid angle over that of the sphere: det A (n · q − 1)/distance³, and the aberration's
        facing = over / kappa
        weight *= shrink * shrink * facing / (square * np.sqrt(square))
        weight *= self._radiance(law, x, z, n, shrink, facing / np.sqrt(square))
        weight *= ahead > 0.0
        total = np.sum(weight, axis=(0, 1))
        there = total > 0.0
        weight /= np.where(there, total, 1.0) * np.where(ahead > 0.0, ahead, 1.0)
        middle = [np.sum(weight * u, axis=(0, 1)), np.sum(weight * v, axis=(0, 1))]
        return np.array(middle), there

    def _radiance(
        self, law: Law, x: Array, z: Array, n: Array, shrink: Array, facing: Array
    ) -> Array | float:
        """Return the radiance at the nodes; `facing` is µ times the length of A⁻¹ n."""
        if law == "uniform":
            return 1.0
        lit = np.maximum(self.a * x + self.b * (z + self.kappa), 0.0)
        lit *= shrink * self.brightness
        if law == "lommel_seeliger":  # the length of the normal cancels
            return radiance(law, lit, facing)
        normal = rotate(self.turn, n) / self.axes[:, None, None]
        return np.asarray(lit / np.sqrt(np.sum(normal * normal, axis=0)))

    def _arcs(self, nodes: tuple[int, int]) -> tuple[Array, Array, Array, Array]:
        """Return m_x, m_y, m_z and the areas of the nodes, each (n_ψ, n_η, N)."""
        h = self.horns
        (t, by), (s, around) = _gauss(nodes[0]), _gauss(nodes[1])
        full = h <= -1.0
        apart = np.sqrt((1.0 - h) * (1.0 + h))
        last = np.where(full, 0.0, np.arctan2(self.b, self.a))
        # ψ = 90° − w sinh τ: the radius of an arc, ρ² = cos² ψ + apart² sin² ψ, changes fast about
        # ψ = 90° if the horns are close
        close = (h <= _NEAR_FULL) & ~full
        w = np.where(close, np.maximum(apart, _CLOSEST_HORNS), _EVEN)
        low, high = -np.arcsinh(last / w), np.arcsinh(0.5 * np.pi / w)
        half = 0.5 * (high - low)
        tau = low + half * (1.0 + t[:, None])
        psi = 0.5 * np.pi - w * np.sinh(tau)
        area = by[:, None] * half * w * np.cosh(tau)
        cosine, sine = np.cos(psi), np.sin(psi)
        centre = -h * cosine
        rho = np.sqrt(np.maximum(apart * apart + centre * centre, 1e-300))
        reach = np.arccos(np.clip(-centre / rho, -1.0, 1.0))
        angle = reach[:, None] * s[:, None]
        r = np.maximum(centre[:, None] + rho[:, None] * np.cos(angle), 0.0)
        weight = (area * reach)[:, None] * around[:, None] * r
        y = rho[:, None] * np.sin(angle)
        return h + r * cosine[:, None], y, r * sine[:, None], weight


@cache
def _gauss(count: int) -> tuple[Array, Array]:
    """Return nodes and weights (count,) of Gauss and Legendre on [−1, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights
