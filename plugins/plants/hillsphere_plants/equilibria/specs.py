"""Spec of the stage ``equilibria``: the keys of its table in a mission."""

from __future__ import annotations

from hillsphere.spec import Ref, ResultNames, StageSpec, quantity, reference

__all__ = ["EquilibriaSpec"]


class EquilibriaSpec(StageSpec):
    """Libration points of a plant in the true gravity of its body, and the motion about them."""

    results = ResultNames(
        metrics=(
            "*_distance",
            "*_distance_*",
        ),
        tables={
            "equilibrium_points": (),
        },
    )
    produces = "hillsphere_plants.equilibria.stage:Equilibria"
    examples = ({"plant": "hill"},)

    plant: Ref = reference("plant", "equations of motion: 'hill' or 'three_body'")
    true_anomalies_rad: tuple[float, ...] = quantity(
        "angle",
        "for an elliptic orbit: true anomalies at which instantaneous equilibria are found; left "
        "out: equilibria that are fixed in time, which only a circular orbit has",
        default=(),
        max_length=100,
    )
