"""Order reduction of controllers by balanced truncation, with certified µ."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import certified_peak
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.truncation import balanced_truncation

__all__ = ["ReducedController", "reduced_controller"]


@dataclass(frozen=True)
class ReducedController:
    """A controller of lower order.

    Parameters
    ----------
    controller : LtiSystem
        Balanced.
    upper : float
        Certified bound of µ of the loop with it.
    """

    controller: LtiSystem
    upper: float


def reduced_controller(
    plant: LtiSystem,
    controller: LtiSystem,
    structure: BlockStructure,
    limit: float,
    *,
    gap: float = 0.01,
) -> ReducedController | None:
    """Return the controller of the lowest order found that keeps µ below a limit.

    The order is found by bisection, which assumes that µ grows as the order falls.

    Parameters
    ----------
    plant : LtiSystem
        Generalised plant whose closed loop Δ closes.
    controller : LtiSystem
        To be reduced.
    structure : BlockStructure
        Of Δ.
    limit : float
        Of µ's certified bound.
    gap : float
        As of `certified_peak`.

    Returns
    -------
    ReducedController or None
        None if not one state can be spared.
    """
    best: ReducedController | None = None
    low, high = 0, controller.order
    while high > low:
        order = (low + high) // 2
        verified = _verify_reduced(
            plant, balanced_truncation(controller, order), structure, limit, gap
        )
        if verified is None:
            low = order + 1
        else:
            # unstable states stay, so that there may be more than were asked for
            best, high = verified, order
    return best if best is not None and best.controller.order < controller.order else None


def _verify_reduced(
    plant: LtiSystem, controller: LtiSystem, structure: BlockStructure, limit: float, gap: float
) -> ReducedController | None:
    try:
        loop = lower_lft(plant, controller)
        if not loop.is_stable:
            return None
        upper = certified_peak(loop, structure, gap=gap).upper
    except InputError:
        return None
    return ReducedController(controller, upper) if upper <= limit else None
