"""The option `label`, common to the Specs of several stages."""

from __future__ import annotations

from typing import Any

from hillsphere.spec import option

__all__ = ["label"]


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
