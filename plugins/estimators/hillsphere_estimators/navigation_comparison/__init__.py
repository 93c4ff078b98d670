"""Flights under navigation compared with each other."""
