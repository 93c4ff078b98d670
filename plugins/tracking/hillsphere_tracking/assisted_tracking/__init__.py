"""Assisted tracking: passes with a loss of signal, as a single case or as a campaign."""
