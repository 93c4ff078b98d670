"""Initial states, with their covariance, from files: OPM, OEM, TLE, OMM, or SPK of SPICE.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 3 (OPM) and 5 (OEM).
.. [2] SANA registry "Orbit-Relative Reference Frames": RTN (RSW) and TNW.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError, PluginError, PropagationError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import J2000, Epoch
from hillsphere.formats.ephemeris_files import (
    common_axes,
    object_segments,
    read_message,
    refuse_kernels,
    segments_of_object,
)
from hillsphere.formats.oem_interpolation import interpolant_of, segment_at
from hillsphere.formats.oem_segments import OemSegment
from hillsphere.formats.opm import read_opm
from hillsphere.interfaces.file_formats import ElementFormat, StatedOrbit
from hillsphere.model.frame_motion import FrameMotion, frame_motion
from hillsphere.model.spk import is_daf
from hillsphere.plugins.registry import default_registry

__all__ = ["MessageStart", "epoch_of_message", "start_of_message"]

_SAME_S = 1.0
"""Dates of one start may differ by this, s, as those of a start in axes of the stars."""
_BEGINNING = 1 << 16
"""Characters by which a format is told; titles and comments before elements are shorter."""
_RADIAL = ("RTN", "RSW", "RTN_INERTIAL", "RSW_INERTIAL")
_TANGENTIAL = ("TNW", "TNW_INERTIAL")


@dataclass(frozen=True, eq=False)
class MessageStart:
    """An initial state in the frame of a plant.

    Parameters
    ----------
    x : ndarray, shape (6,)
        Position, m, and velocity, m/s.
    covariance : ndarray, shape (6, 6), or None
        Their covariance, if the message states one at this time.
    epoch : Epoch
        Instant of the state.
    """

    x: Array
    covariance: Array | None
    epoch: Epoch


@dataclass(frozen=True, eq=False)
class _Stated:
    """What a message states: inertial state (6,), covariance and its frame, origin and axes."""

    x: Array
    epoch: Epoch
    centre: str
    frame: str
    covariance: Array | None
    covariance_frame: str


def start_of_message(
    path: Path | str,
    plant: object,
    *,
    name: str = "",
    epoch: str | Epoch = "",
    others: Mapping[str, float] | None = None,
    time_s: float = 0.0,
    lenient: bool = False,
    kernels: Sequence[str] = (),
) -> MessageStart:
    r"""Return the state of a file in the frame of a plant.

    With the axes A of the frame and its angular velocity ω, the covariance is
    :math:`J P J^T`, :math:`J = ((A^T, 0), (-[\omega\times] A^T, A^T))`.

    Parameters
    ----------
    path : Path or str
        Orbit Parameter Message, Orbit Ephemeris Message, SPK kernel, or elements for SGP4:
        two-line element sets or Orbit Mean-Elements Messages.
    plant : object
        Equations of motion in whose frame the state is wanted.
    name : str
        Object of an ephemeris or of elements; by default the only one.
    epoch : str or Epoch
        Date and time (TDB) of the state of an ephemeris or of elements; by default the first
        useable state of an ephemeris, and the epoch of the elements.
    others : mapping of str to float
        States of the plant that are neither position nor velocity, at the start, SI.
    time_s : float
        Time of the start on the plant's clock.
    lenient : bool
        Whether harmless departures of a message from the standard are warnings, not errors; they
        are given as Python warnings.
    kernels : sequence of str
        Further kernels, see `hillsphere.model.spk.read_spk`.

    Raises
    ------
    InputError
        If the message cannot be read, is about a body or in a frame that the plant does not know,
        or the plant does not know its frame among the stars; the key or keyword is named.
    """
    path = Path(path)
    kernel = is_daf(path)
    centres: Sequence[str] = ()
    if kernel:
        values = {key: np.array([value]) for key, value in (others or {}).items()}
        centres = list(frame_motion(plant, J2000, np.zeros(1), values).centres)
    else:
        refuse_kernels(path, kernels)
    stated = (
        _of_ephemeris(
            segments_of_object(path, name, centres=centres, kernels=kernels), _instant(epoch)
        )
        if kernel
        else _read(path, name, epoch, lenient=lenient)
    )
    motion = _motion(stated, plant, others or {}, time_s)
    if stated.centre.lower() not in [one.lower() for one in motion.centres]:
        raise InputError(
            f"{path.name}: CENTER_NAME: expected {' or '.join(map(str.upper, motion.centres))}, "
            f"which the plant knows, got {stated.centre}"
        )
    inertial = _in_axes(stated, stated.frame, stated.x[:, None], motion.axes_name, path.name)
    x = motion.from_inertial(inertial, stated.centre)[:, 0]
    covariance = None
    if stated.covariance is not None:
        turn = _to_frame(stated, motion.axes_name, path.name) @ motion.axes[:, :, 0]
        rate = motion.rate[:, 0]
        cross = np.array(
            [[0.0, -rate[2], rate[1]], [rate[2], 0.0, -rate[0]], [-rate[1], rate[0], 0.0]]
        )
        jacobian = np.block([[turn.T, np.zeros((3, 3))], [-cross @ turn.T, turn.T]])
        covariance = jacobian @ stated.covariance @ jacobian.T
    return MessageStart(x, covariance, stated.epoch)


def epoch_of_message(
    path: Path | str,
    *,
    name: str = "",
    epoch: str | Epoch = "",
    lenient: bool = False,
    kernels: Sequence[str] = (),
) -> Epoch:
    """Return the instant of the state of a message; arguments and errors as `start_of_message`."""
    if is_daf(Path(path)):
        segments = segments_of_object(Path(path), name, kernels=kernels)
        return _of_ephemeris(segments, _instant(epoch)).epoch
    return _read(Path(path), name, epoch, lenient=lenient).epoch


def _motion(
    stated: _Stated, plant: object, others: Mapping[str, float], time_s: float
) -> FrameMotion:
    """Return the plant's frame at the instant of a state, which must be that of its clock."""
    own = getattr(plant, "epoch", None)
    zero = own if isinstance(own, Epoch) or own is None else Epoch.parse(str(own), "TDB")
    if zero is not None and abs(stated.epoch.seconds_since(zero) - time_s) > _SAME_S:
        since = stated.epoch.seconds_since(zero)
        raise InputError(
            f"start.time: expected {since:.6f} s, the time of the message's state on the plant's "
            f"clock, got {time_s!r} s"
        )
    values = {name: np.array([value]) for name, value in others.items()}
    return frame_motion(plant, stated.epoch.after(-time_s), np.array([time_s]), values)


