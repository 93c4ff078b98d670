"""The fidelity ladder: orbits of simple equations carried over to truer ones."""
