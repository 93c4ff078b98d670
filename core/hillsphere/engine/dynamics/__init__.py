"""Compilation and propagation of equations of motion: Taylor series, Runge–Kutta, events."""
