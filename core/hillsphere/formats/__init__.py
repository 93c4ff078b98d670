"""File formats: spherical-harmonic coefficients, triangle meshes, orbit ephemeris messages."""
