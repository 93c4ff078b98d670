"""A tracking antenna on the ground: azimuth and elevation, with the errors of real ones.

References
----------
.. [1] H. K. Kuga, V. Carrara (1990), the assisted tracking of satellites by a ground station's
   antenna, equations (22) to (25). Equation (23) as printed lacks a division: the elevation's
   noise has the form of equation (25).
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Channel, Scene
from hillsphere_sensors.antenna_specs import AntennaSpec

__all__ = ["Antenna"]

_LEAST = 1e-3
"""Of sin h and cos h in the error model, which else grows beyond bounds at horizon and zenith."""


class Antenna:
    """Azimuth from north to the east, and elevation, both geometric (without refraction).

    With elevation h and range ρ the standard deviations of the noise are (eqs. 22 to 25 of [1]_)

    - azimuth: c1 + c2/cos h + c3 ρ/cos h,
    - elevation: c1 + c2/sin h + c3 cot h.

    Biases of the same form, with coefficients of their own, are added. The sensor takes
    ``"earth_fixed"``, shape (3, 3, N), from the scene: the rotation from the frame of the states to
    Earth-fixed axes (`hillsphere.model.earth.rotation.earth_fixed`).

    Parameters
    ----------
    spec : AntennaSpec
        Its parameters.
    """

    channels = (Channel("azimuth", "rad", "angle"), Channel("elevation", "rad", "angle"))
    draws = (6, 6)

    def __init__(self, spec: AntennaSpec) -> None:
        self.spec = spec
        self.station = Station(spec.station, spec.latitude_rad, spec.longitude_rad, spec.height_m)
        self._dropout = _threshold(spec.dropout_probability)
        self._outlier = _threshold(spec.outlier_probability)

    def believed_stations(self, constant: Array) -> tuple[Station, ...]:
        """Return the position of the station that trackers assume, for each case.

        Parameters
        ----------
        constant : ndarray, shape (6, N)
            The constant normal numbers of the cases, as for `measure`.

        Returns
        -------
        tuple of Station
            N of them; all the same if the Spec does not disperse the station.
        """
        spec = self.spec
        told = Station(
            spec.station,
            _or(spec.believed_latitude_rad, spec.latitude_rad),
            _or(spec.believed_longitude_rad, spec.longitude_rad),
            _or(spec.believed_height_m, spec.height_m),
        )
        sigma = np.array(spec.station_sigma_m)
        if not sigma.any():
            return (told,) * int(constant.shape[1])
        places = told.ecef_m[:, None] + told.axes.T @ (sigma[:, None] * constant[2:5])
        return tuple([Station.at(spec.station, place) for place in places.T])

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return true azimuth in [0, 2π) and elevation; see `hillsphere.interfaces.Sensor`."""
        return self._seen(x, t_s, scene)[0]

    def visible(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        """Return whether the satellite is above the mask."""
        return np.asarray(self.observe(x, t_s, scene)[1] >= self.spec.mask_elevation_rad)

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the standard deviations of the noise (2, N), outliers left out."""
        spec = self.spec
        return _angle_errors(
            *self._seen(x, t_s, scene), spec.azimuth_noise_rad, spec.elevation_noise_rad
        )

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return measured azimuth and elevation; NaN below the mask and in a dropout.

        The rows of `constant` are two biases, three coordinates of the station, and the bias of the
        term in cot h. Those of `noise` are the noise of both angles, dropout, outlier, and the
        errors of an outlier in both angles. An elevation beyond the zenith is returned as the same
        direction with an azimuth half a turn away.
        """
        spec = self.spec
        true, distance = self._seen(x, t_s, scene)
        sigma = _angle_errors(true, distance, spec.azimuth_noise_rad, spec.elevation_noise_rad)
        shown = true + sigma * noise[:2] + self._biases(true, distance, constant)
        shown += np.where(noise[3] < self._outlier, spec.outlier_sigma_rad * noise[4:6], 0.0)
        # what errors do to a direction stays a direction: −π/2 ≤ elevation ≤ π/2
        folded = np.arcsin(np.sin(shown[1]))
        over = np.cos(shown[1]) < 0.0
        azimuth = np.remainder(shown[0] + np.where(over, np.pi, 0.0), 2.0 * np.pi)
        missing = (true[1] < spec.mask_elevation_rad) | (noise[2] < self._dropout)
        return np.where(missing, np.nan, np.array([azimuth, folded]))

    def bias(self, x: Array, t_s: Array, scene: Scene, constant: Array) -> Array:
        """Return the systematic errors of both angles (2, N), measured minus true."""
        return self._biases(*self._seen(x, t_s, scene), constant)

    def _biases(self, true: Array, distance: Array, constant: Array) -> Array:
        spec = self.spec
        grown = _angle_errors(true, distance, spec.azimuth_bias_rad, spec.elevation_bias_rad)
        grown += np.array(spec.bias_sigma_rad)[:, None] * constant[:2]
        cotangent = np.cos(true[1]) / np.maximum(np.sin(true[1]), _LEAST)
        grown[1] += spec.horizon_bias_sigma_rad * constant[5] * cotangent
        return grown

    def _seen(self, x: Array, t_s: Array, scene: Scene) -> tuple[Array, Array]:
        """Return true angles (2, N), rad, and ranges (N,), m."""
        if "earth_fixed" not in scene:
            raise InputError(
                f"antenna {self.spec.station!r}: the scene lacks 'earth_fixed', the matrices "
                f"(3, 3, N) that turn positions to Earth-fixed ones; it has: "
                f"{', '.join(sorted(scene)) or 'nothing'}"
            )
        r, turn, times = np.asarray(x)[:3], scene["earth_fixed"], np.shape(t_s)
        if r.shape[1:] != times or turn.shape[:2] != (3, 3) or turn.shape[2:] not in ((1,), times):
            raise InputError(
                f"antenna {self.spec.station!r}: states (n, N), times (N,) and matrices (3, 3, N) "
                f"must fit together, got {np.shape(x)}, {times} and {turn.shape}"
            )
        fixed = np.einsum("ijn,jn->in", turn, r)
        east, north, up = self.station.axes @ (fixed - self.station.ecef_m[:, None])
        level = np.hypot(east, north)
        azimuth = np.remainder(np.arctan2(east, north), 2.0 * np.pi)
        return np.array([azimuth, np.arctan2(up, level)]), np.hypot(level, up)


def _angle_errors(
    true: Array,
    distance: Array,
    azimuth: tuple[float, float, float],
    elevation: tuple[float, float, float],
) -> Array:
    """Return errors of azimuth and elevation (2, N) with three coefficients each.

    The range enters in units of 1000 km. Sines and cosines are kept off zero.
    """
    sine, cosine = np.sin(true[1]), np.cos(true[1])
    low, high = np.maximum(sine, _LEAST), np.maximum(cosine, _LEAST)
    return np.array(
        [
            azimuth[0] + (azimuth[1] + azimuth[2] * distance / 1e6) / high,
            elevation[0] + (elevation[1] + elevation[2] * cosine) / low,
        ]
    )


def _threshold(probability: float) -> float:
    """Return the number below which a normal one lies with this probability."""
    if probability in (0.0, 1.0):
        return np.inf if probability else -np.inf
    return NormalDist().inv_cdf(probability)


def _or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value
