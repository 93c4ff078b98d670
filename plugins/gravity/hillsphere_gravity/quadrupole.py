"""Gravity of a mesh at a large distance: mass, centre and second moments."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array, Parameter
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.symbolic import Expr, Params, Vec3, dot, gradient, norm, substitute, variables

__all__ = ["Quadrupole", "second_moments"]

_PLAIN = variables("far:x", "far:y", "far:z")


class Quadrupole:
    r"""The first terms of the potential of a homogeneous mesh of unit Gρ.

    .. math:: U = \frac Vr + \frac{V\,c\cdot x}{r^3} + \frac{3x\cdot Px - r^2\,\mathrm{tr}P}{2r^5}

    with the volume V, its centre c and P = ∫ x x dV; what is left out is of order (R/r)³.

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    """

    frame = "body"

    def __init__(self, mesh: Mesh) -> None:
        # Lengths in units of the body, so that powers of them stay within the range of floats.
        self._unit = mesh.largest_radius_m
        self.gm_m3_s2 = mesh.volume_m3
        self._centre = (mesh.centroid_m / self._unit).tolist()
        moments = second_moments(mesh) / (mesh.volume_m3 * self._unit**2)
        # 3 x·Px − r² tr P over 2 r⁵ as one quadratic form of the direction
        self._form = (1.5 * moments - 0.5 * np.trace(moments) * np.eye(3)).tolist()

    def parameters(self) -> tuple[Parameter, ...]:
        """Return none."""
        return ()

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return U, m², for Gρ = 1."""
        distance = norm(r)
        way = [q / distance for q in r]
        near = self._unit / distance
        form = dot(way, [dot(row, way) for row in self._form])
        return self.gm_m3_s2 / distance * (1.0 + near * (dot(self._centre, way) + near * form))

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m, for Gρ = 1."""
        x, y, z = _PLAIN
        slopes = gradient(self.potential((x, y, z), p), _PLAIN)
        gx, gy, gz = substitute(slopes, dict(zip(_PLAIN, r, strict=True)))
        return (gx, gy, gz)


def second_moments(mesh: Mesh) -> Array:
    """Return ∫ x x dV over the volume of a mesh, shape (3, 3), m⁵.

    Of a pyramid of volume V with its tip at the origin and the corners a, b, c it is
    (V/20) [(a+b+c)(a+b+c) + aa + bb + cc].
    """
    # pyramids over the faces with their tips at the origin; negative where a face looks inwards
    volumes = mesh.heights * mesh.doubled_areas / 6.0
    total = mesh.corners.sum(axis=0)
    parts = np.einsum("iF,jF,F->ij", total, total, volumes)
    parts += np.einsum("kiF,kjF,F->ij", mesh.corners, mesh.corners, volumes)
    return np.asarray(parts / 20.0)
