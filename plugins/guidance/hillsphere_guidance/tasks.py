"""Check of a guidance task."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import GuidanceTask
from hillsphere_guidance.motion import Motion

__all__ = ["check_task"]


def check_task(motion: Motion, task: GuidanceTask) -> None:
    """Check that a task fits a plant.

    Parameters
    ----------
    motion : Motion
        Motion of the plant.
    task : GuidanceTask
        Start, end and duration.

    Raises
    ------
    InputError
        If numbers are missing or not finite, or the plant is not suitable for guidance.
    """
    n, d = len(motion.states), motion.axes
    for name, values, count in (
        ("start", task.start, n),
        ("end_position_m", task.end_position_m, d),
        ("end_velocity_m_s", task.end_velocity_m_s, d),
    ):
        if np.shape(values) != (count,) or not np.isfinite(values).all():
            raise InputError(f"{name}: {count} finite numbers are needed, got {values}")
    if not 0.0 < task.duration_s < np.inf:
        raise InputError(f"duration_s must be positive, got {task.duration_s}")
    motion.check(task.start, task.time_s)
