"""Where the two families of a vertical bifurcation start: the kernel and its symmetries.

At a vertical bifurcation d:n the vertical motion along n revolutions of the planar orbit is
periodic whatever its phase φ: that is the kernel of the n-revolution map, a plane. The equations'
symmetries turn and mirror the phase: a whole revolution by 2π d/n, the mirror plane of the orbits
(z → −z) by π, half a revolution by half a revolution's phase if the equations also keep the mirror
plane yz, and the time reversal takes φ to −φ. Families branch off where one of the time reversals
holds φ: on two classes of axes, alternately, a family each [1]_. With G turns in all the axes are
π/G apart.

Which class a start belongs to follows from its phase. Starting on the plane xz with z ≠ 0
("position") and on the x axis with ż ≠ 0 ("velocity") belong to different classes for odd n; for
even n they may be one family, seen some revolutions later, and the other one starts on the plane
xz on the near side of the body, or on the plane yz.

References
----------
.. [1] Golubitsky, M., Stewart, I., Schaeffer, D. G., Singularities and Groups in Bifurcation
   Theory, volume 2, Springer, 1988, chapter XIII (dihedral symmetry).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.flow import XY_MIRROR, Z_HALF_TURN, Flow
from hillsphere_orbits.spatial_qso_families.shooting import MIRRORS

__all__ = ["Start", "starts_of", "symmetries_of"]

_INVERSION = (-1, -1, -1, -1, -1, -1)
"""Signs of the states under inversion, the product of the mirror xy and the half turn about z."""
_SAME = 0.05  # of the angle between axes: a start is on an axis to rounding, or the plane is wrong


@dataclass(frozen=True)
class Start:
    """Where a family of a bifurcation starts.

    Parameters
    ----------
    mirror : str
        Key of `MIRRORS`.
    x : ndarray, shape (6,)
        The planar orbit's state there, normalised.
    of_position : bool
        Whether this is the family that starts with z ≠ 0 and ż = 0 at x > 0.
    """

    mirror: str
    x: Array
    of_position: bool


def symmetries_of(flow: Flow, samples: Array) -> tuple[tuple[int, ...], ...]:
    """Return the spatial symmetries (signs of the six states) that the equations keep.

    Parameters
    ----------
    flow : Flow
        States x, y, z, vx, vy, vz.
    samples : ndarray, shape (6, K)
        States at which they are tried.

    Raises
    ------
    InputError
        If the equations do not keep the mirrors xy and, reversing time, xz: there are no such
        families then.
    """
    if not flow.keeps(XY_MIRROR, samples, reverses_time=False) or not flow.keeps(
        MIRRORS["position"], samples, reverses_time=True
    ):
        raise InputError(
            "families in space need equations that keep the mirror planes xy and xz; this plant's "
            "gravity does not (harmonics with S terms or of odd degree minus order, a tilted body)"
        )
    if flow.keeps(MIRRORS["y_position"], samples, reverses_time=True):
        return (XY_MIRROR, Z_HALF_TURN, _INVERSION)
    return (XY_MIRROR,)


def starts_of(
    flow: Flow, x: Array, period: float, d: int, n: int, *, doubly: bool
) -> dict[str, Start]:
    """Return the starts "position", "velocity" and "companion" at a bifurcation.

    Parameters
    ----------
    flow : Flow
        With the state transition matrix.
    x : ndarray, shape (6,)
        The planar orbit on its perpendicular crossing of the x axis, normalised.
    period : float
        Of one revolution.
    d, n : int
        Resonance.
    doubly : bool
        Whether the equations keep the mirror plane yz too.

    Returns
    -------
    dict
        "companion" is always the family that "position" is not.
    """
    times = np.array([0.0, 0.25, 0.5, 1.0]) * period
    start = np.repeat(x[:, None], 4, axis=1)
    places, phi = flow.with_matrix(start, times, flow.steps_for(start, times))
    # displacement and velocity along z, in coordinates in which a revolution is a rotation
    # planar orbit: the motion along z is linear and separate, a 2 × 2 matrix
    vertical = phi[np.ix_([2, 5], [2, 5])]
    # scales z so that the matrix of one revolution becomes a rotation by 2π d/n
    stretch = np.sqrt(np.abs(vertical[1, 0, 3] / vertical[0, 1, 3]))

    def phase(row: int, place: int) -> float:
        """Return the phase at x of the motion that has only z, or only ż, at a later place."""
        z, vz = np.linalg.solve(vertical[:, :, place], np.eye(2)[row])
        return float(np.arctan2(vz, stretch * z))

    # number of symmetry axes on the circle of phases, by the order of the dihedral group [1]
    turns = 2 * n if doubly or n % 2 else n
    candidates = [
        ("velocity", 0, phase(1, 0)),
        ("position", 2, phase(0, 2)),
        *([("y_position", 1, phase(0, 1))] if doubly else []),
    ]
    first = Start("position", x, True)
    starts = {"position": first}
    for mirror, place, angle in candidates:
        # the axes are π/turns apart; the even ones are those of "position"
        axis = angle * turns / np.pi
        nearest = round(axis)
        if abs(axis - nearest) > _SAME:
            raise InputError(
                f"bifurcation {d}:{n} at x = {x[0]:.6g} natural units: the vertical motion is not "
                f"that of a symmetric orbit (phase {angle:.6g} rad); it is none of these equations"
            )
        made = Start(mirror, places[:, place], nearest % 2 == 0)
        if mirror == "velocity":
            starts["velocity"] = made
        if not made.of_position:
            starts.setdefault("companion", made)
    if "companion" not in starts:
        raise InputError(
            f"bifurcation {d}:{n} at x = {x[0]:.6g} natural units: the second family has no start "
            "on a mirror of these equations"
        )
    return starts
