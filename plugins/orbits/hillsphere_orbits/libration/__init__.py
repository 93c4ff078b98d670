"""Orbits about the libration points L1 and L2 of a secondary body: Lyapunov and halo families."""
