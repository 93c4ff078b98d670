"""Uncertain systems as linear fractional transformations (LFTs) of a fixed system and Δ."""
