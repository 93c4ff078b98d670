"""What surrounds the sensors of spacecraft near a body, and where these are told to look."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.interfaces import Array, Plant, Scene

__all__ = ["ScenicPlant", "aims", "proximity_scene"]


@runtime_checkable
class ScenicPlant(Protocol):
    """A plant that can say where the Sun stands and how the body is turned."""

    def scene(self, t_s: Array, **values: Array | float) -> dict[str, Array]:
        """Return arrays (…, N) at times (N,); values of parameters that are not nominal."""
        ...


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
    plant: Plant, positions: list[int], t_s: Array, believed: Array, **values: Array | float
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
    **values : ndarray, shape (N,), or float
        Parameters of the plant that are not nominal, SI.

    Returns
    -------
    dict of str to ndarray
        That of the plant, and ``"boresight"``, shape (S, 3, N).
    """
    found: dict[str, Array] = {}
    if isinstance(plant, ScenicPlant):
        found.update(plant.scene(np.asarray(t_s, dtype=float), **values))
    found["boresight"] = -believed[positions].reshape(-1, 3, believed.shape[1])
    return found
