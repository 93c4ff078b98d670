"""Forecast of how long a family takes whose gravity is evaluated point by point."""

from __future__ import annotations

import logging
from time import process_time

import numpy as np

from hillsphere.interfaces import ArrayConserved, Plant

__all__ = ["warn_of_slow_gravity"]

_EVALUATIONS = 1_100_000
"""Points at which the gravity of a family is evaluated, acceleration and gradient together: 404 000
were counted in the first pass from 80 km to the surface of an ellipsoid like Phobos, and 38 000 for
each orbit at the beginning of the second, which has about 19. A rough value: other bodies need
other steps, and the check of drift comes on top."""
_AROUND_S = 60e-6
"""Time of the integrator for each, beside the gravity: 24 s for the first pass."""
_REPEATS = 3
"""Evaluations that are timed: the least time is that without the first one's preparation."""
_FAR = 2.0  # units of length: outside any body that has quasi-satellite orbits
_TOLD_FROM_S = 60.0
"""Forecast from which it is told: a minute without any sign seems to be a fault."""


def warn_of_slow_gravity(plant: Plant) -> None:
    """Tell before it begins that a family takes minutes, and what would be faster.

    Parameters
    ----------
    plant : Plant
        Its equations of motion; nothing is told of those that are compiled as a whole.
    """
    if not isinstance(plant, ArrayConserved):
        return
    one = _evaluation_time(plant, plant.scales.length_m)
    whole = _EVALUATIONS * (one + _AROUND_S)
    if whole < _TOLD_FROM_S:
        return
    logging.getLogger("hillsphere").warning(
        f"the gravity is no series but is evaluated point by point, {1e6 * one:.3g} µs each: a "
        f"family of quasi-satellite orbits takes about {whole / 60.0:.0f} min of CPU time. Faster "
        "are gravity of type 'shape_harmonics' (outside a sphere about the body, with a stated "
        "error), a shape of fewer faces, or type 'ellipsoid'"
    )


def _evaluation_time(plant: ArrayConserved, length_m: float) -> float:
    """Return the time, s, of one evaluation of the potential, measured once."""
    times = []
    for k in range(_REPEATS):
        # at different places, as the sums of the last ones are kept
        state = np.array([[_FAR + 0.1 * k, 0.1, 0.1, 0.0, 0.0, 0.0]]).T * length_m
        begin = process_time()
        plant.integral_array(state)
        times.append(process_time() - begin)
    return min(times)
