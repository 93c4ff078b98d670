"""µ synthesis: controllers that keep performance under structured uncertainty.

`synthesis.dk_synthesis` alternates between scalings of µ's upper bound, fitted as rational
functions (`goals`, `fitting`, `multipliers`), and H∞ synthesis for the plant with the scalings in
it (`absorption`). `joint` moves both at once where alternation converges slowly,
`initial_scalings` gives the first scalings, and `reduction` lowers the controller's order.
"""
