"""What the stage ``worst_cases`` yields."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array
from hillsphere.products import CaseList

__all__ = ["WorstCases"]


@dataclass(frozen=True, kw_only=True)
class WorstCases(CaseList):
    """Points of a sweep, and where each is from.

    Parameters
    ----------
    controller, model, analysis : tuple of str
        Of each of the N points.
    mu : ndarray, shape (N,)
        Lower bound of µ (or of the gain) that the worst perturbation reaches.
    frequency_rad_s : ndarray, shape (N,)
        Where.
    remaining : ndarray, shape (N,)
        Where the parameters stand that the uncertain model leaves out, in standard deviations.
    sigmas : ndarray, shape (N,)
        How many standard deviations the farthest parameter of the worst case is from nominal.
    """

    controller: tuple[str, ...]
    model: tuple[str, ...]
    analysis: tuple[str, ...]
    mu: Array
    frequency_rad_s: Array
    remaining: Array
    sigmas: Array
