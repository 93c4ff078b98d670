"""Specs of the executors."""

from __future__ import annotations

from hillsphere.spec.base import Spec, option

__all__ = ["PoolSpec", "SerialSpec"]


class SerialSpec(Spec):
    """The process of the run itself."""

    examples = ({},)


class PoolSpec(Spec):
    """Worker processes on this machine."""

    examples = ({"workers": 1}, {})
    workers: int | None = option(
        "number of processes; by default one per processor that the run may use",
        default=None,
        ge=1,
        le=1024,
    )
