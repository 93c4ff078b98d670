"""Invariant manifolds of unstable periodic orbits: sampling, flight with events, the stage."""
