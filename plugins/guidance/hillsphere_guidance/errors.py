"""Named exceptions of guidance."""

from __future__ import annotations

from hillsphere.errors import ConvergenceError

__all__ = ["InfeasibleGuidanceError"]


class InfeasibleGuidanceError(ConvergenceError):
    """No flight was found that meets all requirements; the message says by how much it fails."""
