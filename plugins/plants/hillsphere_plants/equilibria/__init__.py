"""Equilibrium points: of motion about a moon, and of a body that turns uniformly."""
