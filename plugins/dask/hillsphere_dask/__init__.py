"""Built-in dask plugin: cases computed by workers of dask.distributed (extra ``dask``)."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "executor",
            "dask",
            "hillsphere_dask.dask:Dask",
            "hillsphere_dask.specs:DaskSpec",
            "in workers of dask.distributed, here or on a cluster",
        ),
    ]
