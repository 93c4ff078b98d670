"""Ephemerides from SPICE kernels, read through spiceypy (the extra ``spice``).

References
----------
.. [1] Acton, C. H., Ancillary data services of NASA's Navigation and Ancillary Information
   Facility, Planetary and Space Science 44, 1996.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import J2000, Epoch
from hillsphere.model.spice_kernel import checked_kernel

if TYPE_CHECKING:
    from hillsphere.model.ephemeris_specs import SpiceOrbitSpec

__all__ = ["SpiceOrbit", "spice_environment"]

_LIMIT_S = 60.0
"""Time limit for the start of SPICE, which takes 1 s; a machine under load may be fifty times
slower."""
_LIMIT_PER_TIME_S = 1e-3
"""Further time limit for each state, which takes some 20 µs, with the same margin."""

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from hillsphere.model.spice_process import main; main()"
)


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
        environment = spice_environment("a body of type 'spice'")
        with checked_kernel(self.kernel) as (kernel, held):
            asked = {"kernel": kernel, "target": self.target, "centre": self.centre}
            limit_s = _LIMIT_S + _LIMIT_PER_TIME_S * t.size
            damaged = f"kernel {Path(self.kernel).name!r} is damaged: "
            try:
                done = subprocess.run(
                    [sys.executable, "-P", "-c", _START, json.dumps(sys.path)],
                    input=json.dumps(asked).encode() + b"\n" + t.tobytes(),
                    capture_output=True, timeout=limit_s, pass_fds=held, env=environment,
                    check=False,
                )  # fmt: skip
            except subprocess.TimeoutExpired:
                raise InputError(
                    f"{damaged}SPICE did not come to an end in {limit_s:.0f} s"
                ) from None
            if done.returncode < 0:
                raise InputError(f"{damaged}SPICE ended at it with signal {-done.returncode}")
            line, _, states = done.stdout.partition(b"\n")
            if done.returncode or not line:
                said = done.stderr.decode("utf-8", "replace").strip().splitlines()
                raise InputError(
                    f"kernel {Path(self.kernel).name!r} cannot be read with SPICE: "
                    f"{said[-1] if said else f'exit code {done.returncode}'}"
                )
            return json.loads(line), np.frombuffer(states, dtype=float)


def spice_environment(what: str) -> dict[str, str]:
    """Return the environment of a process that uses spiceypy.

    Parameters
    ----------
    what : str
        What needs it, for the message.

    Raises
    ------
    InputError
        If spiceypy is not installed, or has no CSPICE library.
    """
    if importlib.util.find_spec("spiceypy") is None:
        raise InputError(
            f"{what} needs spiceypy, which is not installed: pip install 'hillsphere[spice]'"
        )
    library = os.environ.get("CSPICE_SHARED_LIB") or _library()
    return {**os.environ, "CSPICE_SHARED_LIB": library}


def _library() -> str:
    """Return the CSPICE library of spiceypy, or that of the Python environment.

    By default spiceypy looks for ``libcspice.so`` in the working directory first. That may be the
    directory of another user's mission, whose code would be executed.
    """
    spec = importlib.util.find_spec("spiceypy")
    directories = (spec.submodule_search_locations if spec else None) or ()
    places = [Path(place) / "utils" for place in directories]
    places += [Path(sys.prefix) / "lib", Path(sys.prefix) / "Library" / "bin"]  # as conda has it
    names = ("libcspice.so", "libcspice.dylib", "libcspice.dll", "cspice.dll")
    for path in (place / name for place in places for name in names):
        if path.is_file():
            return str(path)
    raise InputError(
        "spiceypy has no CSPICE library beside it; set CSPICE_SHARED_LIB to the path of yours"
    )
