"""Sampled-data control laws, and laws that take their controller from a synthesis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract

if TYPE_CHECKING:
    from hillsphere.base.lti import LtiSystem
    from hillsphere.interfaces.loop import ContinuousLaw

__all__ = ["Compensator", "SynthesisedLaw"]


@runtime_checkable
class Compensator(Contract, Protocol):
    """A sampled-data control law, from measurement and reference to the command.

    Pure functions of arrays, lane by lane. The law keeps no state between calls: its memory is the
    array `xc`, which the simulation passes from sample to sample. Laws in continuous time are
    `hillsphere.simulation.ContinuousLaw`.
    """

    @property
    def period_s(self) -> float:
        """Sampling period, s."""
        ...

    @property
    def actuation(self) -> Literal["hold", "impulse"]:
        """``"hold"``: u is held, m/s²; ``"impulse"``: u is added to the velocities, m/s."""
        ...

    def initial(self, n_cases: int) -> Array:
        """Return the law's own states (m, N) before the first sample; m may be zero."""
        ...

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (p, N) and the law's states (m, N) after sample k; change no argument.

        t_s (N,) is the time, y (q, N) the navigated states, SI, ref (q, N) their reference. For
        ``"hold"`` u has one row per control of the plant, in order; for ``"impulse"`` one row per
        velocity, in the order of the states.
        """
        ...


@runtime_checkable
class SynthesisedLaw(Contract, Protocol):
    """A law whose controller may come from an earlier stage, in sampled or continuous time."""

    @property
    def complete(self) -> bool:
        """Whether it has a controller; without one it cannot be run."""
        ...

    def flying(self, controller: LtiSystem) -> Compensator | ContinuousLaw:
        """Return the law with this controller; period and actuation are unchanged."""
        ...
