"""The scene of sensors near a body, and the pointing of the spacecraft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant, Scene, Sensor
from hillsphere.model.ephemeris import Ephemeris
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_refinement.scenes import earth_at, orbit_of
from hillsphere_estimators.sensor_fit import BY_STAGE, EARTH

__all__ = ["HeliocentricPlant", "ScenicPlant", "Sky", "aims", "proximity_scene", "sky_of"]


@runtime_checkable
class ScenicPlant(Contract, Protocol):
    """A plant that gives the direction of the Sun and the orientation of the body.

    Its Spec lists in ``gives`` the names of its scene, without which a mission whose sensors need
    them is not valid.
    """

    def scene(self, t_s: Array, **values: Array | float) -> dict[str, Array]:
        """Return arrays (…, N) at times (N,); `values` are parameters that are not nominal."""
        ...


@runtime_checkable
class HeliocentricPlant(Contract, Protocol):
    """A plant whose frame moves about the Sun."""

    @property
    def epoch(self) -> str | None:
        """Date and time (TDB) of time 0, None if its body does not state it."""
        ...

    @property
    def oriented(self) -> bool:
        """Whether its heliocentric axes are the ecliptic and equinox of J2000."""
        ...

    def heliocentric(self, t_s: Array, **values: Array | float) -> dict[str, Array]:
        """Return ``"origin"``, ``"axes"`` and ``"rate"`` of the frame at times (N,)."""
        ...


@dataclass(frozen=True)
class Sky:
    """Ephemerides of distant bodies that sensors observe.

    Parameters
    ----------
    earth : Ephemeris, optional
        Ephemeris of the Earth; none without stations on it.
    epoch : Epoch, optional
        Date of time 0.
    """

    earth: Ephemeris | None = None
    epoch: Epoch | None = None

    def around(
        self, plant: HeliocentricPlant, t_s: Array, **values: Array | float
    ) -> dict[str, Array]:
        """Return the heliocentric frame of a plant, and the Earth's states and axes."""
        scene = plant.heliocentric(t_s, **values)
        if self.earth is not None and self.epoch is not None:
            times, which = np.unique(t_s, return_inverse=True)
            states, turns = earth_at(times, self.earth, self.epoch)
            scene |= {"earth": states[:, which], "earth_axes": turns[:, :, which]}
        return scene


def sky_of(
    sensors: Sequence[Sensor], plants: Sequence[Plant], earth: Any = None, epoch: str | None = None
) -> Sky | None:
    """Return the ephemerides that the sensors need, None if they need none.

    Parameters
    ----------
    sensors : sequence of Sensor
        Those of the filter's model and the true ones; their `takes` names what they need.
    plants : sequence of Plant
        That of the filter's model and the true one.
    earth : object, optional
        The body.
    epoch : str, optional
        Date and time (TDB) of time 0; by default that of the plants.

    Raises
    ------
    InputError
        If a sensor would not find what it needs, or two dates of time 0 differ.
    """
    moving = [plant for plant in plants if isinstance(plant, HeliocentricPlant)]
    dates = {one for one in (epoch, *(plant.epoch for plant in moving)) if one is not None}
    if len(dates) > 1:
        raise InputError(
            f"epoch: time is 0 at one date, the stage and its plants say "
            f"{' and '.join(sorted(dates))}; leave epoch out, or that of the body"
        )
    sky = Sky()
    if earth is not None and dates and all(plant.oriented for plant in moving):
        sky = Sky(orbit_of(earth, "earth"), Epoch.parse(dates.pop(), "TDB"))
    for plant in plants:
        given = set(BY_STAGE)
        if isinstance(plant, ScenicPlant):
            given |= set(plant.scene(np.zeros(1)))
        if isinstance(plant, HeliocentricPlant):
            given |= set(sky.around(plant, np.zeros(1)))
        for sensor in sensors:
            if lost := [name for name in getattr(sensor, "takes", ()) if name not in given]:
                needed = (
                    "give earth, epoch, and inclination, node and periapsis of the body"
                    if lost[0] in EARTH
                    else "take a plant of type 'proximity'"
                )
                raise InputError(
                    f"sensors: a {type(sensor).__name__} takes {', '.join(map(repr, lost))} from "
                    f"the scene, which has {', '.join(sorted(given))}; {needed}"
                )
    far = any(name in ("origin", *EARTH) for s in sensors for name in getattr(s, "takes", ()))
    return sky if far else None


def aims(positions: list[int], believed: Array, true: Array, beyond_rad: float | None) -> Array:
    """Return the states (n, N) by which the spacecraft point.

    A spacecraft points at the origin from where it believes to be. If that is farther than
    `beyond_rad` from the origin it turns until it sees the body, and then points there.

    Parameters
    ----------
    positions : list of int
        Rows of the positions.
    believed, true : ndarray, shape (n, N)
        Estimated and true states.
    beyond_rad : float or None
        Half the field of view of its camera; None: no spacecraft searches.
    """
    if beyond_rad is None:
        return believed
    shape = (-1, 3, believed.shape[1])
    told, place = believed[positions].reshape(shape), true[positions].reshape(shape)
    along = np.sum(told * place, axis=1)
    across = np.linalg.norm(np.cross(told, place, axis=1), axis=1)
    off = np.arctan2(across, along) > beyond_rad
    states = believed.copy()
    states[positions] = np.where(off[:, None, :], place, told).reshape(-1, believed.shape[1])
    return states


def proximity_scene(
    plant: Plant,
    positions: list[int],
    t_s: Array,
    believed: Array,
    sky: Sky | None = None,
    **values: Array | float,
) -> Scene:
    """Return the scene of the sensors.

    Parameters
    ----------
    plant : Plant
        Its scene is part of it; of a plant without one only the boresights are given.
    positions : list of int
        Rows of the positions, three a spacecraft.
    t_s : ndarray, shape (N,)
        Times, s.
    believed : ndarray, shape (n, N)
        States by which the spacecraft point: each at the origin of the plant's frame from where it
        believes to be.
    sky : Sky, optional
        Distant bodies; none by default.
    **values : ndarray, shape (N,), or float
        Parameters of the plant that are not nominal, SI.

    Returns
    -------
    dict of str to ndarray
        That of the plant and of the sky; ``"boresight"``, shape (S, 3, N); ``"attitude"``, shape
        (S, 3, 1), the pointing errors, which are zero.
    """
    scene: dict[str, Array] = {}
    if isinstance(plant, ScenicPlant):
        scene.update(plant.scene(np.asarray(t_s, dtype=float), **values))
    if sky is not None and isinstance(plant, HeliocentricPlant):
        scene.update(sky.around(plant, np.asarray(t_s, dtype=float), **values))
    scene["boresight"] = -believed[positions].reshape(-1, 3, believed.shape[1])
    scene["attitude"] = np.zeros((len(scene["boresight"]), 3, 1))
    return scene
