"""Gravity of a homogeneous body of any shape as a series, outside a sphere about it."""

from __future__ import annotations

import logging

import numpy as np

from hillsphere.formats.coefficients import CoefficientTable
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array
from hillsphere_gravity.harmonics import Harmonics, check_cost, compile_time, in_words
from hillsphere_gravity.mesh_body import MeshBody
from hillsphere_gravity.mesh_harmonics import HIGHEST_DEGREE, MeshSeries, mesh_series
from hillsphere_gravity.polyhedron import Polyhedron, mesh_of
from hillsphere_gravity.specs import PolyhedronSpec, ShapeHarmonicsSpec

__all__ = ["ShapeHarmonics"]

_FROM_RADII = 1.5
"""Distance, in radii of the body, from which the series holds where none is given. Degree 8, the
default, leaves a bound of 1.5e-3 there for an ellipsoid like Phobos with bumps, and 20 degrees are
needed for 2e-6; nearer the bound falls so slowly with the degree that a series is of no use."""


class ShapeHarmonics(MeshBody, Harmonics):
    """The series of a homogeneous body of any shape, cut at a stated error.

    The coefficients are exact integrals over the polyhedron (`mesh_coefficients`), and the degree
    follows from a bound of what is left out (`mesh_series`) up to the largest that is allowed; an
    error beyond the tolerance is logged as a warning. Being an expression, the series is
    compiled with its variations and flies as fast as any other; the polyhedron itself is evaluated
    face by face at each stage of each step.

    Parameters
    ----------
    spec : ShapeHarmonicsSpec
        Its shape and mass. Run-time parameters as of `Harmonics`.

    Raises
    ------
    InputError
        If the shape is no polyhedron and is not to be triangulated, its size or density is that of
        no body, or the series is to hold from inside the body.
    """

    def __init__(self, spec: ShapeHarmonicsSpec) -> None:
        mesh = mesh_of(spec.shape.get(), spec.subdivisions)
        MeshBody.__init__(
            self, mesh, spec.density_kg_m3, spec.gm_m3_s2, spec.gravitational_constant
        )
        start = spec.series_from_m
        self.holds_from_m = _FROM_RADII * mesh.largest_radius_m if start is None else start
        series = mesh_series(mesh, self.holds_from_m, spec.tolerance, spec.max_degree)
        self.error_bound = series.bound
        check_cost("the series of the shape", series.degree, asked=True)
        if series.bound > spec.tolerance:
            _warn(series, spec.tolerance)
        table = CoefficientTable(
            name="",
            gm_m3_s2=self.gm_m3_s2,
            reference_radius_m=series.radius_m,
            max_degree=series.degree,
            normalisation="full",
            tide_system="none",
            rows=series.rows,
        )
        self._take(table, series.degree, series.degree, series.degree)

    @property
    def series_radius_m(self) -> float:
        """Distance from which the error is bounded, m; the series converges from less on."""
        return self.holds_from_m

    def describe(self) -> tuple[str, ...]:
        """Return mass, degree and error in words."""
        return (
            *MeshBody.describe(self),
            f"series of degree {self.degree}; from {self.holds_from_m / 1e3:.5g} km on its "
            f"acceleration errs by at most {self.error_bound:.1e} of GM/r²",
        )

    def acceleration_error(self, r: Array) -> Array:
        """Return the relative error of the acceleration, against the polyhedron itself.

        Parameters
        ----------
        r : ndarray, shape (3, N)
            Body-fixed positions, m.

        Returns
        -------
        ndarray, shape (N,)
            Difference of both accelerations, relative to that of the polyhedron.
        """
        # made anew: compiled code would have to be carried along wherever the model goes
        spec = PolyhedronSpec.model_validate({"shape": self, "gm_m3_s2": self.gm_m3_s2})
        exact = GravityField(Polyhedron(spec)).acceleration(r)
        difference = GravityField(self).acceleration(r) - exact
        return np.asarray(np.linalg.norm(difference, axis=0) / np.linalg.norm(exact, axis=0))


def _warn(series: MeshSeries, tolerance: float) -> None:
    """Tell the error of a series that is cut before it meets the tolerance, and what would help."""
    more = (
        f"a smaller error than that of degree {HIGHEST_DEGREE}"
        if series.enough is None
        else f"max_degree = {series.enough}, which compiles for about "
        f"{in_words(compile_time(series.enough))} in a family of orbits"
    )
    logging.getLogger("hillsphere").warning(
        f"the series of the shape ends at degree {series.degree}: its acceleration errs by up to "
        f"{series.bound:.1e} of GM/r² at {series.from_m / 1e3:.5g} km, less farther out; the "
        f"tolerance of {tolerance:.1e} needs {more}; a larger series_from needs fewer degrees"
    )
