"""The environment on which the last bits of results depend: versions, machine, CPU features."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from typing import Any

import numpy as np

__all__ = ["environment", "package_versions"]

NUMERICAL = ("numpy", "scipy", "heyoka")
PACKAGES = ("hillsphere", *NUMERICAL, "matplotlib", "pluggy", "pydantic")

KERNEL_VARIABLES = (
    "GLIBC_TUNABLES",
    "MKL_CBWR",
    "MKL_DEBUG_CPU_TYPE",
    "MKL_ENABLE_INSTRUCTIONS",
    "OPENBLAS_CORETYPE",
)
"""Environment variables by which a user selects other numerical kernels of a library."""


@cache
def environment() -> dict[str, Any]:
    """Return Python and library versions, machine and CPU features.

    Returns
    -------
    dict
        ``python``, ``packages`` (the numerical ones), ``system``, ``machine``, ``c_library`` (its
        sines are those of the simulation), ``cpu_features`` (those that numpy found), ``kernels``
        (variables that are set and choose others). Nothing in it names a host or a user.
    """
    # A numpy built without run-time dispatch has no such section.
    simd = np.show_config(mode="dicts").get("SIMD Extensions", {})
    return {
        "python": platform.python_version(),
        "packages": package_versions(NUMERICAL),
        "system": platform.system(),
        "machine": platform.machine(),
        "c_library": " ".join(platform.libc_ver()).strip(),
        "cpu_features": [*simd.get("baseline", []), *simd.get("found", [])],
        "kernels": {name: os.environ[name] for name in KERNEL_VARIABLES if os.environ.get(name)},
    }


def package_versions(names: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Return the versions of installed distributions; those not installed are left out."""
    versions = {}
    for name in names:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions
