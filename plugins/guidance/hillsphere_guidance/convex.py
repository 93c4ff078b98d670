"""A powered descent under held commands with bounds, a glide slope and an upright touchdown."""

from __future__ import annotations

from hillsphere.interfaces import GuidanceTask, GuidedFlight, Plant
from hillsphere_guidance.motion import motion_of
from hillsphere_guidance.requirements import Requirements
from hillsphere_guidance.specs import ConvexSpec
from hillsphere_guidance.successive_convex import fly_successively
from hillsphere_guidance.tasks import check_task

__all__ = ["ConvexDescent"]


class ConvexDescent:
    """Flight of least cost that meets constraints, by successive convex programming.

    The commands are held over equal times. Their size and the last direction are bounded; at the
    times where the command changes, the path stays above the surface and in a cone over the landing
    site. A lower bound of the command is not convex: in each round it is replaced by the half-space
    beyond it in the direction of the last command, which lies inside the allowed set [1]_ [2]_.

    Parameters
    ----------
    spec : ConvexSpec
        The constraints.

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
            Start, end and duration.

        Returns
        -------
        GuidedFlight
            The flight and its command.

        Raises
        ------
        InputError
            If the plant or the task is not suitable, or a constraint needs a landing site.
        InfeasibleGuidanceError
            If the constraints cannot be met together; the message states the violations that
            remain.
        ConvergenceError
            If the search does not converge.
        """
        check_task(motion_of(plant), task)
        return fly_successively(plant, task, self.requirements)
