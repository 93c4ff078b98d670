"""Readers of file formats: spherical-harmonic coefficients and triangle meshes."""
