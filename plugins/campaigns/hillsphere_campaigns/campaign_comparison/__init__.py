"""Campaigns on the same random numbers, compared case by case."""
