"""Transfers between periodic orbits, and the tools common to all kinds.

Tools: `pareto` (fronts of speed change and time), `energy` (a lower bound of an impulse),
`endtoend` (verification by propagation), `curves` (planar orbits as closed curves),
`meetings` (where trajectories meet them), `ranks` (rank correlations of the cost).

The stages `swing_transfers` and `manifold_transfers` use them.
"""
