"""Processes that use SPICE through spiceypy (the extra ``spice``).

CSPICE does not check a file's content. Some damaged files make it read beyond its arrays, which
ends the process, or loop for ever; a separate process protects the run from both. Nothing that it
loads stays loaded.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hillsphere.base.errors import InputError

__all__ = ["run_spice", "spice_environment"]

_START = (
    "import importlib, json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "importlib.import_module(sys.argv[2]).main()"
)


def run_spice(
    module: str,
    request: Mapping[str, Any],
    content: bytes = b"",
    *,
    file: str,
    user: str,
    limit_s: float,
    descriptors: Sequence[int] = (),
) -> tuple[dict[str, Any], bytes]:
    """Run the function ``main`` of a module in a process of its own.

    The request is a line of JSON on its stdin, followed by bytes; the answer on its stdout is of
    the same form.

    Parameters
    ----------
    module : str
        Name of the module.
    request : mapping
        What is asked, as JSON can hold it.
    content : bytes
        What follows the request.
    file : str
        The file that is read or written, for messages: ``"kernel 'a.bsp'"``.
    user : str
        What needs spiceypy, for messages.
    limit_s : float
        Time limit.
    descriptors : sequence of int
        Open files that the process inherits.

    Returns
    -------
    dict
        The line of the answer.
    bytes
        What follows it.

    Raises
    ------
    InputError
        If spiceypy is not installed, or SPICE does not end in time, ends with a signal or an
        error.
    """
    environment = spice_environment(user)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _START, json.dumps(sys.path), module],
            input=json.dumps(request).encode() + b"\n" + content,
            capture_output=True, timeout=limit_s, pass_fds=descriptors, env=environment,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise InputError(
            f"{file} is damaged: SPICE did not come to an end in {limit_s:.0f} s"
        ) from None
    if done.returncode < 0:
        raise InputError(f"{file} is damaged: SPICE ended at it with signal {-done.returncode}")
    line, _, answer = done.stdout.partition(b"\n")
    if done.returncode or not line:
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise InputError(
            f"{file} cannot be read with SPICE: "
            f"{said[-1] if said else f'exit code {done.returncode}'}"
        )
    return json.loads(line), answer


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
