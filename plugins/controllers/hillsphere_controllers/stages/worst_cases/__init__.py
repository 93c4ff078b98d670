"""The stage ``worst_cases``: worst perturbations of a µ analysis as cases of a flight."""
