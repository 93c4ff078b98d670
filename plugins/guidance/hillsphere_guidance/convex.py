"""A descent under held commands that keeps bounds, a glide slope and an upright touchdown."""

from __future__ import annotations

from hillsphere.interfaces import GuidanceTask, GuidedFlight, Plant
from hillsphere_guidance.motion import motion_of
from hillsphere_guidance.requirements import Requirements
from hillsphere_guidance.specs import ConvexSpec
from hillsphere_guidance.successive_convex import fly_successively
from hillsphere_guidance.tasks import check_task

__all__ = ["ConvexDescent"]


class ConvexDescent:
    """Flight of least cost that meets requirements, by successive convex programming.

    Of the commands, held over equal times, size and last direction are bounded; the path keeps
    above the surface and a cone over the landing site (at the times where the command changes).
    A lower bound of the command is no convex condition: in each round it is replaced by the
    half-space beyond it in the direction of the last command, which lies within it [1]_ [2]_.

    Parameters
    ----------
    spec : ConvexSpec
        The requirements.

    References
    ----------
    .. [1] B. Açıkmeşe, S. R. Ploen (2007), Convex programming approach to powered descent guidance
       for Mars landing, Journal of Guidance, Control, and Dynamics 30(5), 1353-1366.
    .. [2] Y. Mao, M. Szmuk, B. Açıkmeşe (2016), Successive convexification of non-convex optimal
       control problems and its convergence properties, 55th IEEE Conference on Decision and
       Control, 3636-3641.
    """

    def __init__(self, spec: ConvexSpec) -> None:
        self.requirements = Requirements(
            spec.objective,
            spec.hold_s,
            spec.minimum_m_s2,
            spec.maximum_m_s2,
            spec.glide_slope_rad,
            spec.glide_slope_time_s,
            spec.touchdown_tilt_rad,
        )

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
            If the plant or the task cannot be taken, or a requirement needs a landing site.
        InfeasibleGuidanceError
            If the requirements cannot be met together; the message says what is left.
        ConvergenceError
            If the search does not end.
        """
        check_task(motion_of(plant), task)
        return fly_successively(plant, task, self.requirements)
