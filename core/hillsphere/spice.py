"""Where bodies are by SPICE kernels, read through spiceypy (the extra ``spice``).

References
----------
.. [1] Acton, C. H., Ancillary data services of NASA's Navigation and Ancillary Information
   Facility, Planetary and Space Science 44, 1996.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.spice_kernel import checked_kernel
from hillsphere.time import J2000, Epoch

if TYPE_CHECKING:
    from hillsphere.ephemeris_specs import SpiceOrbitSpec

__all__ = ["SpiceOrbit"]


class SpiceOrbit:
    """A body whose states are read from a kernel; an `hillsphere.ephemeris.Ephemeris`.

    The kernel is first read when states are asked for, and is in SPICE's pool only while it is
    read, so that two missions in one process never see each other's.

    Parameters
    ----------
    spec : SpiceOrbitSpec
        With the path of its kernel resolved.
    """

    def __init__(self, spec: SpiceOrbitSpec) -> None:
        self.name = spec.name
        self.kernel, self.target, self.centre = spec.kernel, spec.target, spec.centre

    def states(self, t_s: Array, epoch: Epoch | None = None) -> Array:
        """Return the states (6, N) at times (N,), in the axes of ecliptic and equinox J2000.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            Seconds after the epoch.
        epoch : Epoch, optional
            From which they count; left out: J2000.

        Returns
        -------
        ndarray, shape (6, N)
            Geometric, from the centre, m and m/s.

        Raises
        ------
        InputError
            If spiceypy is not installed, or the kernel does not hold the body, cover a time, or
            lead from the centre to the body.
        """
        start = 0.0 if epoch is None else epoch.to("TDB").seconds_since(J2000)
        t = start + np.atleast_1d(np.asarray(t_s, dtype=float))
        held = np.zeros(t.shape, dtype=bool)
        for begin, end in self._spans:
            held |= (t >= begin) & (t <= end)
        if not held.all():
            at = J2000.isot(t[~held][:1], 0)[0]
            spans = "; ".join(" to ".join(J2000.isot(np.array(s), 0)) for s in self._spans)
            raise InputError(
                f"kernel {Path(self.kernel).name!r} does not cover {at} TDB for the body "
                f"{self.target!r}; it covers {spans}"
            )
        with self._loaded() as (spice, _):
            try:
                found, _ = spice.spkezr(self.target, t, "ECLIPJ2000", "NONE", self.centre)
            except spice.utils.exceptions.SpiceyError as error:
                raise InputError(
                    f"kernel {Path(self.kernel).name!r} does not lead from {self.centre!r} to "
                    f"{self.target!r}: {_first_line(error)}"
                ) from None
        return np.ascontiguousarray(1e3 * np.asarray(found, dtype=float).T)

    @cached_property
    def _spans(self) -> list[tuple[float, float]]:
        """Return the intervals that the kernel holds, s after J2000 TDB."""
        with self._loaded() as (spice, kernel):
            return self._coverage(spice, kernel, self._known(spice))

    @contextmanager
    def _loaded(self) -> Iterator[tuple[Any, str]]:
        spice = _spiceypy()
        with checked_kernel(self.kernel) as kernel:
            try:
                spice.furnsh(kernel)
            except spice.utils.exceptions.SpiceyError as error:
                raise InputError(
                    f"{self.kernel!r} cannot be read as a SPICE kernel: {_first_line(error)}"
                ) from None
            try:
                yield spice, kernel
            finally:
                spice.unload(kernel)

    def _known(self, spice: Any) -> int:
        try:
            return int(spice.bods2c(self.target))
        except spice.utils.exceptions.SpiceyError:
            raise InputError(
                f"SPICE knows no body {self.target!r}; give its NAIF number, such as '20099942'"
            ) from None

    def _coverage(self, spice: Any, kernel: str, number: int) -> list[tuple[float, float]]:
        """Return the intervals that the kernel holds, s after J2000 TDB."""
        try:
            window = spice.spkcov(kernel, number)
            intervals = [spice.wnfetd(window, i) for i in range(spice.wncard(window))]
            bodies = sorted(int(i) for i in spice.spkobj(kernel))
        except spice.utils.exceptions.SpiceyError as error:
            raise InputError(
                f"{Path(self.kernel).name!r} is no SPK kernel: {_first_line(error)}"
            ) from None
        if not intervals:
            raise InputError(
                f"kernel {Path(self.kernel).name!r} does not hold the body {self.target!r}; it "
                f"holds {', '.join(map(str, bodies))}"
            )
        return [(float(a), float(b)) for a, b in intervals]


def _spiceypy() -> Any:
    try:
        _choose_library()
        import spiceypy
    except ImportError:
        raise InputError(
            "a body of type 'spice' needs spiceypy, which is not installed: "
            "pip install 'hillsphere[spice]'"
        ) from None
    return spiceypy


def _choose_library() -> None:
    """Let spiceypy load the library that came with it, or that of the Python environment.

    Left alone it looks for ``libcspice.so`` in the working directory first, which may be that of a
    mission of somebody else's, and would run what it finds there.
    """
    if os.environ.get("CSPICE_SHARED_LIB") or "spiceypy" in sys.modules:
        return
    spec = importlib.util.find_spec("spiceypy")
    if spec is None:
        return  # the import says so
    places = [Path(place) / "utils" for place in spec.submodule_search_locations or ()]
    places += [Path(sys.prefix) / "lib", Path(sys.prefix) / "Library" / "bin"]  # as conda has it
    names = ("libcspice.so", "libcspice.dylib", "libcspice.dll", "cspice.dll")
    for path in (place / name for place in places for name in names):
        if path.is_file():
            os.environ["CSPICE_SHARED_LIB"] = str(path)
            return
    raise InputError(
        "spiceypy has no CSPICE library beside it; set CSPICE_SHARED_LIB to the path of yours"
    )


def _first_line(error: Exception) -> str:
    """Return what SPICE says of an error, without its banner."""
    lines = [line.strip(" =") for line in str(error).splitlines()]
    return next((line for line in lines if line and "Toolkit version" not in line), "no reason")
