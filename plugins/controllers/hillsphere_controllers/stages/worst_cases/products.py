"""Product of the stage ``worst_cases``."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array, Integers
from hillsphere.products import CaseList

__all__ = ["WorstCases"]


@dataclass(frozen=True, kw_only=True)
class WorstCases(CaseList):
    """Points of a sweep, and where each is from.

    Parameters
    ----------
    controller, model, analysis, channel : tuple of str
        Of each of the N points; the channel is empty where all outputs count together.
    mu : ndarray, shape (N,)
        Lower bound of µ (or of the gain) that the worst perturbation reaches.
    frequency_rad_s : ndarray, shape (N,)
        Where.
    remaining : ndarray, shape (N,)
        Where the parameters stand that the uncertain model leaves out, in standard deviations.
    sigmas : ndarray, shape (N,)
        How many standard deviations the farthest parameter of the worst case is from nominal.
    moved : ndarray of int, shape (N,)
        How many of what the worst case is made of the flight sets away from nominal.
    unmoved : tuple of str
        Analyses without a case, since their worst perturbation moves nothing that the flight sets.
    """

    controller: tuple[str, ...]
    model: tuple[str, ...]
    analysis: tuple[str, ...]
    channel: tuple[str, ...]
    mu: Array
    frequency_rad_s: Array
    remaining: Array
    sigmas: Array
    moved: Integers
    unmoved: tuple[str, ...]
