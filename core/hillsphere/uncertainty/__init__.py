"""Uncertain quantities: their distributions, correlation, sampling, bounds and covariance."""
