"""Results of µ synthesis: the design and its iterations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hillsphere.lti import LtiSystem
from hillsphere_controllers.dk.multipliers import Multiplier
from hillsphere_controllers.dk.reduction import ReducedController
from hillsphere_controllers.mu.robustness import Robustness

__all__ = ["DkDesign", "DkIteration", "Kind"]

Kind = Literal["start", "alternate", "joint"]


@dataclass(frozen=True)
class DkIteration:
    """One iteration of µ synthesis and its certified bound.

    Parameters
    ----------
    kind : {"start", "alternate", "joint"}
        What was done.
    upper : float
        Certified bound of µ over all frequencies; infinite if the K-step found nothing.
    frequency_rad_s : float
        Where the largest bound at one frequency was found.
    gamma : float
        Norm of the scaled closed loop, itself a bound of µ without real blocks.
    orders : tuple of int
        Of D of each block, and of its G.
    controller_order : int
        States of the controller.
    accepted : bool
        Whether the bound is the lowest until then.
    seconds : float
        Wall time of the step.
    refusal : str
        Why it was not accepted; empty if it was.
    """

    kind: Kind
    upper: float
    frequency_rad_s: float
    gamma: float
    orders: tuple[int, ...]
    controller_order: int
    accepted: bool
    seconds: float
    refusal: str = ""


@dataclass(frozen=True, eq=False)
class DkDesign:
    """Result of µ synthesis: a controller with certified bounds of µ.

    Parameters
    ----------
    controller : LtiSystem
        From y to u.
    closed_loop : LtiSystem
        M.
    robustness : Robustness
        Bounds of µ over all frequencies, the upper one certified, the lower one proved by a Δ.
    multipliers : tuple of Multiplier
        D and G with which it was made.
    iterations : tuple of DkIteration
        All steps, those refused too.
    reduced : ReducedController or None
        The shortest one found with a bound within the tolerance asked for; None if all states are
        needed, or it was not asked for.
    reason : str
        Why it ended.
    interrupted : bool
        Whether it was stopped.
    """

    controller: LtiSystem
    closed_loop: LtiSystem
    robustness: Robustness
    multipliers: tuple[Multiplier, ...]
    iterations: tuple[DkIteration, ...]
    reduced: ReducedController | None
    reason: str
    interrupted: bool
