"""Planar quasi-satellite orbits: the family, its members, and where others branch off it."""
