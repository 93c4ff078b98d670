"""Solid angles of the faces of a mesh as seen from points."""

from __future__ import annotations

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.model.shapes.mesh import Mesh

__all__ = ["solid_angles", "vertex_distances"]


def vertex_distances(mesh: Mesh, r: Array) -> Array:
    """Return the distances (V, N), m, of the vertices from points r (3, N), m."""
    x, y, z = mesh.vertices.T[:, :, None] - r[:, None, :]
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def solid_angles(mesh: Mesh, r: Array, distances: Array) -> Array:
    r"""Return the signed solid angles of all faces [1]_.

    .. math::

        \tan\frac\omega2 = \frac{r_1\cdot(r_2\times r_3)}
        {r_1r_2r_3 + r_1\,r_2\cdot r_3 + r_2\,r_3\cdot r_1 + r_3\,r_1\cdot r_2}

    with the corners r₁, r₂, r₃ relative to the point. The numerator is twice the area of the face
    times the height of its plane above the point; the scalar products follow from the sides.

    Parameters
    ----------
    mesh : Mesh
        F faces.
    r : ndarray, shape (3, N)
        Points, m.
    distances : ndarray, shape (V, N)
        Result of `vertex_distances`, m.

    Returns
    -------
    ndarray, shape (F, N)
        Solid angles, sr, positive for a face seen from behind; their sum is 4π at points inside and
        0 outside.

    References
    ----------
    .. [1] A. van Oosterom, J. Strackee (1983), The solid angle of a plane triangle, IEEE
       Transactions on Biomedical Engineering BME-30(2), 125-126.
    """
    d1, d2, d3 = (distances[i] for i in mesh.faces.T)
    over = mesh.heights[:, None] - mesh.normals.T @ r
    a, b, c = mesh.corners
    q1, q2, q3 = (np.sum(s * s, axis=0)[:, None] for s in (c - b, a - c, b - a))
    # Twice the denominator, with 2 r_i·r_j = r_i² + r_j² − |r_i − r_j|².
    s1, s2, s3 = d1 * d1, d2 * d2, d3 * d3
    doubled = 2.0 * d1 * d2 * d3 + d1 * (s2 + s3 - q1) + d2 * (s3 + s1 - q2) + d3 * (s1 + s2 - q3)
    return np.asarray(2.0 * np.arctan2(2.0 * mesh.doubled_areas[:, None] * over, doubled))
