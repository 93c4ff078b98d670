"""Names of the routes to a minimum: how a search of a structured synthesis begins."""

from __future__ import annotations

__all__ = ["BOUNDED", "FULL_ORDER", "LARGER", "RESTARTS", "ROUTES", "SMALLER", "STARTS"]

STARTS = "starts"
"""Random parameters, the middle of the typical ones, the controller of full order reduced without a
path, and those that were given."""
FULL_ORDER = "homotopy from full order"
"""A path from the controller of full order."""
LARGER = "homotopy from a larger structure"
"""A path from a controller of the next order, or without the pattern of this one."""
SMALLER = "from the order below"
"""The controller of the order below with a decoupled stable state."""
BOUNDED = "release of a gain bound"
"""Random parameters under a bound of the gain that is released in steps."""
RESTARTS = "restarts near the best"
"""The best parameters so far, changed at random: no route of its own."""
ROUTES = (STARTS, FULL_ORDER, LARGER, SMALLER, BOUNDED, RESTARTS)
"""All, in the order of a verdict."""
