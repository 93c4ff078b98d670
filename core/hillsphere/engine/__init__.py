"""Numerical engine: propagation, gravity fields, closed-loop simulation, start states."""
