"""Transfers flown again on truer equations, with their impulses found anew."""
