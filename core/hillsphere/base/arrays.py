"""Names for the types of arrays that the framework passes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Integers"]

Array: TypeAlias = NDArray[np.float64]
"""Array of double-precision numbers, of any shape."""

Integers: TypeAlias = NDArray[np.int64]
"""Array of 64-bit integers, of any shape."""
