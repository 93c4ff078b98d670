"""The option `label`, common to the Specs of several stages."""

from __future__ import annotations

from typing import Any

from hillsphere.spec import option

__all__ = ["VARY_INSTEAD", "label"]

VARY_INSTEAD = (
    "carry its orbits along changing parameters with the key vary of a stage of type orbit_family, "
    'or fly them in Python by hs.Motion(plant, {"gravity.density": value})'
)
"""What varies the equations of a family, which no campaign repeats."""


def label(
    what: str = "names of tables, figures and metrics, to distinguish two stages of this type",
) -> Any:
    """Return the option `label`, appended to the names of a stage's tables, figures and metrics."""
    return option(
        f"appended to the {what}",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )
