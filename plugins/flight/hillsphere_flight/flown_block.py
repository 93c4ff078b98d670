"""A block of flights with everything from which their metrics and histories are computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.course import Rows
from hillsphere.engine.simulation.flow import thrust_vectors
from hillsphere.simulation import Flights
from hillsphere_flight.largest import SAME_TIME, Largest

__all__ = ["FlownBlock", "append_end", "fill_rows"]


@dataclass(frozen=True, eq=False)
class FlownBlock:
    r"""N flights, and what they were to reach.

    Parameters
    ----------
    rows : Rows
        Positions and velocities among the n states of the plant.
    flights : Flights
        How they ended.
    goal : ndarray, shape (n, K + 1)
        Reference at the samples, SI.
    final_goal : ndarray, shape (n, N)
        Reference when each flight ended, SI.
    begun : ndarray, shape (N,)
        When they began, s.
    planned_s : float
        How long they were to last.
    largest : Largest
        Largest deviations and commands over the flights.
    site : ndarray, shape (n,), or None
        End of the reference, where flights may end by an impact, SI.
    scale : ndarray, shape (n,)
        Natural units of the states, in which the step error of flights is given.
    period_s : float
        Time between samples.
    commands : int
        Number of rows of a command.
    impulsive : bool
        Whether commands are impulses; otherwise they are accelerations.

    Notes
    -----
    Of several spacecraft every distance and speed is the largest.

    The errors of metrics follow from the estimate e of the largest error of a state in natural
    units. An error of each of d components by at most e units changes a distance by at most
    :math:`\delta r = \sqrt{d}\,e` units of length, and a speed by at most :math:`\delta v`, as
    many units of velocity. A law corrects an error in velocity by as much Δv; over one period
    this takes an acceleration of :math:`\delta v` divided by the period. An event comes sooner or
    later by the time in which the flight covers :math:`\delta r`.
    """

    rows: Rows
    flights: Flights
    goal: Array
    final_goal: Array
    begun: Array
    planned_s: float
    largest: Largest
    site: Array | None
    scale: Array
    period_s: float
    commands: int
    impulsive: bool

    @cached_property
    def final_distance(self) -> Array:
        """Distances (N,) from the reference at the end, m."""
        return self.rows.distance(self.flights.x - self.final_goal)

    @cached_property
    def final_velocity_error(self) -> Array:
        """Differences in velocity (N,) from the reference at the end, m/s."""
        return self.rows.speed(self.flights.x - self.final_goal)

    @cached_property
    def final_speed(self) -> Array:
        """Speeds (N,) in the plant's frame at the end, m/s."""
        return self.rows.speed(self.flights.x)

    @cached_property
    def duration(self) -> Array:
        """Durations (N,), s."""
        return self.flights.time_s - self.begun

    @cached_property
    def early(self) -> Array:
        """Times (N,) from the end of the flights to their planned end, s; negative if later."""
        return self.planned_s - self.duration

    @cached_property
    def firings(self) -> Array:
        """Numbers (N,) of samples at which something other than zero was done."""
        return self.flights.firings.astype(float)

    @property
    def largest_distance(self) -> Array:
        """Largest distances (N,) from the reference until the planned end, m."""
        return self._largest(0, self.final_distance)

    @property
    def largest_velocity_error(self) -> Array:
        """Largest differences in velocity (N,) from the reference until the planned end, m/s."""
        return self._largest(1, self.final_velocity_error)

    @property
    def landing_miss(self) -> Array:
        """Distances (N,) from the end of the flights to the end of the reference, m."""
        assert self.site is not None
        return self.rows.distance(self.flights.x - self.site[:, None])

    def _largest(self, row: int, final: Array) -> Array:
        """Return the largest deviations (N,), the final one included.

        A flight that ended later than planned counts with its deviation at the planned end.
        """
        late = self.duration > self.planned_s * (1.0 + SAME_TIME)
        end = np.where(late, self._at_planned_end[row], final)
        return np.asarray(np.maximum(self.largest.deviations[row], end))

    @cached_property
    def _at_planned_end(self) -> Array:
        """Deviations (2, N) at the planned end, m and m/s."""
        return self.largest.at_planned_end(self.flights.x, self.duration)

    @cached_property
    def _error(self) -> Array:
        """Errors (N,) of the length of a vector in natural units; zero without an estimate."""
        axes = len(self.rows.positions) // self.rows.vectors
        error = self.flights.step_error
        return np.asarray(np.where(np.isfinite(error), error, 0.0) * np.sqrt(axes))

    @property
    def distance_error(self) -> Array:
        """Errors (N,) of distances by the step error, m."""
        return self._error * float(np.max(self.scale[self.rows.positions]))

    @property
    def speed_error(self) -> Array:
        """Errors (N,) of speeds by the step error, m/s."""
        return self._error * float(np.max(self.scale[self.rows.velocities]))

    @property
    def command_error(self) -> Array:
        """Errors (N,) of commands by the step error, m/s or m/s²."""
        return self.speed_error if self.impulsive else self.speed_error / self.period_s

    @property
    def time_error(self) -> Array:
        """Errors (N,) of the time of an event by the step error, s; zero for completed flights."""
        distance = self.distance_error
        by_event = np.array(self.flights.status) != "completed"
        # A flight that stands still when it ends may end at any time: the error is infinite.
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(by_event & (distance > 0.0), distance / self.final_speed, 0.0)

    @property
    def distance_over_time(self) -> Array:
        """Distances (K + 1, N) from the reference at the samples, m."""
        return self._over_time(self.rows.distance)

    @property
    def velocity_error_over_time(self) -> Array:
        """Differences in velocity (K + 1, N) from the reference at the samples, m/s."""
        return self._over_time(self.rows.speed)

    @property
    def command_over_time(self) -> Array:
        """Sizes (K + 1, N) of the commands of the law alone: of the largest thrust vector."""
        assert self.flights.history is not None
        own = fill_rows(self.flights.history.own, self.commands)
        each = own.reshape(thrust_vectors(len(own)), -1, *own.shape[1:])
        return append_end(np.sqrt(np.sum(each * each, axis=1)).max(axis=0))

    @property
    def dv_over_time(self) -> Array:
        """Δv (K + 1, N) spent until each sample, m/s."""
        assert self.flights.history is not None
        return np.asarray(self.flights.history.dv_m_s)

    def _over_time(self, size: Callable[[Array], Array]) -> Array:
        """Return the size (K + 1, N) of the deviation from the reference at the samples."""
        assert self.flights.history is not None
        gap = self.flights.history.x - self.goal[:, :, None]
        return size(gap.reshape(len(gap), -1)).reshape(gap.shape[1:])


def fill_rows(values: Array, rows: int) -> Array:
    """Return a history (rows, K, …): NaN if no flight lived to see a sample.

    Parameters
    ----------
    values : ndarray, shape (rows, K, …) or (0, K, …)
        Of `hillsphere.simulation.History`, which learns the number of rows at the first sample.
    rows : int
        How many there are.
    """
    return values if len(values) else np.full((rows, *values.shape[1:]), np.nan)


def append_end(values: Array) -> Array:
    """Return values (K, N) with a row of NaN for the end, where no command begins."""
    return np.concatenate([values, np.full((1, values.shape[1]), np.nan)])
