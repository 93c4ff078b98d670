"""Spec of the stage ``equilibria``: the keys of its table in a mission."""

from __future__ import annotations

from hillsphere.spec import Ref, StageSpec, quantity, reference

__all__ = ["EquilibriaSpec"]


class EquilibriaSpec(StageSpec):
    """Libration points of a plant in the true gravity of its body, and the motion about them."""

    produces = "hillsphere_plants.equilibria.stage:Equilibria"
    examples = ({"plant": "hill"},)

    plant: Ref = reference("plant", "equations of motion: 'hill' or 'three_body'")
    true_anomalies_rad: tuple[float, ...] = quantity(
        "angle",
        "for a plant on an ellipse: true anomalies at which a particle at rest is not accelerated "
        "for a moment at the points shown; left out: points of rest for good, which only a circle "
        "has",
        default=(),
        max_length=100,
    )
