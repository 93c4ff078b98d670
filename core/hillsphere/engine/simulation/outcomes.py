"""Outcomes of flights: their status, final states, and histories."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.base.arrays import Array, Integers

__all__ = ["STATUSES", "Flights", "History", "status_of_event"]

STATUSES = (
    "completed",
    "impact",
    "escape",
    "constraint",
    "propellant",
    "diverged",
    "step_size",
    "unresolved",
    "time_limit",
)
"""Possible ends of a flight.

``completed``: all samples were flown; ``impact``, ``escape``: events of the plant of these names;
``constraint``: any other event, or a limit; ``propellant``: the available Δv was spent;
``diverged``: a state or a command was not finite, or a filter diverged from the truth;
``step_size``: the smallest sub-steps did not meet the tolerance; ``unresolved``: it could not be
decided whether the event that `cause` names took place; ``time_limit``: the block exceeded its
wall-clock time.
"""


def status_of_event(name: str) -> str:
    """Return the status of a flight that ends by the event of this name."""
    return name if name in ("impact", "escape") else "constraint"


@dataclass(frozen=True)
class History:
    """Time histories of flights at their samples; NaN after the end of a flight.

    Parameters
    ----------
    time_s : ndarray, shape (K + 1, N)
        Times of the samples, and of the end of the last.
    x : ndarray, shape (n, K + 1, N)
        True states before the sample acts, SI.
    y : ndarray, shape (q, K, N)
        Navigated states, the input of the law.
    ref : ndarray, shape (q, K, N)
        Reference of the law.
    u : ndarray, shape (p, K, N)
        Executed command: m/s² if held, m/s for an impulse; for a continuous law its command at the
        sample (after `sample`, before errors of the actuator). With a feedforward in steps, the
        value in the first step.
    own : ndarray, shape (p, K, N)
        The law's command without feedforward and before errors of the actuator.
    dv_m_s : ndarray, shape (K + 1, N)
        Δv spent so far.
    """

    time_s: Array
    x: Array
    y: Array
    ref: Array
    u: Array
    own: Array
    dv_m_s: Array


@dataclass(frozen=True)
class Flights:
    """Results of N flights.

    Parameters
    ----------
    frame : str
        Frame of the states.
    states : tuple of str
        Names of the n states of the plant.
    status : tuple of str
        One of `STATUSES` per case.
    cause : tuple of str
        Name of the event or limit, or of the value that was not finite; ``""`` for a completed
        flight.
    time_s : ndarray, shape (N,)
        Time of the end; the time of an event or limit is located within its sub-step.
    x : ndarray, shape (n, N)
        True states at the end, SI; the last finite ones of a diverged flight.
    dv_m_s : ndarray, shape (N,)
        Executed Δv: the sum of the impulses' magnitudes, or ∫|u| dt.
    firings : ndarray of int, shape (N,)
        Number of samples with an executed command other than zero; all samples for a continuous
        law.
    samples : ndarray of int, shape (N,)
        Samples at which the law acted.
    step_error : ndarray, shape (N,)
        Sum over the flight of the estimated errors of its steps, without dimension: of the states
        in units of the plant's scales, as `tolerance` of the simulator. The estimate of a step
        (`hillsphere.engine.dynamics.tableaux.Tableau.step_error`) is 2 to 30 times its true error
        on smooth motion. The sum does not include the growth of errors by the later motion.
    history : History or None
        Time histories, if requested.
    """

    frame: str
    states: tuple[str, ...]
    status: tuple[str, ...]
    cause: tuple[str, ...]
    time_s: Array
    x: Array
    dv_m_s: Array
    firings: Integers
    samples: Integers
    step_error: Array
    history: History | None = None

    def counts(self) -> dict[str, int]:
        """Return the number of flights per status that occurs, in the order of `STATUSES`."""
        return {s: n for s in STATUSES if (n := self.status.count(s))}
