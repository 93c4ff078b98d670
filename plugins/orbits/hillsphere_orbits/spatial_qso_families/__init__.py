"""Orbits of several revolutions that leave the plane: families, members, stability."""
