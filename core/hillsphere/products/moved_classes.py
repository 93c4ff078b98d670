"""Paths and field names of products that an earlier version stored under other names."""

from __future__ import annotations

from typing import Any

__all__ = ["added_fields", "current_class", "current_field"]

# fmt: off
_MOVED = {
    "hillsphere.campaign.block_outcome": "hillsphere.cases.block_outcome",
    "hillsphere.campaign.cases": "hillsphere.interfaces.cases",
    "hillsphere.campaign.checkpoints": "hillsphere.cases.checkpoints",
    "hillsphere.campaign.comparison_products": "hillsphere_campaigns.campaign_comparison.products",
    "hillsphere.campaign.summary_products": "hillsphere_campaigns.campaign_summary.products",
    "hillsphere.closed_loop.products": "hillsphere_flight.products",
    "hillsphere.estimation": "hillsphere.interfaces.beliefs",
    "hillsphere.linear_products": "hillsphere_controllers.linear_products",
    "hillsphere.lti": "hillsphere.base.lti",
    "hillsphere.products": "hillsphere.products.products",
    "hillsphere_controllers.lft.transformation":
        "hillsphere_controllers.linear_fractional.transformation",
    "hillsphere_controllers.lft.uncertainties":
        "hillsphere_controllers.linear_fractional.uncertainties",
    "hillsphere_estimators.navigation.comparison_products":
        "hillsphere_estimators.navigation_comparison.products",
    "hillsphere_estimators.refinement.products": "hillsphere_estimators.orbit_refinement.products",
    "hillsphere_orbits.fidelity.products": "hillsphere_orbits.fidelity_ladder.products",
    "hillsphere_orbits.following.products": "hillsphere_orbits.orbit_family.products",
    "hillsphere_orbits.manifolds.products": "hillsphere_orbits.invariant_manifolds.products",
    "hillsphere_orbits.reflown.products": "hillsphere_orbits.transfers_reflown.products",
    "hillsphere_orbits.robustness.products": "hillsphere_orbits.nonlinear_stability.products",
    "hillsphere_orbits.spatial.products": "hillsphere_orbits.spatial_qso_families.products",
    "hillsphere_orbits.swing.products": "hillsphere_orbits.swing_qso_families.products",
    "hillsphere_orbits.transfers.manifold_products":
        "hillsphere_orbits.manifold_transfers.products",
    "hillsphere_orbits.transfers.swing_products": "hillsphere_orbits.swing_transfers.products",
    "hillsphere_plants.equilibria_stage": "hillsphere_plants.equilibria.stage",
    "hillsphere_plants.proximity_reference": "hillsphere_plants.formation_reference.stage",
    "hillsphere_tracking.assisted.comparison_products":
        "hillsphere_tracking.tracking_comparison.products",
    "hillsphere_tracking.assisted.products": "hillsphere_tracking.assisted_tracking.products",
    "hillsphere_tracking.pass_products": "hillsphere_tracking.passes.products",
}
"""Module in an earlier version → present module."""

_RENAMED_CLASSES = {
    "hillsphere_campaigns.campaign_summary.products:Claim":
        "hillsphere_campaigns.campaign_summary.products:PairedTest",
    "hillsphere_controllers.structured.search:Found":
        "hillsphere_controllers.structured.search:SearchResult",
}
# fmt: on
"""Path of a class in an earlier version → its present path, after the module has moved."""

_RENAMED_FIELDS = {
    "hillsphere_campaigns.campaign_summary.products:CampaignSummary": {"claims": "tests"},
    "hillsphere_orbits.coverage.products:Coverage": {
        "sun_elevation_min_rad": "min_sun_elevation_rad",
    },
    "hillsphere_orbits.fidelity_ladder.products:FidelityLadder": {
        "altitude_min_m": "min_altitude_m",
    },
    "hillsphere_orbits.transfers_reflown.products:TransfersReflown": {
        "altitude_min_m": "min_altitude_m",
    },
}
"""Path of a class today → field of an earlier version → the same field today."""


def current_class(path: str) -> str:
    """Return the present import path of a product's class, ``"module:Class"``.

    Parameters
    ----------
    path : str
        Path in a file, of this version or of an earlier one.

    Returns
    -------
    str
        The present path; `path` itself if the class has neither moved nor another name.
    """
    module, _, name = path.partition(":")
    path = f"{_MOVED.get(module, module)}:{name}"
    return _RENAMED_CLASSES.get(path, path)


def current_field(path: str, name: str) -> str:
    """Return the name that a stored field of a product has today.

    Parameters
    ----------
    path : str
        Path of the product's class, ``"module:Class"``, as a file says it.
    name : str
        Name of the field, as the file says it.

    Returns
    -------
    str
        The name itself if the field was not renamed.
    """
    return _RENAMED_FIELDS.get(current_class(path), {}).get(name, name)


_ADDED_FIELDS: dict[str, dict[str, Any]] = {
    "hillsphere.products.products:CaseTable": {"swept_labels": ()},
}
"""Path of a class → fields that an earlier version did not have, with what its files mean."""


def added_fields(cls: type) -> dict[str, Any]:
    """Return the values of the fields that files of an earlier version do not have."""
    return _ADDED_FIELDS.get(f"{cls.__module__}:{cls.__qualname__}", {})
