"""Δv of the commands of a law, without random accelerations."""

from __future__ import annotations

from math import ceil

import numpy as np

from hillsphere.interfaces import Array, Plant
from hillsphere.simulation import ContinuousLaw
from hillsphere_estimators.plant_flow import PlantFlow

__all__ = ["law_delta_v"]


def law_delta_v(
    plant: Plant,
    law: ContinuousLaw | None,
    method: str,
    step_s: float,
    times_s: Array,
    estimate: Array,
    goal: Array,
    thrust: Array,
) -> Array:
    """Return the Δv of each flight's commands.

    The simulator's Δv counts all accelerations, random ones included. Between two samples the law
    knows only the estimate at the first of them, so that its commands can be computed again from
    the estimates.

    Parameters
    ----------
    plant : Plant
        The plant in the law's model.
    law : ContinuousLaw, optional
        Its commands; without a law Δv is zero.
    method, step_s
        Formula, and longest step, s.
    times_s : ndarray, shape (K,)
        Times of the samples, s.
    estimate : ndarray, shape (n, K, N)
        Estimates that the law was given; NaN after a flight was lost.
    goal : ndarray, shape (n, K)
        Reference.
    thrust : ndarray, shape (N,)
        Thrust as a part of the command.

    Returns
    -------
    ndarray, shape (N,)
        Sum over the spacecraft until the last sample, m/s; NaN if the flight was lost.
    """
    cases = estimate.shape[2]
    if law is None:
        return np.zeros(cases)
    flow, p = PlantFlow(plant, law, method), len(plant.controls)
    gain = np.eye(p)[:, :, None] * thrust
    total = np.zeros(cases)
    for k in range(len(times_s) - 1):
        aim = np.repeat(goal[:, k : k + 1], cases, axis=1)
        lost = ~np.isfinite(estimate[:, k]).all(axis=0)
        seen = np.where(lost, aim, estimate[:, k])
        held = [aim, seen] if law.measurement == "held" else [aim]
        y = np.concatenate([seen, law.initial(cases), np.zeros((1, cases))])
        told = np.concatenate([np.zeros((p, cases)), gain.reshape(p * p, cases), *held])
        duration = np.full(cases, times_s[k + 1] - times_s[k])
        steps = max(1, ceil(float(duration[0]) / step_s - 1e-9))
        end = flow.steps.propagate(y, duration, steps, told, np.full(cases, times_s[k]))
        # the last state of the closed loop is its Δv
        total += np.where(lost, np.nan, end[-1])
    return total
