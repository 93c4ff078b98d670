"""Epochs in a named time scale, kept in two parts so that nanoseconds survive.

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
