"""The stage ``mu_analysis``: what a loop bears of its uncertainty, certified over frequency."""
