"""Minimum-fuel flight between two states, ∫|a|dt, under held commands."""

from __future__ import annotations

from hillsphere.interfaces import GuidanceTask, GuidedFlight, Plant
from hillsphere_guidance.motion import motion_of
from hillsphere_guidance.requirements import Requirements
from hillsphere_guidance.specs import MinimumFuelSpec
from hillsphere_guidance.successive_convex import fly_successively
from hillsphere_guidance.tasks import check_task

__all__ = ["MinimumFuel"]


class MinimumFuel:
    r"""Flight of the least :math:`\int |a|\,dt` between given states.

    The command is held over equal times, with or without a bound. The flight stays above the
    surface of the body, if it has one, at the times where the command changes. The sum of
    :math:`h_k |a_k|` is minimised by second-order cone programming about the last flight, see
    `hillsphere_guidance.successive_convex`; burns and coasts result from that. Without a bound the
    burns tend to impulses, which last one hold.

    Parameters
    ----------
    spec : MinimumFuelSpec
        Length of a hold, bound.
    """

    def __init__(self, spec: MinimumFuelSpec) -> None:
        self.requirements = Requirements("fuel", spec.hold_s, maximum_m_s2=spec.maximum_m_s2)

    def plan(self, plant: Plant, task: GuidanceTask) -> GuidedFlight:
        """Plan a flight.

        Parameters
        ----------
        plant : Plant
            Equations of motion.
        task : GuidanceTask
            From where to where, in which time.

        Returns
        -------
        GuidedFlight
            The flight and its command.

        Raises
        ------
        InputError
            If the plant or the task cannot be taken.
        InfeasibleGuidanceError
            If the bound or the time does not allow it.
        ConvergenceError
            If the search does not end.
        """
        check_task(motion_of(plant), task)
        return fly_successively(plant, task, self.requirements)
