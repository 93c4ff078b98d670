"""Strategies of assisted tracking compared over the cases of a campaign."""
