"""Gravity of two spheres joined by a rod."""

from __future__ import annotations

from hillsphere.interfaces import Parameter
from hillsphere.symbolic import Expr, Params, Vec3, dot, log, power, sqrt, sum_of

from hillsphere_dumbbell.specs import DumbbellSpec

__all__ = ["Dumbbell"]


class Dumbbell:
    r"""Two spheres at the ends of a homogeneous straight rod along the x axis.

    With the distances :math:`r_1, r_2` from the ends, :math:`s = r_1 + r_2` and the rod's length L
    the potential is [1]_

    .. math:: U = \frac{\mu_1}{r_1} + \frac{\mu_2}{r_2} + \frac{\mu_r}{L}\ln\frac{s+L}{s-L}

    and, as :math:`\nabla s = \hat r_1 + \hat r_2`, the rod's attraction is
    :math:`-2\mu_r\,(\hat r_1 + \hat r_2)/(s^2 - L^2)`. Valid outside the spheres; singular on the
    rod. The centre of mass is the origin.

    Parameters
    ----------
    spec : DumbbellSpec
        Its parameters, all of which may be set at run time: ``gm``, ``length``, ``rod_fraction``,
        ``first_share``.

    References
    ----------
    .. [1] Riaguas, Elipe, Lara (1999), Periodic orbits around a massive straight segment,
       Celestial Mechanics and Dynamical Astronomy 73, section 2 (the rod).
    """

    frame = "body"

    def __init__(self, spec: DumbbellSpec) -> None:
        self.spec = spec
        self.gm_m3_s2 = spec.gm_m3_s2

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the numbers that may be set at run time."""
        return (
            Parameter("gm", self.spec.gm_m3_s2, "m3/s2"),
            Parameter("length", self.spec.length_m, "m"),
            Parameter("rod_fraction", self.spec.rod_fraction),
            Parameter("first_share", self.spec.first_share),
        )

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return +U, m²/s², at the body-fixed position r, m."""
        first, second, rod = self._masses(p)
        (_, r1), (_, r2) = self._ends(r, p)
        s = r1 + r2
        stretched = log((s + p["length"]) / (s - p["length"])) / p["length"]
        return sum_of([first / r1, second / r2, rod * stretched])

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m/s², at the body-fixed position r, m."""
        first, second, rod = self._masses(p)
        (a, r1), (b, r2) = self._ends(r, p)
        s = r1 + r2
        tension = 2.0 * rod / (s * s - p["length"] * p["length"])
        by_first = -(first * power(r1, -3.0) + tension / r1)
        by_second = -(second * power(r2, -3.0) + tension / r2)
        x, y, z = (by_first * u + by_second * v for u, v in zip(a, b, strict=True))
        return (x, y, z)

    @staticmethod
    def _masses(p: Params) -> tuple[Expr, Expr, Expr]:
        """Gravitational parameters of the first sphere, the second, and the rod."""
        rod = p["gm"] * p["rod_fraction"]
        spheres = p["gm"] - rod
        first = spheres * p["first_share"]
        return first, spheres - first, rod

    @staticmethod
    def _ends(r: Vec3, p: Params) -> tuple[tuple[Vec3, Expr], tuple[Vec3, Expr]]:
        """Vectors from both ends to r, with their lengths."""
        half = 0.5 * p["length"]
        # The heavier sphere draws the centre of mass, so the rod's centre lies the other way.
        centre = (p["rod_fraction"] - 1.0) * (2.0 * p["first_share"] - 1.0) * half
        a: Vec3 = (r[0] - centre - half, r[1], r[2])
        b: Vec3 = (r[0] - centre + half, r[1], r[2])
        return (a, sqrt(dot(a, a))), (b, sqrt(dot(b, b)))
