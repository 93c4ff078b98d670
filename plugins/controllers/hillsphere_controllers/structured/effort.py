"""Effort of a structured synthesis: how many searches follow the starts by other routes."""

from __future__ import annotations

from numbers import Real
from typing import Literal

from hillsphere.errors import InputError

__all__ = ["EFFORTS", "Effort", "effort_number"]

Effort = Literal["quick", "normal", "thorough"] | float
"""A word, or the number of searches by other routes in units of the starts."""
EFFORTS = {"quick": 0.0, "normal": 1.0, "thorough": 5.0}
"""None; as many as starts, which takes two to three times as long in all; and five times as many,
with four times as many random starts besides."""
_LARGEST = 100.0
"""Beyond this a number is a mistake: so many searches take days for a small plant."""


def effort_number(effort: Effort) -> float:
    """Return the effort as a number.

    Parameters
    ----------
    effort : {"quick", "normal", "thorough"} or float
        A word, or a number from 0 to 100.

    Returns
    -------
    float
        Searches by other routes in units of the starts.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(effort, str):
        if effort in EFFORTS:
            return EFFORTS[effort]
    elif isinstance(effort, Real) and not isinstance(effort, bool) and 0.0 <= effort <= _LARGEST:
        return float(effort)
    raise InputError(
        f"effort must be 'quick', 'normal', 'thorough' or a number from 0 to {_LARGEST:g}, got "
        f"{effort!r}"
    )
