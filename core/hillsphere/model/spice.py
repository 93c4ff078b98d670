"""Ephemerides from SPICE kernels, read through spiceypy (the extra ``spice``).

References
----------
.. [1] Acton, C. H., Ancillary data services of NASA's Navigation and Ancillary Information
   Facility, Planetary and Space Science 44, 1996.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import J2000, Epoch
from hillsphere.model.spice_calls import run_spice
from hillsphere.model.spice_kernel import checked_kernel

if TYPE_CHECKING:
    from hillsphere.model.ephemeris_specs import SpiceOrbitSpec

__all__ = ["SpiceOrbit"]

_LIMIT_S = 60.0
"""Time limit for the start of SPICE, which takes 1 s; a machine under load may be fifty times
slower."""
_LIMIT_PER_TIME_S = 1e-3
"""Further time limit for each state, which takes some 20 µs, with the same margin."""


class SpiceOrbit:
    """A body whose states are read from a kernel; an `hillsphere.model.ephemeris.Ephemeris`.

    Each call of `states` reads the kernel in a separate process: see
    `hillsphere.model.spice_process`.

    Parameters
    ----------
    spec : SpiceOrbitSpec
        Its parameters, with the absolute path of the kernel.
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
            Origin of the times; by default J2000.

        Returns
        -------
        ndarray, shape (6, N)
            Geometric states relative to the centre, m and m/s.

        Raises
        ------
        InputError
            If spiceypy is not installed, or the kernel does not hold the body, cover a time, or
            lead from the centre to the body, or is damaged.
        """
        start = 0.0 if epoch is None else epoch.to("TDB").seconds_since(J2000)
        t = start + np.atleast_1d(np.asarray(t_s, dtype=float))
        name = repr(Path(self.kernel).name)
        answered, states = self._asked(t)
        if text := answered.get("text"):
            raise InputError(
                {
                    "kernel": f"{self.kernel!r} cannot be read as a SPICE kernel: {text}",
                    "body": f"SPICE knows no body {self.target!r}; give its NAIF number, such as "
                    "'20099942'",
                    "coverage": f"{name} is no SPK kernel: {text}",
                    "states": f"kernel {name} does not lead from {self.centre!r} to "
                    f"{self.target!r}: {text}",
                }[answered["fault"]]
            )
        spans = answered["spans"]
        if not spans:
            raise InputError(
                f"kernel {name} does not hold the body {self.target!r}; it holds "
                f"{', '.join(map(str, answered['bodies'])) or 'none'}"
            )
        held = np.zeros(t.shape, dtype=bool)
        for begin, end in spans:
            held |= (t >= begin) & (t <= end)
        if not held.all():
            at = J2000.isot(t[~held][:1], 0)[0]
            covered = "; ".join(" to ".join(J2000.isot(np.array(s), 0)) for s in spans)
            raise InputError(
                f"kernel {name} does not cover {at} TDB for the body {self.target!r}; it covers "
                f"{covered}"
            )
        if states.size != 6 * t.size or not np.isfinite(states).all():
            raise InputError(f"kernel {name} is damaged: it gives states that are no numbers")
        return np.ascontiguousarray(1e3 * states.reshape(-1, 6).T)

    def _asked(self, t: Array) -> tuple[dict[str, Any], Array]:
        """Read states in a separate process; return its answer and the states, km and km/s."""
        with checked_kernel(self.kernel) as (kernel, held):
            answered, states = run_spice(
                "hillsphere.model.spice_process",
                {"kernel": kernel, "target": self.target, "centre": self.centre},
                t.tobytes(), file=f"kernel {Path(self.kernel).name!r}",
                user="a body of type 'spice'", limit_s=_LIMIT_S + _LIMIT_PER_TIME_S * t.size,
                descriptors=held,
            )  # fmt: skip
        return answered, np.frombuffer(states, dtype=float)
