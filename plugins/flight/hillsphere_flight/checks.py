"""Checks of a flight before it begins."""

from __future__ import annotations

from hillsphere.engine.course import Rows
from hillsphere.errors import InputError
from hillsphere.interfaces.control import Compensator, SynthesisedLaw
from hillsphere.simulation import ContinuousLaw, Flights
from hillsphere_flight.specs import ClosedLoopSpec

__all__ = ["check", "format_end_at_start", "lands", "refuse_ended_at_start"]


def lands(spec: ClosedLoopSpec) -> bool:
    """Return whether flights follow a reference and may end by an impact."""
    return spec.needs.reference is not None and "impact" in spec.success


def check(spec: ClosedLoopSpec, rows: Rows, law: Compensator | ContinuousLaw, kind: str) -> None:
    """Raise unless Spec, plant and law fit together.

    Parameters
    ----------
    spec : ClosedLoopSpec
        As declared.
    rows : Rows
        Rows of the plant's positions and velocities.
    law : Compensator or ContinuousLaw
        The control law.
    kind : str
        Kind of its command, in words: ``"impulses"`` or ``"a held acceleration"``.

    Raises
    ------
    InputError
        If they do not; the message begins with the key of the Spec at fault.
    """
    most = len(rows.positions)
    given = {"start.position_m": spec.start.position_m}
    given["start.velocity_m_s"] = spec.start.velocity_m_s
    if spec.target is not None:
        given["target.position_m"] = spec.target.position_m
        given["target.velocity_m_s"] = spec.target.velocity_m_s
    for key, values in given.items():
        if values is not None and len(values) != most:
            named = rows.positions if "position" in key else rows.velocities
            raise InputError(
                f"{key}: the plant has {most} ({', '.join(rows.names[i] for i in named)}), "
                f"got {len(values)} numbers"
            )
    others = [rows.names[i] for i in rows.others]
    if unknown := sorted(set(spec.start.others) - set(others)):
        raise InputError(
            f"start.others: no state {', '.join(unknown)} that is neither position nor "
            f"velocity; the plant has {', '.join(others) or 'none'}"
        )
    waits = isinstance(law, SynthesisedLaw) and not law.complete
    if waits and not spec.needs.controller:
        raise InputError(
            "law: it has no controller; give the law one, or a synthesis as needs.controller"
        )
    if spec.needs.controller and not waits:
        raise InputError("needs.controller: the law has a controller already; leave it out")
    if spec.design > 1 and not waits:
        raise InputError("design: the law waits for no synthesis; leave it out")
    wrong = "largest_acceleration_m_s2" if kind == "impulses" else "largest_impulse_m_s"
    if spec.require.limit(wrong) is not None:
        raise InputError(f"require.{wrong}: the law commands {kind}; limit those")
    missing = [name for name in others if name not in spec.start.others]
    if missing and not spec.needs.reference:
        raise InputError(f"start.others: give the value of {', '.join(missing)}")


def refuse_ended_at_start(flights: Flights) -> None:
    """Raise if the first flight ended before its law acted.

    Raises
    ------
    InputError
        If an event of the plant or a limit is exceeded where the flight begins. A start that is
        known before any stage runs is refused earlier, by `hillsphere_flight.foresight`.
    """
    if flights.status[0] in ("impact", "escape", "constraint") and not flights.samples[0]:
        raise InputError(format_end_at_start("start", flights.cause[0]))


def format_end_at_start(key: str, cause: str) -> str:
    """Return the message about a flight that ends where it begins.

    Parameters
    ----------
    key : str
        Key of the Spec that gives the start.
    cause : str
        Name of the event or limit.
    """
    return (
        f"{key}: the flight has ended where it begins, by {cause!r}; begin above the ground, and "
        "within the escape distance and the limits"
    )
