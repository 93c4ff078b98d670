"""What the Specs of several stages say alike: a label."""

from __future__ import annotations

from typing import Any

from hillsphere.spec import option

__all__ = ["label"]


def label(
    what: str = "names of tables, figures and metrics, to tell two such stages apart",
) -> Any:
    """Return the option that is appended to the names of what a stage shows."""
    return option(
        f"appended to the {what}",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )
