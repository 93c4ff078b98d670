"""Orbits and flights as ephemerides in inertial axes, for other programs."""
