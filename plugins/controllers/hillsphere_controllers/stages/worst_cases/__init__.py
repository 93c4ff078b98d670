"""The stage ``worst_cases``: what an analysis by µ has found, as cases of a flight."""
