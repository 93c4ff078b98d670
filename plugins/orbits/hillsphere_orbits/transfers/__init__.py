"""Transfers between periodic orbits, and the tools that every kind of them needs.

Tools: `pareto` (fronts of speed change and time), `energy` (a lower bound of an impulse),
`endtoend` (transfers flown anew from their first state), `curves` (planar orbits as closed curves),
`meetings` (where trajectories meet them), `ranks` (rank correlations of the cost).

Transfers in the plane through families of swing orbits: `swing_stage`, on the search in
`swing_chains` (families and what their orbits meet), `swing_touch` (members that just touch an
orbit), `swing_search` (minima along families) and `swing_zoom` (the same, exactly).
"""
