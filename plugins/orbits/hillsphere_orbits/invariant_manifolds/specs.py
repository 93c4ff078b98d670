"""Spec of the stage ``invariant_manifolds``: the keys of a mission."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from hillsphere.base.constants import DAY_S
from hillsphere.spec import Ref, ResultNames, StageSpec, option, quantity, reference, rule
from hillsphere_orbits.options import label
from hillsphere_orbits.source_specs import OrbitNeeds

__all__ = ["InvariantManifoldsSpec"]


class InvariantManifoldsSpec(StageSpec):
    """Invariant manifolds of unstable periodic orbits, with the crossings of their trajectories.

    Distances from an orbit are Euclidean norms of the difference of normalised states at the same
    time. Stable orbits, and those whose unstable multipliers are complex, are listed as such.
    """

    results = ResultNames(
        metrics=(
            "trajectories",
            "impacts",
            "unstable_orbits",
        ),
        tables={
            "manifolds": (),
        },
    )
    produces = "hillsphere_orbits.invariant_manifolds.products:Manifolds"
    examples = (
        {
            "plant": "hill",
            "needs": {"orbits": ["families"]},
            "trajectories": 6,
            "duration_d": 1,
        },
        {
            "plant": "hill",
            "needs": {"orbits": ["family", "families"]},
            "members": ["1:17, 70 km"],
            "directions": ["stable"],
            "cylinders_km": [100, 30],
            "duration_d": 5,
        },
    )

    needs: OrbitNeeds = option("products of earlier stages whose members are taken")
    plant: Ref = reference("plant", "equations of motion of the orbits")
    members: tuple[str, ...] = option("names of the orbits; left out: all", default=())
    directions: tuple[Literal["unstable", "stable"], ...] = option(
        "which manifolds", default=("unstable", "stable"), min_length=1
    )
    trajectories: int = option(
        "trajectories of each side of a manifold, equally spaced in the logarithm of their "
        "distance from the orbit",
        default=60,
        ge=1,
        le=100_000,
    )
    duration_s: float = quantity(
        "time",
        "how long a trajectory is followed after it has left the orbit",
        default=5 * DAY_S,
        gt=0,
    )
    distance: float = option(
        "a trajectory has left its orbit when it is farther than this for good; normalised",
        default=1e-3,
        ge=1e-6,
        le=0.1,
    )
    start_distance: float = option(
        "largest distance from the orbit at which trajectories start, normalised",
        default=1e-5,
        ge=1e-9,
        le=1e-3,
    )
    cylinders_m: tuple[float, ...] = quantity(
        "length", "radii of cylinders about the z axis whose crossings are found", default=(), gt=0
    )
    label: str = label()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for key in ("members", "directions", "cylinders_m"):
            values = getattr(self, key)
            if len(set(values)) < len(values):
                raise rule(key, "a value is listed twice")
        if self.start_distance >= self.distance:
            text = "must be smaller than distance, at which the time of flight begins"
            raise rule("start_distance", text)
        return self