def _instant(epoch: str | Epoch) -> str | Epoch:
    """Return the epoch that a text gives; an empty one stays as it is."""
    return Epoch.parse(epoch, "TDB") if isinstance(epoch, str) and epoch else epoch


def _read(path: Path, name: str, epoch: str | Epoch, *, lenient: bool) -> _Stated:
    text = read_message(path)
    when = _instant(epoch)
    if "CCSDS_OPM_VERS" in text or re.search(r"<(\w+:)?opm\b", text):
        opm = read_opm(text, path.name, lenient=lenient)
        for warning in opm.warnings:
            warnings.warn(warning, stacklevel=2)
        if isinstance(when, Epoch) and abs(opm.epoch.seconds_since(when)) > _SAME_S:
            raise InputError(
                f"epoch: expected none, {path.name} is an OPM and has one state, of "
                f"{opm.epoch.isot(np.zeros(1), 3)[0]} {opm.epoch.scale}"
            )
        return _Stated(
            opm.x, opm.epoch, opm.center_name, opm.frame, opm.covariance,
            opm.covariance_frame or opm.frame,
        )  # fmt: skip
    if orbits := _orbits(path, text):
        return _of_elements(_one_orbit(orbits, name, path.name), when, path.name)
    return _of_ephemeris(object_segments(text, path.name, name, lenient=lenient), when)


def _of_ephemeris(segments: Sequence[OemSegment], when: str | Epoch) -> _Stated:
    """Return the state of an ephemeris at an instant, or its first one; tell what was noticed."""
    if isinstance(when, Epoch):
        segment = segment_at(segments, when)
        t = when.seconds_since(segment.epoch)
    else:
        segment = segments[0]
        t = interpolant_of(segment).span_s[0]
    for warning in segment.warnings:
        warnings.warn(warning, stacklevel=2)
    covariance, frame = None, segment.ref_frame
    for one in segment.covariances:
        if abs(one.t_s - t) <= _SAME_S * 1e-6:
            covariance, frame = one.matrix, one.ref_frame or segment.ref_frame
    x = interpolant_of(segment)(t)[:, 0]
    instant = segment.epoch.after(t)
    return _Stated(x, instant, segment.center_name, segment.ref_frame, covariance, frame)


def _orbits(path: Path, text: str) -> Sequence[StatedOrbit]:
    """Return the orbits of a file of elements by the formats of plugins; none of other files."""
    for record in default_registry().of_kind("format"):
        try:
            one = record.load_target()(record.load_spec()())
        except PluginError:  # another format may read it
            continue
        if isinstance(one, ElementFormat) and one.recognises(text[:_BEGINNING]):
            return one.orbits(one.read(path)[0])
    return ()


def _one_orbit(orbits: Sequence[StatedOrbit], name: str, where: str) -> StatedOrbit:
    """Return the orbit of a name or number, or the only one."""
    names = [one.name for one in orbits]
    chosen = [one for one in orbits if not name or name in (one.name, one.catalogue_number)]
    if len(chosen) == 1:
        return chosen[0]
    if not chosen:
        hint = did_you_mean(name, names, otherwise="there are")
        raise InputError(f"{where}: no satellite {name!r}{hint}")
    raise InputError(
        f"{where}: expected one satellite, got {', '.join(names[:5])}; choose one by the key "
        "object, by name or number"
    )


def _of_elements(orbit: StatedOrbit, when: str | Epoch, where: str) -> _Stated:
    """Return the osculating state of mean elements."""
    instant = when if isinstance(when, Epoch) else orbit.epoch
    try:
        x = orbit.states(np.array([instant.seconds_since(orbit.epoch)]))[:, 0]
    except PropagationError as error:
        raise InputError(f"{where}: {error}") from error
    return _Stated(x, instant, "EARTH", "TEME" if orbit.frame == "teme" else "GCRF", None, "")


def _in_axes(stated: _Stated, frame: str, x: Array, axes_name: str, where: str) -> Array:
    """Return vectors (6, K) at the instant of a state in the inertial axes of a plant."""
    return common_axes(frame, x, axes_name, where, stated.epoch, np.zeros(x.shape[1]))


def _to_frame(stated: _Stated, axes_name: str, where: str) -> Array:
    """Return the matrix (3, 3) from the plant's inertial axes to those of the covariance [2]_."""
    frame = stated.covariance_frame.upper()
    if frame in _RADIAL or frame in _TANGENTIAL:
        state = _in_axes(stated, stated.frame, stated.x[:, None], axes_name, where)[:, 0]
        r, v = state[:3], state[3:]
        normal = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
        first = (r if frame in _RADIAL else v) / np.linalg.norm(r if frame in _RADIAL else v)
        return np.array([first, np.cross(normal, first), normal])
    columns = _in_axes(
        stated, stated.covariance_frame, np.tile(np.eye(3), (2, 1)), axes_name, where
    )
    return np.asarray(columns[:3].T)
