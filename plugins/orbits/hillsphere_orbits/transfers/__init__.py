"""Transfers between periodic orbits, and the tools that every kind of them needs.

Tools: `pareto` (fronts of speed change and time), `energy` (a lower bound of an impulse),
`endtoend` (transfers flown anew from their first state), `curves` (planar orbits as closed curves),
`meetings` (where trajectories meet them), `ranks` (rank correlations of the cost).

The stages `swing_transfers` and `manifold_transfers` use them.
"""
