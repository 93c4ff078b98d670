"""Shapes of bodies, for contact and for landing sites: ellipsoid, harmonics, grid, polyhedron."""
