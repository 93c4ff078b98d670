"""File formats: readers of spherical-harmonic coefficients and of triangle meshes."""
