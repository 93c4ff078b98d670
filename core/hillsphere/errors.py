"""Named exceptions of the framework, all under `HillsphereError`.

The public names of `hillsphere.base.errors`.
"""

from hillsphere.base.errors import (
    ConvergenceError,
    HillsphereError,
    InputError,
    Interrupted,
    PluginError,
    PropagationError,
    StageError,
    UnknownComponentError,
    describe_error,
)

__all__ = [
    "ConvergenceError",
    "HillsphereError",
    "InputError",
    "Interrupted",
    "PluginError",
    "PropagationError",
    "StageError",
    "UnknownComponentError",
    "describe_error",
]
