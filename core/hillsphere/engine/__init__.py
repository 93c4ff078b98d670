"""Numerical work: propagation, gravity, the closed-loop driver."""
