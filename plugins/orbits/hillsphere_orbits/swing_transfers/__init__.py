"""Transfers in the plane through families of swing orbits."""
