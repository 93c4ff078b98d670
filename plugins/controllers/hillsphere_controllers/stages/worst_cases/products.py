"""Product of the stage ``worst_cases``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array, Integers
from hillsphere.products import CaseList
from hillsphere.products.fields import Label, Shape

__all__ = ["WorstCases"]


@dataclass(frozen=True, kw_only=True)
class WorstCases(CaseList):
    """Points of a sweep, and where each is from."""

    controller: Annotated[tuple[str, ...], Shape("cases")]
    """Name of the controller of each case."""
    model: Annotated[tuple[str, ...], Shape("cases")]
    """Name of its uncertain model."""
    analysis: Annotated[tuple[str, ...], Shape("cases")]
    """Which analysis found it."""
    channel: Annotated[tuple[str, ...], Shape("cases")]
    """Outputs of which it is the worst case; empty where all outputs count together."""
    mu: Annotated[Array, Shape("cases"), Label("lower bound of µ or gain", 4)]
    """Lower bound of µ (or of the gain) that the worst perturbation reaches."""
    frequency_rad_s: Annotated[Array, Shape("cases"), Label("at", 4)]
    """Frequency at which the worst perturbation reaches the bound."""
    remaining: Annotated[Array, Shape("cases")]
    """Where the parameters stand that the uncertain model leaves out, in standard deviations."""
    sigmas: Annotated[Array, Shape("cases")]
    """How many standard deviations the farthest parameter of the worst case is from nominal."""
    moved: Annotated[Integers, Shape("cases"), Label("parameters that it moves")]
    """How many of what the worst case is made of the flight sets away from nominal."""
    unmoved: tuple[str, ...]
    """Analyses without a case, since their worst perturbation moves nothing that the flight
    sets."""
