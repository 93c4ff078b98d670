"""Generalised plants with some of their signals only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere_controllers.stages.signals import find_signals

__all__ = ["restrict_channels"]


def restrict_channels(
    plant: LtiSystem,
    outputs: Sequence[str],
    inputs: Sequence[str],
    controls: int,
    measurements: int,
    *,
    uncertain: int = 0,
) -> LtiSystem:
    """Return a generalised plant with those outputs and inputs only, and the controller's.

    Parameters
    ----------
    plant : LtiSystem
        Its last inputs are the controls, its last outputs the measurements.
    outputs, inputs : sequence of str
        Names; none: all.
    controls, measurements : int
        Their numbers.
    uncertain : int
        So many of its first outputs and inputs stay, as those of Δ.

    Raises
    ------
    InputError
        If there is no such signal.
    """
    p, m = plant.shape[0] - measurements, plant.shape[1] - controls
    rows, columns = list(range(uncertain, p)), list(range(uncertain, m))
    if outputs:
        rows = [uncertain + i for i in find_signals(plant.outputs[uncertain:p], outputs, "outputs")]
    if inputs:
        columns = [uncertain + j for j in find_signals(plant.inputs[uncertain:m], inputs, "inputs")]
    rows = [*range(uncertain), *rows, *range(p, p + measurements)]
    columns = [*range(uncertain), *columns, *range(m, m + controls)]
    return replace(
        plant, b=plant.b[:, columns], c=plant.c[rows], d=plant.d[np.ix_(rows, columns)],
        inputs=tuple(plant.inputs[j] for j in columns) if plant.inputs else (),
        outputs=tuple(plant.outputs[i] for i in rows) if plant.outputs else (),
    )  # fmt: skip
