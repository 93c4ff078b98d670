"""Transfers flown again on higher-fidelity equations, with their impulses found anew."""
