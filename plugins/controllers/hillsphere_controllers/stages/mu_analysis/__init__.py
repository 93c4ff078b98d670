"""The stage ``mu_analysis``: robustness of loops by µ, certified over frequency."""
