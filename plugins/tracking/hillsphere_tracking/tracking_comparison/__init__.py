"""Comparison of trackers over the cases of a campaign of assisted tracking."""
