"""Transfers in the plane by way of families of swing orbits."""
