"""Assisted tracking: whole passes with a loss of signal, as one case or as a campaign."""
