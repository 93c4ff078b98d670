"""Proofs of events that simulators of the same equations and limits share.

What a proof has learnt of one flight, regions of states above all, holds for every other of the
same equations, whatever its law. Stages that try many laws on one orbit make a simulator for each.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from threading import local
from weakref import WeakKeyDictionary

from hillsphere.engine.dynamics.system import System
from hillsphere.engine.simulation.event_proof import EventProof
from hillsphere.engine.simulation.legs import Limit

__all__ = ["proof_of"]

_MOST = 8
"""Proofs that are kept of one system: each holds some megabytes of regions, and the orbits of a
mission, whose limits differ, are flown one after the other."""


class _Kept(local):
    """Proofs of one thread: they change while they are used."""

    def __init__(self) -> None:
        self.proofs: WeakKeyDictionary[System, OrderedDict[tuple[object, ...], EventProof]] = (
            WeakKeyDictionary()
        )


_KEPT = _Kept()


def proof_of(system: System, limits: Sequence[Limit], budget: bool, fixed: int) -> EventProof:
    """Return the proof of a system's events and of limits, the same for equal bounds.

    Parameters
    ----------
    system : System
        Equations and events.
    limits : sequence of Limit
        Limits of the user.
    budget : bool
        Whether the Δv at hand is limited.
    fixed : int
        Number of the first run-time parameters, which do not change during a flight.

    Returns
    -------
    EventProof
        Only for the thread that asks.
    """
    proofs = _KEPT.proofs.setdefault(system, OrderedDict())
    key = (budget, fixed, *(limit.bound for limit in limits))
    if key not in proofs:
        proofs[key] = EventProof(
            system.bounded, len(system.events), limits, budget, fixed, system.scale
        )
    proofs.move_to_end(key)
    while len(proofs) > _MOST:
        proofs.popitem(last=False)
    return proofs[key]
