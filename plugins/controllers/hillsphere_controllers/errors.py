"""Named errors of synthesis and analysis."""

from __future__ import annotations

from hillsphere.errors import HillsphereError

__all__ = [
    "InfeasibleError",
    "NotStabilisableError",
    "SingularProblemError",
    "SynthesisFailedError",
]


class NotStabilisableError(HillsphereError):
    """No controller of this kind can make the closed loop stable."""


class SingularProblemError(HillsphereError):
    """The problem violates an assumption of the method, such as a weight on every control."""


class SynthesisFailedError(HillsphereError):
    """The method found no controller, or its controller failed the check of the closed loop."""


class InfeasibleError(SynthesisFailedError):
    """Nothing meets all requirements at once, as far as the method can tell."""
