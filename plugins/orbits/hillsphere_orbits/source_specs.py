"""Input of the stages on periodic orbits: members of families of any kind."""

from __future__ import annotations

from hillsphere.spec import Ref, Spec, need

__all__ = ["OrbitNeeds"]


class OrbitNeeds(Spec):
    """Stages whose orbits are used, of any family."""

    examples = ({"orbits": ["family"]}, {"orbits": ["family", "families"]})

    orbits: tuple[Ref, ...] = need(
        "hillsphere.products:OrbitSet", "families whose members are taken", min_length=1
    )
