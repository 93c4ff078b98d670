"""Product of the stage ``closed_loop``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.products import Flown, Trajectories
from hillsphere.products.fields import Shape

__all__ = ["ClosedLoopFlight"]


@dataclass(frozen=True)
class ClosedLoopFlight(Flown):
    """The nominal flight, sample by sample; NaN beyond its end."""

    frame: str
    """Frame of the states."""
    states: Annotated[tuple[str, ...], Shape("states")]
    """Names of the states."""
    state_units: Annotated[tuple[str, ...], Shape("states")]
    """Their units."""
    controls: Annotated[tuple[str, ...], Shape("commands")]
    """Names of the rows of a command."""
    control_units: Annotated[tuple[str, ...], Shape("commands")]
    """Their units."""
    seen_states: Annotated[tuple[str, ...], Shape("seen")]
    """The states that the law sees."""
    period_s: float
    """Time between samples."""
    time_s: Annotated[Array, Shape("samples + 1")]
    """Times of the samples, and of the end of the last."""
    x: Annotated[Array, Shape("states", "samples + 1")]
    """True states, SI."""
    goal: Annotated[Array, Shape("states", "samples + 1")]
    """The reference, SI."""
    seen: Annotated[Array, Shape("seen", "samples")]
    """States as the law saw them, with navigation errors."""
    u: Annotated[Array, Shape("commands", "samples")]
    """Command as the actuator executed it from each sample on."""
    own: Annotated[Array, Shape("commands", "samples")]
    """Command of the law alone."""
    feedforward: Annotated[Array | None, Shape("commands", "samples")]
    """Command of the reference from each sample on; None if it comes with none."""
    dv_m_s: Annotated[Array, Shape("samples + 1")]
    """Δv spent until then."""
    position_error_m: Annotated[Array, Shape("samples + 1")]
    """Distance from the reference; of several spacecraft the largest."""
    velocity_error_m_s: Annotated[Array, Shape("samples + 1")]
    """Difference in velocity from the reference; of several spacecraft the largest."""
    end_s: float
    """Time of the end."""
    end_x: Annotated[Array, Shape("states")]
    """State there."""
    status: str
    """How the flight ended."""
    cause: str
    """What ended it: the name of an event or of a limit."""
    failed: bool
    """Whether that counts as a failure; never if the status says that it is undecided, see
    `hillsphere.cases.case_classes`."""
    metrics: Annotated[tuple[str, ...], Shape("metrics")]
    """Names of the metrics."""
    units: Annotated[tuple[str, ...], Shape("metrics")]
    """Their units."""
    values: Annotated[Array, Shape("metrics")]
    """Their values, SI."""
    step_error: float
    """Estimate of the step error at the end, in the plant's natural units."""
    step_error_m: float | None
    """How far the end moves with twice as many sub-steps; None where the tolerance held them."""
    nearest_m: float
    """Smallest distance from the centre of the frame at the samples and the end."""
    farthest_m: float
    """Largest distance from the centre of the frame at the samples and the end."""
    position_rows: Annotated[tuple[int, ...], Shape("axes")]
    """Which states are positions."""
    velocity_rows: Annotated[tuple[int, ...], Shape("axes")]
    """Which states are velocities."""
    body: str
    """Name of the body at the centre; empty if the plant does not say."""
    semi_axes_m: Annotated[Array | None, Shape(3)]
    """Semi-axes of its surface."""
    surface_m: Annotated[Array | None, Shape(3, "circles", "meridians")]
    """Points of it on circles of latitude, in the frame of the flight."""
    prime_meridian_rad: float
    """Angle about +z from +x to its longitude 0."""
    series_radius_m: float | None
    """Radius inside which its gravity is a series that may diverge."""
    hill_distance_m: float | None
    """Distance of the primary where the plant neglects terms of the relative order of the distance
    from the body; None where it does not."""

    def to_trajectories(self) -> Trajectories:
        """Return the true flight: one coast, or one after each impulse that was executed.

        Times are those of the plant's clock. Under a held command the states are those of its
        samples, between which the command does not change.
        """
        count = int(np.sum(np.isfinite(self.x[0]) & (self.time_s < self.end_s)))
        t = np.append(self.time_s[:count], self.end_s)
        before = np.concatenate([self.x[:, :count], self.end_x[:, None]], axis=1)
        after = before.copy()
        begins = [0]
        if set(self.control_units) == {"m/s"}:
            after[list(self.velocity_rows), : min(count, self.u.shape[1])] += np.nan_to_num(
                self.u[:, :count]
            )
            kicked = np.any(np.nan_to_num(self.u[:, :count]) != 0.0, axis=0)
            begins += [k for k in np.flatnonzero(kicked).tolist() if k]
        ends = [*begins[1:], count]
        most = max(end - begin for begin, end in zip(begins, ends, strict=True)) + 1
        t_s = np.full((most, len(begins)), np.nan)
        x = np.full((len(self.states), most, len(begins)), np.nan)
        for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
            size = end - begin + 1
            t_s[:size, k] = t[begin : end + 1]
            x[:, :size, k] = before[:, begin : end + 1]
            x[:, 0, k] = after[:, begin]
        labels = tuple(f"coast {k + 1}" for k in range(len(begins)))
        return Trajectories(self.frame, self.states, ("flight",) * len(begins), labels, t_s, x)
