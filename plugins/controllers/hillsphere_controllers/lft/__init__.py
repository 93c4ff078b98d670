"""Uncertain systems as linear fractional transformations of a fixed system and what is unknown."""
