r"""The posterior Cramér–Rao bound: what no filter's mean square error falls below.

With the information J of the states at one time, motion x' = f(x) + w, w ~ N(0, Q), and noise of
unit variance on the measurements, recursively [1]_

.. math::

    J' = E[H^T H] + Q^{-1} - E[Q^{-1} Φ] (J + E[Φ^T Q^{-1} Φ])^{-1} E[Φ^T Q^{-1}],

the expectations over true trajectories. Where Φ hardly differs between them (or is that of one
trajectory, the bound then being for flights near it) this is J' = E[HᵀH] + (Φ J⁻¹ Φᵀ + Q)⁻¹, which
holds for a singular Q as well: the form used here, by roots, for each trajectory or for all.

References
----------
.. [1] Tichavský, Muravchik, Nehorai (1998), Posterior Cramér–Rao bounds for discrete-time nonlinear
   filtering, IEEE Trans. Signal Processing 46(5), eq. 21.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.differences import layout_of
from hillsphere_estimators.innovations import Expected, whitened
from hillsphere_estimators.linearisation import sensitivity, transition
from hillsphere_estimators.roots import lower_root
from hillsphere_estimators.unscented import absorbed

__all__ = ["bound_after", "bound_ahead", "bound_rms"]
