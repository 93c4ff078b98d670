"""Passes of satellites over stations."""
