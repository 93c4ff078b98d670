"""Where the Hill frame of the plant ``proximity`` stands in the Solar System."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.model.bodies import OrbitingBody
from hillsphere.model.ephemeris import hill_axes, states_of_elements

__all__ = ["frame_at"]


def frame_at(t_s: Array, body: OrbitingBody, p: Mapping[str, Array | float]) -> dict[str, Array]:
    """Return the asteroid's heliocentric state, and the axes of the Hill frame there.

    Parameters
    ----------
    t_s : ndarray, shape (N,)
        Times, s.
    body : OrbitingBody
        Gives inclination, node and argument of periapsis; one that is left out counts as zero.
    p : mapping of str to ndarray, shape (N,), or float
        ``primary_gm``, ``semi_major_axis``, ``eccentricity`` and ``true_anomaly`` at time 0, SI.

    Returns
    -------
    dict of str to ndarray
        ``"origin"``, shape (6, N), m and m/s; ``"axes"``, (3, 3, N), columns in the axes of the
        heliocentric states; ``"rate"``, (3, N), angular velocity in the frame's own axes, rad/s.
    """
    gm, a, e, start = (
        np.broadcast_to(np.asarray(p[key], dtype=float), t_s.shape)
        for key in ("primary_gm", "semi_major_axis", "eccentricity", "true_anomaly")
    )
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    eccentric = start - 2.0 * np.arctan2(beta * np.sin(start), 1.0 + beta * np.cos(start))
    mean = eccentric - e * np.sin(eccentric) + np.sqrt(gm / a**3) * t_s
    angles = [
        np.full(t_s.shape, angle or 0.0)
        for angle in (body.inclination_rad, body.node_rad, body.periapsis_rad)
    ]
    origin = states_of_elements(np.array([a, e, *angles, mean]), gm)
    axes, rate = hill_axes(origin)
    return {"origin": origin, "axes": axes, "rate": rate}
