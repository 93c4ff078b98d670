"""Controllers at samples, and laws that a synthesis fills."""

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
    """A run-time law that acts at samples: what it sees to what the actuator is told.

    Pure functions of arrays, lane by lane: the law keeps nothing between calls, its memory is the
    array `xc` that `hillsphere.simulation` carries for it. Laws that act between samples too are
    `hillsphere.simulation.ContinuousLaw`.
    """

    @property
    def period_s(self) -> float:
        """Time between two samples."""
        ...

    @property
    def actuation(self) -> Literal["hold", "impulse"]:
        """Whether u is held until the next sample (m/s²), or added to the velocities (m/s)."""
        ...

    def initial(self, n_cases: int) -> Array:
        """Return the law's own states (m, N) before the first sample; m may be zero."""
        ...

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (p, N) and the law's states (m, N) after sample k; change no argument.

        t_s (N,) is the time, y (q, N) what the navigation gives (the plant's states, SI), ref
        (q, N) what it should be. u has one row per control of the plant, in their order, for
        ``"hold"``; one per velocity, in the order of the states, for ``"impulse"``.
        """
        ...


@runtime_checkable
class SynthesisedLaw(Contract, Protocol):
    """A law, at samples or continuous, that may wait for the controller of an earlier stage."""

    @property
    def complete(self) -> bool:
        """Whether it has a controller of its own; one without takes no step."""
        ...

    def flying(self, controller: LtiSystem) -> Compensator | ContinuousLaw:
        """Return the law with this controller; period and actuation stay."""
        ...
