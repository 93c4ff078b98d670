"""True positions of the Earth and the asteroid in each geometry; lanes are geometry by geometry."""

from __future__ import annotations

from typing import Any

import numpy as np

from hillsphere.base.orientation import UT1_IS_UTC
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Scene
from hillsphere.model.bodies import OrbitingBody
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.model.ephemeris import (
    Ephemeris,
    FixedOrbit,
    KeplerOrbit,
    from_equator,
    states_of_elements,
)
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_refinement.specs import GeometrySpec

__all__ = ["earth_at", "orbit_of", "scenes_at", "starts"]


def orbit_of(body: Any, key: str) -> Ephemeris:
    """Return the ephemeris of a body of the mission.

    Raises
    ------
    InputError
        If the body has no ephemeris.
    """
    if isinstance(body, OrbitingBody):
        return KeplerOrbit.of(body)
    if not isinstance(body, Ephemeris):
        raise InputError(
            f"{key}: a {type(body).__name__} has no place in the Solar System over time; take a "
            "body of type 'solar_orbit', 'asteroid' or 'spice'"
        )
    return body


def starts(body: Any, geometries: tuple[GeometrySpec, ...]) -> Array:
    """Return the heliocentric states (6, G) of the asteroid at the first observations.

    Raises
    ------
    InputError
        If a mean anomaly is given for a body without orbital elements.
    """
    states = []
    for geometry in geometries:
        epoch, mean = Epoch.parse(geometry.epoch, "TDB"), geometry.mean_anomaly_rad
        if mean is None:
            states.append(orbit_of(body, "asteroid").states(np.zeros(1), epoch))
        elif isinstance(body, OrbitingBody):
            states.append(KeplerOrbit.of(body, mean).states(np.zeros(1), epoch))
        elif isinstance(body, FixedOrbit):
            elements = body.elements.copy()
            elements[5] = mean
            states.append(states_of_elements(elements[:, None], body.gm_m3_s2))
        else:
            raise InputError(
                f"geometries: {geometry.name!r} gives a mean anomaly, but the asteroid comes "
                f"from a {type(body).__name__}; leave it out, or give the asteroid's elements"
            )
    return np.concatenate(states, axis=1)


def scenes_at(
    times_s: Array, earth: Ephemeris, geometries: tuple[GeometrySpec, ...], seeds: int
) -> dict[float, Scene]:
    """Return the scene of the sensors at each time, for geometries × seeds lanes.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times since each geometry's epoch, s.
    earth : Ephemeris
        Ephemeris of the Earth.
    geometries : tuple of GeometrySpec
        The G observation geometries.
    seeds : int
        Number of cases of each geometry.

    Returns
    -------
    dict of float to Scene
        The states are heliocentric, the frame is that of the Sun: ``origin``, ``axes`` and ``rate``
        are trivial, ``sun`` is zero. ``earth``, (6, G · seeds), and ``earth_axes``,
        (3, 3, G · seeds), depend on the time.
    """
    still = {
        "origin": np.zeros((6, 1)), "axes": np.eye(3)[:, :, None],
        "rate": np.zeros((3, 1)), "sun": np.zeros((3, 1)),
    }  # fmt: skip
    epochs = [Epoch.parse(geometry.epoch, "TDB") for geometry in geometries]
    states, turns = (
        np.stack(part, axis=-1)
        for part in zip(*(earth_at(times_s, earth, epoch) for epoch in epochs), strict=True)
    )
    return {
        float(t): still
        | {
            "earth": np.repeat(states[:, k], seeds, axis=-1),
            "earth_axes": np.repeat(turns[:, :, k], seeds, axis=-1),
        }
        for k, t in enumerate(times_s)
    }


def earth_at(times_s: Array, earth: Ephemeris, epoch: Epoch) -> tuple[Array, Array]:
    """Return the Earth's heliocentric states (6, K), and the rotations (3, 3, K) to its axes.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times since the epoch, s.
    earth : Ephemeris
        Ephemeris of the Earth.
    epoch : Epoch
        Date of time 0.
    """
    turn = earth_fixed("gcrs", epoch, times_s, UT1_IS_UTC)
    return earth.states(times_s, epoch), from_equator(turn)
