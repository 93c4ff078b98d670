"""A law without commands, for flights under the reference's feedforward command alone."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_guidance.law_specs import OpenLoopSpec

__all__ = ["OpenLoop"]


class OpenLoop:
    """No feedback: the command is the feedforward of the reference, and errors are not corrected.

    Parameters
    ----------
    spec : OpenLoopSpec
        Period, number of controls.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def __init__(self, spec: OpenLoopSpec) -> None:
        self.period_s, self._controls = spec.period_s, spec.controls

    def initial(self, n_cases: int) -> Array:
        """Return no states, shape (0, N)."""
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return zero (p, N), m/s²."""
        return np.zeros((self._controls, y.shape[1])), xc
