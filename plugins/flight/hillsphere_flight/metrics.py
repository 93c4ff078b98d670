"""Metrics of the stage ``closed_loop``: one record for each.

Nothing numerical is imported here: the values are properties of `FlownBlock`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from hillsphere.engine.flight_metrics import FlightHistory, FlightMetric, Requirement

if TYPE_CHECKING:
    from hillsphere_flight.flown_block import FlownBlock

__all__ = ["COMMAND_UNIT", "HISTORIES", "LANDING_METRICS", "METRICS", "fit_units"]

COMMAND_UNIT = "(unit of the command)"
"""Stands for the unit of a law's commands, m/s of impulses and m/s² of accelerations."""

_Q = TypeVar("_Q", "FlightMetric[FlownBlock]", "FlightHistory[FlownBlock]")

METRICS: tuple[FlightMetric[FlownBlock], ...] = (
    FlightMetric(
        "dv",
        "m/s",
        lambda of: of.flights.dv_m_s,
        lambda of: of.speed_error,
        (Requirement("dv_m_s", "speed", "Δv", allows_zero=True),),
    ),
    FlightMetric(
        "final_position_error",
        "m",
        lambda of: of.final_distance,
        lambda of: of.distance_error,
        (
            Requirement(
                "final_position_error_m", "length", "distance from the reference at the end"
            ),
        ),
    ),
    FlightMetric(
        "final_velocity_error",
        "m/s",
        lambda of: of.final_velocity_error,
        lambda of: of.speed_error,
        (
            Requirement(
                "final_velocity_error_m_s",
                "speed",
                "difference in velocity from the reference at the end",
            ),
        ),
    ),
    FlightMetric(
        "largest_position_error",
        "m",
        lambda of: of.largest_distance,
        lambda of: of.distance_error,
        (
            Requirement(
                "largest_position_error_m",
                "length",
                "largest distance from the reference over the flight",
            ),
        ),
    ),
    FlightMetric(
        "largest_velocity_error",
        "m/s",
        lambda of: of.largest_velocity_error,
        lambda of: of.speed_error,
        (
            Requirement(
                "largest_velocity_error_m_s",
                "speed",
                "largest difference in velocity over the flight",
            ),
        ),
    ),
    FlightMetric("duration", "s", lambda of: of.duration, lambda of: of.time_error),
    FlightMetric("firings", "-", lambda of: of.firings),
    FlightMetric(
        "final_speed",
        "m/s",
        lambda of: of.final_speed,
        lambda of: of.speed_error,
        (
            Requirement("final_speed_m_s", "speed", "speed in the plant's frame at the end"),
            Requirement(
                "touchdown_speed_m_s",
                "speed",
                "speed in the plant's frame at the end, of flights that end by an impact",
                cause="touchdown_speed",
                status="impact",
                rank=1,
            ),
        ),
    ),
    FlightMetric(
        "early",
        "s",
        lambda of: of.early,
        lambda of: of.time_error,
        (
            Requirement(
                "early_s",
                "time",
                "how long before the end of the reference, or before the last sample if this is "
                "sooner, a flight may end",
                rank=0,
            ),
            Requirement(
                "late_s",
                "time",
                "how long after the end of the reference a flight may end; with overtime_s",
                sign=-1.0,
                cause="late",
                rank=0,
            ),
        ),
    ),
    FlightMetric(
        "largest_command",
        COMMAND_UNIT,
        lambda of: of.largest.command,
        lambda of: of.command_error,
        (
            Requirement(
                "largest_acceleration_m_s2",
                "acceleration",
                "held and continuous laws: largest command of the law alone over the flight",
            ),
            Requirement(
                "largest_impulse_m_s",
                "speed",
                "impulsive laws: largest command of the law alone over the flight",
            ),
        ),
    ),
)
"""Metrics of every flight, in the order of tables.

The final speed is measured in the plant's frame: of a flight that ends on the surface it is the
touchdown speed. `early` is the time from the end of a flight to its planned end, which is the end
of the reference or the last sample, whichever comes first; it is negative for a later flight. The
largest command is that of the law alone, without the reference's command. Largest values are taken
over the whole flight, between samples too (`hillsphere_flight.largest`), until the planned end of a
flight that has overtime.

The requirements on the time and the speed of the end have the lowest ranks: a crash far from the
site, or a hard one, is reported as such and not by its miss.
"""

LANDING_METRICS: tuple[FlightMetric[FlownBlock], ...] = (
    FlightMetric(
        "landing_miss",
        "m",
        lambda of: of.landing_miss,
        lambda of: of.distance_error,
        (
            Requirement(
                "landing_miss_m",
                "length",
                "distance from where a flight ended to the end of the reference; of flights along "
                "one that may end by an impact",
            ),
        ),
    ),
)
"""Further metrics of flights along a reference that may end by an impact.

The landing miss is the distance in the plant's frame from where a flight ended to the end of its
reference. The final position error is no such distance: it refers to the reference at the time of
the end, and a reference that a late flight follows has gone on below the ground by then.
"""

HISTORIES: tuple[FlightHistory[FlownBlock], ...] = (
    FlightHistory(
        "position_error", "m", lambda of: of.distance_over_time, lambda of: of.final_distance
    ),
    FlightHistory(
        "velocity_error",
        "m/s",
        lambda of: of.velocity_error_over_time,
        lambda of: of.final_velocity_error,
    ),
    FlightHistory("command", COMMAND_UNIT, lambda of: of.command_over_time),
    FlightHistory("dv", "m/s", lambda of: of.dv_over_time, lambda of: of.flights.dv_m_s),
)
"""Quantities over time of every flight, after the states and commands of its plant."""


def fit_units(quantities: tuple[_Q, ...], command_unit: str) -> tuple[_Q, ...]:
    """Return metrics or histories with the unit of a law's commands for `COMMAND_UNIT`."""
    return tuple(
        replace(quantity, unit=command_unit) if quantity.unit == COMMAND_UNIT else quantity
        for quantity in quantities
    )
