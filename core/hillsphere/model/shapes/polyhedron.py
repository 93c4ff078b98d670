"""A closed mesh of triangles as the shape of a body."""

from __future__ import annotations

from functools import cached_property
from pathlib import PurePath

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.formats.mesh_files import MESH_SUFFIXES, read_mesh_file
from hillsphere.formats.plates import read_plate_files, read_shape
from hillsphere.model.shapes.dsk import read_dsk
from hillsphere.model.shapes.merging import merge_vertices
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.mesh_distance import surface_distances
from hillsphere.model.shapes.rays import RayTable
from hillsphere.model.shapes.solid_angles import solid_angles, vertex_distances
from hillsphere.model.shapes.specs import DSK_SUFFIXES, METRES, PolyhedronShapeSpec

__all__ = ["MeshSurface", "PolyhedronShape"]

_CHUNK = 100_000
"""Pairs of a point and a face that are evaluated at once: 0.8 MB for each intermediate array,
whatever the size of the mesh and the number of points."""
_FULL = 4.0 * np.pi
"""Solid angle of the whole sphere, sr."""


class MeshSurface:
    """The surface of a mesh, for contact and for rays from the origin.

    Parameters
    ----------
    mesh : Mesh
        The mesh.

    Notes
    -----
    For a star-shaped mesh, which every ray from the origin meets once, the surface function is
    |r|/R − 1 with R along the ray. The ray's face is looked up in a time that does not grow with
    the mesh. Otherwise it is the signed distance from the surface in units of the largest radius,
    negative inside (by the solid angle of all faces), whose time per point is proportional to the
    number of faces.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the half-lengths of a box about the centre along x, y, z, m."""
        x, y, z = np.abs(self.mesh.vertices).max(axis=0).tolist()
        return (x, y, z)

    @property
    def largest_radius_m(self) -> float:
        """Distance of the farthest vertex, m."""
        return self.mesh.largest_radius_m

    @property
    def steepest_per_m(self) -> float:
        """Lipschitz constant of the surface function, 1/m.

        For a star-shaped mesh the function is continuous and equal to n·r/h − 1 on the cone of each
        face, with slope 1/h. Otherwise it is a distance in units of the largest radius.
        """
        if self.mesh.is_star_shaped:
            return float(1.0 / np.min(self.mesh.heights))
        return 1.0 / self.mesh.largest_radius_m

    def surface_array(self, r: Array) -> Array:
        """Return the surface function (N,) at r (3, N), m: positive outside, negative inside."""
        mesh = self.mesh
        if mesh.is_star_shaped:
            faces = self._rays.faces(r)
            return np.asarray(
                np.sum(mesh.normals[:, faces] * r, axis=0) / mesh.heights[faces] - 1.0
            )
        near = np.sum(r * r, axis=0) <= mesh.largest_radius_m**2
        level = surface_distances(mesh, r) / mesh.largest_radius_m
        level[near] *= 1.0 - 2.0 * np.round(self._inside(r[:, near]))
        return level

    def normal_array(self, r: Array) -> Array:
        """Return the outward normals (3, N) of the outermost faces on the rays through r (3, N)."""
        return np.asarray(self.mesh.normals[:, self._met(r)])

    def radius_array(self, directions: Array) -> Array:
        """Return the largest distance (N,), m, of the surface along directions (3, N).

        The directions may have any length.

        Raises
        ------
        InputError
            If a ray misses the mesh, since the centre lies outside.
        """
        faces = self._met(directions)
        along = np.sum(self.mesh.normals[:, faces] * directions, axis=0)
        return np.asarray(
            self.mesh.heights[faces] * np.linalg.norm(directions, axis=0) / along, dtype=float
        )

    @cached_property
    def _rays(self) -> RayTable:
        return RayTable(self.mesh)

    def _met(self, directions: Array) -> Integers:
        if self.mesh.is_star_shaped:
            return self._rays.faces(directions)
        return np.array([self._outermost(d) for d in directions.T], dtype=np.int64)

    def _outermost(self, direction: Array) -> int:
        """Return the last face that a ray from the origin meets."""
        mesh = self.mesh
        a, b, c = mesh.corners
        sides = [np.cross(p, q, axis=0).T @ direction for p, q in ((a, b), (b, c), (c, a))]
        along = mesh.normals.T @ direction
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = mesh.heights / along
        met = (
            (np.sign(sides) * np.sign(along) >= 0.0).all(axis=0) & (distance > 0.0) & (along != 0.0)
        )
        if not met.any():
            raise InputError(
                "a ray from the centre of the body-fixed frame misses the mesh: the centre lies "
                "outside; shift the vertices"
            )
        return int(np.argmax(np.where(met, distance, -np.inf)))

    def _inside(self, r: Array) -> Array:
        """Return 1 inside, 0 outside, (N,)."""
        inside = np.empty(r.shape[1])
        width = max(1, _CHUNK // len(self.mesh.faces))
        for first in range(0, r.shape[1], width):
            part = r[:, first : first + width]
            angles = solid_angles(self.mesh, part, vertex_distances(self.mesh, part))
            inside[first : first + width] = angles.sum(axis=0) / _FULL
        return inside


class PolyhedronShape(MeshSurface):
    """A closed mesh of triangles.

    Parameters
    ----------
    spec : PolyhedronShapeSpec
        Its vertices and faces, or the file or the two files that hold them.

    Raises
    ------
    InputError
        If the file is malformed, or the mesh is not closed or not oriented outward (`Mesh`).

    Attributes
    ----------
    merged_vertices, collapsed_faces : int
        How many vertices were made one with others, and faces left out since two of their corners
        became one.
    """

    def __init__(self, spec: PolyhedronShapeSpec) -> None:
        unit = METRES[spec.length_unit or "km"]
        vertices, faces = _read(spec)
        source = spec.file or spec.plates_file or "vertices and faces"
        self.merged_vertices = self.collapsed_faces = 0
        try:
            if spec.merge_vertices:
                vertices, faces, self.merged_vertices, self.collapsed_faces = merge_vertices(
                    vertices, faces, spec.merge_tolerance_m / unit
                )
            super().__init__(Mesh(unit * vertices, faces))
        except InputError as error:
            raise InputError(f"{source}: {error}") from error

    def describe(self) -> tuple[str, ...]:
        """Return by what a wrong file or unit is noticed, in sentences."""
        low, high = self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)
        extent = " × ".join(f"{length / 1e3:.4g}" for length in high - low)
        volumes = self.mesh.component_volumes_m3
        sentences = [
            f"{len(self.mesh.faces)} triangles, extent {extent} km, volume "
            f"{self.mesh.volume_m3 / 1e9:.4g} km³"
        ]
        if self.merged_vertices or self.collapsed_faces:
            sentences.append(
                f"{self.merged_vertices} vertices were merged with others at the same place; "
                f"{self.collapsed_faces} faces collapsed and were left out"
            )
        if len(volumes) > 1:
            cavities = int((volumes < 0.0).sum())
            sentences.append(f"{len(volumes)} separate surfaces, {cavities} of them cavities")
        return tuple(sentences)


def _read(spec: PolyhedronShapeSpec) -> tuple[Array, Integers]:
    """Return vertices, in the unit of the source, and faces."""
    if spec.file is None:
        if spec.vertices_file is not None and spec.plates_file is not None:
            return read_plate_files(spec.vertices_file, spec.plates_file)
        vertices = np.array(spec.vertices, dtype=float).reshape(-1, 3)
        return vertices, np.array(spec.faces, dtype=np.int64).reshape(-1, 3) - 1
    suffix = PurePath(spec.file).suffix.lower()
    if suffix in DSK_SUFFIXES:
        return read_dsk(spec.file, spec.segment)
    if suffix in MESH_SUFFIXES:
        if suffix == ".stl" and not spec.merge_vertices:
            raise InputError(
                f"{spec.file}: an STL file lists the corners of each face anew, so that its faces "
                "have no edge in common; give merge_vertices = true"
            )
        return read_mesh_file(spec.file)
    return read_shape(spec.file)
