"""Linear time-invariant systems in state space.

The public names of `hillsphere.base.lti`.
"""

from hillsphere.base.lti import (
    LtiSystem,
    indices_of,
    real_matrix,
)

__all__ = [
    "LtiSystem",
    "indices_of",
    "real_matrix",
]
