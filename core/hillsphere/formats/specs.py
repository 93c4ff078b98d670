"""Spec of file formats."""

from __future__ import annotations

from hillsphere.spec.base import Spec

__all__ = ["FileFormatSpec"]


class FileFormatSpec(Spec):
    """A file format; it has no parameters."""

    examples = ({},)
