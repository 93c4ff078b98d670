"""What the last bits of a result depend on is seen, wherever results are kept or compared."""

from __future__ import annotations

import platform

import pytest

from hillsphere.base import environment as module
from hillsphere.base.environment import environment
from hillsphere_dask import dask_workers


def test_the_c_library_and_chosen_kernels_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    found = environment.__wrapped__
    for name in module.KERNEL_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    plain = found()
    monkeypatch.setattr(dask_workers, "environment", lambda: plain)
    here = dask_workers.surroundings()
    assert plain["kernels"] == {}
    assert plain["c_library"] == " ".join(platform.libc_ver())
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Prescott")
    monkeypatch.setattr(platform, "libc_ver", lambda: ("glibc", "1.9"))
    other = found()
    assert other["kernels"] == {"OPENBLAS_CORETYPE": "Prescott"}
    assert other["c_library"] == "glibc 1.9"
    monkeypatch.setattr(dask_workers, "environment", lambda: other)
    told = " ".join(dask_workers.differences(here, dask_workers.surroundings()))
    assert "C library is glibc 1.9 there" in told
    assert "kernels chosen by variables is OPENBLAS_CORETYPE=Prescott there, none here" in told
