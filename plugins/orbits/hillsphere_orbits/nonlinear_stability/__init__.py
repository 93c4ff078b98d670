"""Nonlinear stability: the largest offsets that a periodic orbit survives, by simulation."""
