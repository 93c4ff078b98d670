"""How flights end, and what is kept of them."""

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
"""How a flight may end.

``completed``: all samples were flown; ``impact``, ``escape``: events of the plant of these names;
``constraint``: any other event, or a limit; ``propellant``: the Δv at hand was spent;
``diverged``: a state or a command was no finite number, or a filter left the truth;
``step_size``: the smallest sub-steps did not meet the tolerance; ``unresolved``: whether an event
took place could not be decided, the cause names it; ``time_limit``: the block's
wall-clock time was up.
"""


def status_of_event(name: str) -> str:
    """Return the status that an event of this name stands for."""
    return name if name in ("impact", "escape") else "constraint"


@dataclass(frozen=True)
class History:
    """Flights sample by sample; NaN after the end of a flight.

    Parameters
    ----------
    time_s : ndarray, shape (K + 1, N)
        Times of the samples, and of the end of the last.
    x : ndarray, shape (n, K + 1, N)
        True states before the sample acts, SI.
    y : ndarray, shape (q, K, N)
        What the law saw.
    ref : ndarray, shape (q, K, N)
        What it should have seen.
    u : ndarray, shape (p, K, N)
        What the actuator did: m/s² held, m/s at an impulse; for a continuous law its command at
        the sample (after `sample`, before errors of the actuator). With a feedforward in steps,
        that of the first.
    own : ndarray, shape (p, K, N)
        What the law commanded by itself, without feedforward and before errors of the actuator.
    dv_m_s : ndarray, shape (K + 1, N)
        Δv spent until then.
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
    """How N flights ended.

    Parameters
    ----------
    frame : str
        Frame of the states.
    states : tuple of str
        Names of the n states of the plant.
    status : tuple of str
        One of `STATUSES` per case.
    cause : tuple of str
        Name of the event or limit, or what was not finite; ``""`` for a completed flight.
    time_s : ndarray, shape (N,)
        Time of the end, located where an event or limit ended it.
    x : ndarray, shape (n, N)
        True states then, SI; of a diverged flight the last finite ones.
    dv_m_s : ndarray, shape (N,)
        Δv that was done: the sum of the impulses' magnitudes, or ∫|u| dt.
    firings : ndarray of int, shape (N,)
        Samples at which something other than zero was done; of a continuous law all of them.
    samples : ndarray of int, shape (N,)
        Samples at which the law acted.
    step_error : ndarray, shape (N,)
        Sum over the flight of the estimated errors of its steps, without dimension: of the states
        in units of the plant's scales, as `tolerance` of the simulator is. From the formula's
        embedded pair (`hillsphere.engine.dynamics.tableaux.Tableau.step_error`), on smooth motion 2
        to 30 times the true error of a step. It does not tell how later motion amplifies an error.
    history : History or None
        The way there.
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
        """Return how many flights ended in each way that occurs, in the order of `STATUSES`."""
        return {s: n for s in STATUSES if (n := self.status.count(s))}
