"""Heliocentric states of spacecraft from states in another frame, and the scene for them."""

from __future__ import annotations

import numpy as np

from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.interfaces import Array, Scene
from hillsphere.model.bodies import OrbitingBody
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.model.ephemeris import Ephemeris, KeplerOrbit, from_equator, hill_axes
from hillsphere.time import Epoch
from hillsphere_sensors.spacecraft import SpacecraftSensor, rotate

__all__ = ["HeliocentricSensor", "heliocentric_scene"]


class HeliocentricSensor(SpacecraftSensor):
    """A sensor that needs the heliocentric state of its spacecraft.

    It takes the frame of the states from the scene: ``"origin"``, shape (6, N), the heliocentric
    state of its origin; ``"axes"``, (3, 3, N), its axes as columns in heliocentric axes;
    ``"rate"``, (3, N), its angular velocity in its own axes, rad/s. For states that are
    heliocentric these are zeros, the identity, and zeros. `heliocentric_scene` computes them.
    """

    def _heliocentric(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the heliocentric state (6, N) of the spacecraft."""
        own = self._states(x, self.common.spacecraft)
        origin = self._from(scene, "origin", (6,), t_s)
        axes = self._from(scene, "axes", (3, 3), t_s)
        rate = np.broadcast_to(self._from(scene, "rate", (3,), t_s), own[:3].shape)
        speed = own[3:] + np.cross(rate, own[:3], axis=0)
        return np.asarray(origin + np.concatenate([rotate(axes, own[:3]), rotate(axes, speed)]))


def heliocentric_scene(
    t_s: Array,
    epoch: Epoch,
    earth: Ephemeris,
    asteroid: Ephemeris | OrbitingBody | None = None,
    orientation: EarthOrientation = UT1_IS_UTC,
) -> dict[str, Array]:
    """Return the frame of the states, and the Earth, at times (N,).

    Parameters
    ----------
    t_s : ndarray, shape (N,)
        Seconds after the epoch.
    epoch : Epoch
        From which times count.
    earth : Ephemeris
        Ephemeris of the Earth.
    asteroid : Ephemeris or OrbitingBody, optional
        Orbit of the asteroid in whose Hill frame the states are; left out: they are heliocentric.
    orientation : EarthOrientation
        Gives UT1 and polar motion.

    Returns
    -------
    dict of str to ndarray
        ``"origin"``, (6, N), ``"axes"``, (3, 3, N), and ``"rate"``, (3, N), see
        `HeliocentricSensor`; ``"earth"``, (6, N): the Earth's heliocentric state; ``"earth_axes"``,
        (3, 3, N): matrices from heliocentric to Earth-fixed axes.
    """
    t = np.atleast_1d(np.asarray(t_s, dtype=float))
    turn = earth_fixed("gcrs", epoch, t, orientation)
    scene = {"earth": earth.states(t, epoch), "earth_axes": from_equator(turn)}
    if asteroid is None:
        return scene | {
            "origin": np.zeros((6, 1)), "axes": np.eye(3)[:, :, None], "rate": np.zeros((3, 1))
        }  # fmt: skip
    orbit = asteroid if isinstance(asteroid, Ephemeris) else KeplerOrbit.of(asteroid)
    origin = orbit.states(t, epoch)
    axes, rate = hill_axes(origin)
    return scene | {"origin": origin, "axes": axes, "rate": rate}
