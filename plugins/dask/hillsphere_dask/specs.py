"""Spec of the executor ``dask``."""

from __future__ import annotations

from hillsphere.spec import Spec, option

__all__ = ["DaskSpec"]


class DaskSpec(Spec):
    """Workers of a dask cluster: one started on this machine, or one that is already there.

    The workers of a cluster have one thread each (``dask worker ADDRESS --nthreads 1``) and the
    environment of the run: the same versions, plugins and type of processor.
    """

    examples = ({"workers": 1}, {})
    scheduler: str = option(
        'address of a scheduler, "tcp://host:8786"; by default a cluster is started on this '
        "machine and ended with the run",
        default="",
        pattern=r"^([a-z]+://\S+)?$",
    )
    workers: int | None = option(
        "number of workers, of a cluster at most; by default all of them, on this machine one per "
        "processor that the run may use",
        default=None,
        ge=1,
        le=100_000,
    )
