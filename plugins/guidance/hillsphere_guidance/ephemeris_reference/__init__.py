"""Trajectories of an ephemeris file as references that a closed loop follows."""
