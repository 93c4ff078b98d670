"""Shapes of bodies as ellipsoid, spherical harmonics, grid of radii, or polyhedron."""
