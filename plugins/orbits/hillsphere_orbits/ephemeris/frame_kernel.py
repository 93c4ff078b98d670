"""Frame kernels of SPICE (text): names and numbers of bodies, and the rotating frame of a plant.

References
----------
.. [1] NAIF, "Frames Required Reading": parameterized dynamic frames of the family Euler.
.. [2] NAIF, "NAIF Integer ID Codes": numbers of bodies defined in a text kernel.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, hypot, tau

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.model.frame_motion import FrameMotion, turn_about_z

__all__ = ["TurningAxes", "frame_kernel", "turning_axes"]

_SAME_RAD = 1e-9
"""Angle, rad, by which axes may differ from a uniform rotation: 0.1 mm at 100 km."""
_FIRST_FRAME, _FRAMES = 1_400_000, 600_000
"""First number, and how many there are, of frames that NAIF leaves to everyone [1]_."""


@dataclass(frozen=True, eq=False)
class TurningAxes:
    """Axes that turn uniformly about their z.

    Parameters
    ----------
    axes : ndarray, shape (3, 3)
        Axes as columns, in ICRF, at the first time.
    rate_rad_s : float
        Angular velocity about z.
    begin_s : float
        The first time, s after J2000 TDB.
    """

    axes: Array
    rate_rad_s: float
    begin_s: float


def turning_axes(motion: FrameMotion, times_s: Array) -> TurningAxes | None:
    """Return the rotation of a frame if it is uniform.

    Parameters
    ----------
    motion : FrameMotion
        The frame at K times, in ICRF or GCRF.
    times_s : ndarray, shape (K,)
        These times, s after J2000 TDB.

    Returns
    -------
    TurningAxes or None
        None if the frame turns otherwise, or is that of the ICRF.
    """
    rate = float(motion.rate[2, 0])
    turned = turn_about_z(motion.axes[:, :, 0], rate * (times_s - times_s[0]))
    if np.abs(turned - motion.axes).max() > _SAME_RAD:
        return None
    if not rate and np.array_equal(motion.axes[:, :, 0], np.eye(3)):
        return None
    return TurningAxes(motion.axes[:, :, 0], rate, float(times_s[0]))


def frame_kernel(
    title: str,
    told: Sequence[str],
    bodies: Sequence[tuple[str, int]],
    centre_code: int,
    frame: str = "",
    axes: TurningAxes | None = None,
) -> str:
    r"""Return a frame kernel.

    The axes A (columns, ICRF) are :math:`R_z(a) R_x(b) R_z(c + \omega t)`; SPICE's angles turn the
    coordinates, hence the negative signs.

    Parameters
    ----------
    title : str
        First line of the text.
    told : sequence of str
        Further paragraphs.
    bodies : sequence of (str, int)
        Names and numbers that SPICE is to know.
    centre_code : int
        Number of the centre of the frame.
    frame : str
        Name of the frame.
    axes : TurningAxes, optional
        The frame; by default none is defined.

    Returns
    -------
    str
        The kernel.
    """
    paragraphs = [title, *told]
    lines = ["KPL/FK", ""]
    for paragraph in paragraphs:
        lines += [*textwrap.wrap(paragraph, 76), ""]
    lines += ["\\begindata", ""]
    for name, code in bodies:
        quoted = name.replace("'", "''")
        lines += [f"NAIF_BODY_NAME += ( '{quoted}' )", f"NAIF_BODY_CODE += ( {code} )", ""]
    if axes is not None:
        number = _FIRST_FRAME + centre_code % _FRAMES
        called = re.sub(r"[^A-Z0-9]+", "_", frame.upper()).strip("_")[:26]
        node = atan2(axes.axes[0, 2], -axes.axes[1, 2])
        tilt = atan2(hypot(axes.axes[0, 2], axes.axes[1, 2]), axes.axes[2, 2])
        turn = atan2(axes.axes[2, 0], axes.axes[2, 1])
        if tilt < 1e-12:  # the axes of the ICRF turned about their z: node and turn are one angle
            node, turn = 0.0, atan2(axes.axes[1, 0], axes.axes[0, 0])
        # the angle at a whole second, to which the number of the epoch is exact
        epoch = float(np.floor(axes.begin_s))
        turn -= axes.rate_rad_s * (axes.begin_s - epoch)
        pairs = {
            "NAME": f"'{called}'", "CLASS": "5", "CLASS_ID": str(number),
            "CENTER": str(centre_code), "RELATIVE": "'J2000'", "DEF_STYLE": "'PARAMETERIZED'",
            "FAMILY": "'EULER'", "EPOCH": repr(epoch), "AXES": "( 3, 1, 3 )",
            "UNITS": "'RADIANS'", "ANGLE_1_COEFFS": f"( {-node!r} )",
            "ANGLE_2_COEFFS": f"( {-tilt!r} )",
            "ANGLE_3_COEFFS": f"( {-(turn % tau)!r}, {-axes.rate_rad_s!r} )",
        }  # fmt: skip
        lines.append(f"FRAME_{called} = {number}")
        lines += [f"FRAME_{number}_{key} = {value}" for key, value in pairs.items()]
        lines.append("")
    lines += ["\\begintext", ""]
    return "\n".join(lines)
