"""What surrounds the sensors of spacecraft near a body, and where these are told to look."""

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
    """A plant that can say where the Sun stands and how the body is turned.

    Its Spec lists in ``gives`` what sensors find in its scene, by name: only then is a mission
    valid that has them look at it.
    """

    def scene(self, t_s: Array, **values: Array | float) -> dict[str, Array]:
        """Return arrays (…, N) at times (N,); values of parameters that are not nominal."""
        ...


@runtime_checkable
class HeliocentricPlant(Contract, Protocol):
    """A plant whose frame moves about the Sun."""

    @property
    def epoch(self) -> str | None:
        """Date and time (TDB) of time 0, if its body says so."""
        ...

    @property
    def oriented(self) -> bool:
        """Whether its heliocentric axes are those of ecliptic and equinox J2000."""
        ...

    def heliocentric(self, t_s: Array, **values: Array | float) -> dict[str, Array]:
        """Return ``"origin"``, ``"axes"`` and ``"rate"`` of the frame at times (N,)."""
        ...


@dataclass(frozen=True)
class Sky:
    """What is far from the body, for sensors that look there.

    Parameters
    ----------
    earth : Ephemeris, optional
        Of the Earth; none without stations on it.
    epoch : Epoch, optional
        When time is 0.
    """

    earth: Ephemeris | None = None
    epoch: Epoch | None = None

    def around(
        self, plant: HeliocentricPlant, t_s: Array, **values: Array | float
    ) -> dict[str, Array]:
        """Return where a plant's frame and the Earth stand at times (N,)."""
        found = plant.heliocentric(t_s, **values)
        if self.earth is not None and self.epoch is not None:
            times, which = np.unique(t_s, return_inverse=True)
            states, turns = earth_at(times, self.earth, self.epoch)
            found |= {"earth": states[:, which], "earth_axes": turns[:, :, which]}
        return found


def sky_of(
    sensors: Sequence[Sensor], plants: Sequence[Plant], earth: Any = None, epoch: str | None = None
) -> Sky | None:
    """Return what sensors see far from the body; None if they do not look there.

    Parameters
    ----------
    sensors : sequence of Sensor
        Believed and true ones; what they take from the scene is in their `takes`.
    plants : sequence of Plant
        Believed and true one.
    earth : object, optional
        The body.
    epoch : str, optional
        Date and time (TDB) at which time is 0; left out: that of the plants.

    Raises
    ------
    InputError
        If a sensor would not find what it takes.
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
    """Return by which states (n, N) spacecraft turn that search for what they do not see.

    A spacecraft that looks farther than `beyond_rad` past the origin turns until it has found it,
    and then looks there; none searches if that is left out.
    """
    if beyond_rad is None:
        return believed
    shape = (-1, 3, believed.shape[1])
    told, place = believed[positions].reshape(shape), true[positions].reshape(shape)
    along = np.sum(told * place, axis=1)
    across = np.linalg.norm(np.cross(told, place, axis=1), axis=1)
    off = np.arctan2(across, along) > beyond_rad
    found = believed.copy()
    found[positions] = np.where(off[:, None, :], place, told).reshape(-1, believed.shape[1])
    return found


def proximity_scene(
    plant: Plant,
    positions: list[int],
    t_s: Array,
    believed: Array,
    sky: Sky | None = None,
    **values: Array | float,
) -> Scene:
    """Return what sensors take from the scene.

    Parameters
    ----------
    plant : Plant
        Whose scene it is; of one that has none only the boresights are there.
    positions : list of int
        Rows of the positions, three a spacecraft.
    t_s : ndarray, shape (N,)
        Times, s.
    believed : ndarray, shape (n, N)
        States by which the spacecraft turn: each looks at the origin of the plant's frame from
        where it believes to be.
    sky : Sky, optional
        What is far from the body; left out: no sensor looks there.
    **values : ndarray, shape (N,), or float
        Parameters of the plant that are not nominal, SI.

    Returns
    -------
    dict of str to ndarray
        That of the plant and of the sky; ``"boresight"``, shape (S, 3, N); ``"attitude"``,
        (S, 3, 1), zero: the spacecraft stand as they are commanded to.
    """
    found: dict[str, Array] = {}
    if isinstance(plant, ScenicPlant):
        found.update(plant.scene(np.asarray(t_s, dtype=float), **values))
    if sky is not None and isinstance(plant, HeliocentricPlant):
        found.update(sky.around(plant, np.asarray(t_s, dtype=float), **values))
    found["boresight"] = -believed[positions].reshape(-1, 3, believed.shape[1])
    found["attitude"] = np.zeros((len(found["boresight"]), 3, 1))
    return found
