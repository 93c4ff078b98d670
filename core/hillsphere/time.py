"""Epochs in a named time scale, as two-part Julian dates, which resolve nanoseconds.

The public names of `hillsphere.base.time`.
"""

from hillsphere.base.time import (
    J2000,
    SCALES,
    Epoch,
)

__all__ = [
    "J2000",
    "SCALES",
    "Epoch",
]
