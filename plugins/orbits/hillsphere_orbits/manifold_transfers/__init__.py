"""Transfers along invariant manifolds of periodic orbits."""
