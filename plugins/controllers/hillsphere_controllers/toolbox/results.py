"""What the results of the flat functions have in common: a readable `repr`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar

import numpy as np

from hillsphere.lti import LtiSystem

__all__ = ["Readable", "System"]

System = TypeVar("System", bound=LtiSystem)
"""Type of the systems given and returned: `LtiSystem`, or a system of python-control, which has no
types."""
_DIGITS = 5
"""Significant digits shown: more than a design is known to."""
_ENTRIES = 12
"""Entries of an array that are shown; of larger ones the shape is."""


class Readable:
    """A dataclass whose `repr` has one line per field that is not at its default."""

    def __repr__(self) -> str:
        """Return the name of the class and one line per field."""
        named: list[Any] = [
            one
            for one in fields(self)  # type: ignore[arg-type]
            if one.default is MISSING or getattr(self, one.name) != one.default
        ]
        width = max(len(one.name) for one in named)
        indent = "\n" + " " * (width + 4)
        lines = [
            f"  {one.name:<{width}}  {_text(getattr(self, one.name)).replace(chr(10), indent)}"
            for one in named
        ]
        return "\n".join([type(self).__name__, *lines])


def _text(value: object) -> str:
    if isinstance(value, bool | str) or value is None:
        return str(value)
    if isinstance(value, float | np.floating):
        return f"{value:.{_DIGITS}g}"
    if isinstance(value, np.ndarray):
        if value.size > _ENTRIES:
            return f"array of {' × '.join(map(str, value.shape))}"
        return np.array2string(value, precision=_DIGITS - 1).replace("\n", "")
    if isinstance(value, Mapping):
        return ", ".join(f"{name} = {_text(one)}" for name, one in value.items()) or "none"
    if isinstance(value, tuple):
        return ", ".join(_text(one) for one in value) or "none"
    if type(value).__module__.partition(".")[0] == "control":
        return f"<{type(value).__name__} of python-control: {value.nstates} states>"  # type: ignore[attr-defined]
    return str(value)
