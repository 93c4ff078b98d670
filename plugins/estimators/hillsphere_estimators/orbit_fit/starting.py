"""The first guess of a fitted state, from whatever form it is given in."""

from __future__ import annotations

import warnings

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.engine.start_states import TimedFrame, place_start
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment, read_oem
from hillsphere.formats.opm import read_opm
from hillsphere.interfaces import Array, Plant
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_fit.reading import text_of
from hillsphere_estimators.orbit_fit.specs import FitStartSpec
from hillsphere_estimators.orbit_fit.surroundings import Surroundings
from hillsphere_estimators.orbit_fit.trajectory import Trajectory

__all__ = ["start_epoch", "start_state"]


def start_epoch(start: FitStartSpec) -> Epoch:
    """Return the date of the first guess.

    Raises
    ------
    InputError
        If it is no date, or its file cannot be read.
    """
    if start.epoch:
        try:
            return Epoch.parse(start.epoch, start.time_scale)
        except InputError as error:
            raise InputError(f"start.epoch: {error}") from error
    segment = _segment(start)
    tai = segment.epoch.to("TAI")
    return Epoch(tai.day, tai.fraction + float(segment.t_s[0]) / DAY_S, "TAI")


def start_state(start: FitStartSpec, plant: Plant, surroundings: Surroundings, t_s: float) -> Array:
    """Return the first guess (6,) in the plant's frame, SI.

    Parameters
    ----------
    start : FitStartSpec
        Its form.
    plant : Plant
        Gives the frame.
    surroundings : Surroundings
        Places the frame.
    t_s : float
        Its time, after the plant's epoch.

    Raises
    ------
    InputError
        If it cannot be given in the plant's frame.
    """
    if start.position_m is not None and start.velocity_m_s is not None:
        return np.array([*start.position_m, *start.velocity_m_s])
    if start.file is None:
        frame: object = plant.turning_frame(t_s) if isinstance(plant, TimedFrame) else plant
        placed = place_start(start, frame, {}, "start")
        assert placed is not None
        return np.concatenate(placed)
    segment = _segment(start)
    t = segment.epoch.seconds_since(surroundings.zero) + segment.t_s
    if abs(t[0] - t_s) < 1e-6:
        state = segment.x[:, :1]
    else:
        state = Trajectory(f"start.file: {start.file}", t, segment.x).states(np.array([t_s]))
    try:
        return surroundings.from_celestial(segment.ref_frame, state, np.array([t_s]))[:, 0]
    except InputError as error:
        raise InputError(f"start.file: {start.file}: {error}") from error


def _segment(start: FitStartSpec) -> OemSegment:
    """Return the states of a file; a parameter message is an ephemeris of one state."""
    assert start.file is not None
    text = text_of(start.file)
    if "CCSDS_OPM_VERS" in text[:1000] or "<opm" in text[:1000]:
        opm = read_opm(text, start.file, lenient=start.lenient)
        _tell(opm.warnings)
        return OemSegment(
            opm.object_name, opm.object_id, opm.center_name, opm.frame, opm.epoch,
            np.zeros(1), opm.x[:, None],
        )  # fmt: skip
    segments = read_oem(text, start.file, lenient=start.lenient)
    _tell(segments[0].warnings)
    if len(segments) != 1:
        raise InputError(f"start.file: {start.file} has {len(segments)} segments; expected one")
    return segments[0]


def _tell(noticed: tuple[str, ...]) -> None:
    """Give what a reader noticed as warnings."""
    for one in noticed:
        warnings.warn(one, stacklevel=2)
