"""Campaigns side by side, beside published values."""
