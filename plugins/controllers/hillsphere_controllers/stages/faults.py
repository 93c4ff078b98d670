"""Faults of rules between the keys of a Spec, placed at one of them."""

from __future__ import annotations

from collections.abc import Iterable

from hillsphere.spec import rule

__all__ = ["require_one"]


def require_one(given: Iterable[str], of: Iterable[str], key: str) -> None:
    """Raise a fault at a key unless just one of several keys is given."""
    found, names = list(given), ", ".join(of)
    if len(found) != 1:
        what = f"{' and '.join(found)} are" if found else "none is"
        raise rule(found[-1] if found else key, f"just one of {names} must be given; {what}")
