"""Specs of file formats."""

from __future__ import annotations

from hillsphere.spec.base import Spec
from hillsphere.spec.fields import option

__all__ = ["FileFormatSpec", "OrbitMessageSpec"]


class FileFormatSpec(Spec):
    """A file format; it has no parameters."""

    examples = ({},)


class OrbitMessageSpec(FileFormatSpec):
    """A file format of messages for which there is a standard."""

    lenient: bool = option(
        "whether harmless departures from the standard are warnings, not errors", default=False
    )
