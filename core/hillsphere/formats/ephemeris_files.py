"""Ephemeris files as sources of states: by object, and in axes of the ICRF where they are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import J2000_JD
from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.regular_files import read_text
from hillsphere.base.time import Epoch
from hillsphere.formats.oem import read_oem
from hillsphere.formats.oem_segments import OemSegment
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.model.spk import is_daf, read_spk

__all__ = [
    "common_axes",
    "eme2000_to_icrf",
    "object_segments",
    "read_message",
    "refuse_kernels",
    "segments_of_object",
]

_ICRF = re.compile(r"(ICRF|GCRF)\d?")
_LARGEST_FILE = 200_000_000
"""Bytes of a message at most: a million states take 150 MB."""


def read_message(path: Path) -> str:
    """Return the text of a message.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    try:
        return read_text(path, "utf-8-sig", _LARGEST_FILE)
    except OSError as error:
        raise InputError(f"{path.name}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name}: not a text file: {error}") from error


def segments_of_object(
    path: Path,
    name: str = "",
    *,
    lenient: bool = False,
    centres: Sequence[str] = (),
    kernels: Sequence[str] = (),
) -> list[OemSegment]:
    """Return the segments of one object of an Orbit Ephemeris Message or an SPK kernel.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        Name or identifier of the object; may be empty if the file has only one.
    lenient : bool
        Whether harmless departures of a message from the standard become warnings of the segments.
    centres, kernels
        Of a kernel: as for `hillsphere.model.spk.read_spk`.

    Raises
    ------
    InputError
        If the file cannot be read or departs from the standard, does not have the object, or needs
        no further kernels.
    """
    if is_daf(path):
        return read_spk(path, name, centres=centres, kernels=kernels)
    refuse_kernels(path, kernels)
    return object_segments(read_message(path), path.name, name, lenient=lenient)


def refuse_kernels(path: Path, kernels: Sequence[str]) -> None:
    """Refuse further kernels for a file that is none itself."""
    if kernels:
        raise InputError(
            f"{path.name}: kernels: expected none, since the file is no SPK kernel, got "
            f"{len(kernels)}"
        )


def object_segments(
    text: str, where: str, name: str = "", *, lenient: bool = False
) -> list[OemSegment]:
    """Return the segments of one object of a message; as `segments_of_object`, of its text."""
    segments = read_oem(text, where, lenient=lenient)
    names = list(dict.fromkeys(one.object_name for one in segments))
    if not name:
        if len(names) > 1:
            raise InputError(
                f"{where}: OBJECT_NAME: expected one object, got {', '.join(names)}; choose "
                "one by the key object"
            )
        return segments
    chosen = [one for one in segments if name in (one.object_name, one.object_id)]
    if not chosen:
        hint = did_you_mean(name, names, otherwise="there are")
        raise InputError(f"{where}: OBJECT_NAME: no object {name!r}{hint}")
    return chosen


def common_axes(frame: str, x: Array, wanted: str, where: str, epoch: Epoch, t_s: Array) -> Array:
    """Return states (6, K) in the inertial axes that a plant uses.

    Parameters
    ----------
    frame : str
        Frame of a message: EME2000, ICRF, GCRF or TEME.
    x : ndarray, shape (6, K)
        States in it.
    wanted : str
        ``"ICRF"``, ``"GCRF"`` or ``"TEME"``.
    where : str
        Name of the file, used in error messages.
    epoch : Epoch
        Origin of the times.
    t_s : ndarray, shape (K,)
        Times of the states, SI seconds after the epoch: TEME is that of each of them.

    Raises
    ------
    InputError
        If the frame is not converted; it is named.
    """
    name = frame.upper()
    of_date = name in ("TEME", "TEMEOFDATE")
    if of_date and wanted == "TEME":
        return x
    if not of_date:
        if name in ("EME2000", "J2000"):
            x = eme2000_to_icrf(x)
        elif not _ICRF.fullmatch(name):
            raise InputError(
                f"{where}: REF_FRAME: expected EME2000, ICRF, GCRF or TEME, got {frame}"
            )
        if wanted != "TEME":
            return x
    # both turn into the same Earth-fixed axes; UT1 and polar motion cancel but for the precession
    # in a second, 1e-11 rad
    teme, gcrs = (earth_fixed(axes, epoch, t_s) for axes in ("teme", "gcrs"))
    one, other = (gcrs, teme) if of_date else (teme, gcrs)
    return np.concatenate([np.einsum("jin,jkn,kn->in", one, other, part) for part in _halves(x)])


def eme2000_to_icrf(x: Array) -> Array:
    """Return states (6, K) in the axes of the ICRF, of states in mean equator and equinox of J2000.

    References
    ----------
    .. [1] IERS Conventions (2010), IERS Technical Note 36, section 5.3.2 (frame bias).
    """
    bias = erfa.bp06(J2000_JD, 0.0)[0]
    return np.concatenate([bias.T @ part for part in _halves(x)])


def _halves(x: Array) -> Sequence[Array]:
    return x[:3], x[3:6]
