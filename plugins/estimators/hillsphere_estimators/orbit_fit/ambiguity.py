"""Whole multiples of an ambiguous range, from the prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere_estimators.fixed_steps import FixedStepModel
from hillsphere_estimators.orbit_fit.records import Arc, Record
from hillsphere_estimators.orbit_fit.residuals import linearise_arc

__all__ = ["resolve_ranges"]

_CERTAIN_SIGMAS = 3.0
"""Standard deviations of the predicted range that must be less than half the modulus."""


def resolve_ranges(
    model: FixedStepModel,
    prior: Belief,
    records: Sequence[Record],
    arc: Arc,
    has_prior: bool,
) -> tuple[tuple[Record, ...], tuple[str, ...]]:
    """Add to ambiguous ranges the whole multiple that brings them nearest to the prior's.

    Parameters
    ----------
    model : FixedStepModel
        Motion and measurements.
    prior : Belief
        N = 1.
    records : sequence of Record
        Some with a modulus.
    arc : Arc
        The same.
    has_prior : bool
        Whether the prior says something.

    Returns
    -------
    records : tuple of Record
        With the ranges.
    doubts : tuple of str
        Where the prior is too wide to tell the multiple.

    Raises
    ------
    InputError
        If there is no prior.
    """
    if not has_prior:
        raise InputError(
            "position_sigma: ranges are ambiguous (RANGE_MODULUS), and only a prior tells the "
            "whole multiples; give position_sigma and velocity_sigma"
        )
    residual, rows = linearise_arc(model, prior, prior, arc.sets)
    spread = np.linalg.norm(rows, axis=1)
    resolved, doubts = list(records), []
    for k, record in enumerate(records):
        modulus = record.observable.modulus_m
        if not modulus:
            continue
        own = arc.record == k
        number, sigma = arc.number[own], arc.sigma[own]
        values = record.values.copy()
        values[0, number, 0] -= modulus * np.rint(residual[own] * sigma / modulus)
        resolved[k] = replace(record, values=values)
        worst = float(np.max(_CERTAIN_SIGMAS * spread[own] * sigma))
        if worst > 0.5 * modulus:
            doubts.append(
                f"the prior is too wide for the ambiguity of {record.observable.label}: three "
                f"standard deviations of the range are {worst:.4g} m, half the modulus is "
                f"{0.5 * modulus:.4g} m"
            )
    return tuple(resolved), tuple(doubts)
