r"""Running means of the node and the anomaly: Kuga's and Carrara's assisted tracking.

From an assumed radius r a pair of angles gives a place, the place the node and, through the
argument of latitude, the anomaly, and this a better r. With the unit vector c of the antenna's
direction and the station's position R, Earth-fixed,

.. math::

    ρ &= \sqrt{r^2 - R^2 + B^2} - B, \quad B = R·c, \quad s = R + ρ c, \\
    u &= \arcsin(s_z / (r \sin i)) \text{ or, descending, } π - u, \\
    Ω &= θ_g + \mathrm{atan2}(s_y, s_x) - \mathrm{atan2}(\cos i \sin u, \cos u), \\
    f &= u - ω, \quad r = a (1 - e \cos E(f)).

Where the satellite's latitude is near its extremes the node is told badly from the anomaly; the
sine is cut to ±1 and the means stay finite. On an orbit less than 2° from the equator u gives way
to the one predicted, evenly with sin i, and from 0.2° on only the node is updated: it takes the
error along the track on itself. `least_squares` is the tracker for such orbits.

References
----------
.. [1] Kuga, H. K., Carrara, V. (1990), Assisted tracking, 1st Brazilian Symposium of Aerospace
   Technology, eqs. 1-20; here with the sign of eq. 8 mended, the means taken modulo 2π, and the
   iteration carried to a tolerance.
.. [2] Aguirre, J. L. B., Medeiros, V. M. (1988), A satellite assisted tracking system with real
   time accomodation for maximal pointing accuracy, XVI ISPRS Congress: circular orbits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hillsphere import symbolic as sy
from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import ROTATION_RATES_RAD_S
from hillsphere.symbolic import Expr
from hillsphere.time import Epoch
from hillsphere_tracking.dynamics_brouwer import ZonalField
from hillsphere_tracking.kepler import eccentric_anomaly, true_anomaly, wrap_angle
from hillsphere_tracking.mean_elements import propagate_secular
from hillsphere_tracking.trackers.specs import AverageSpec
from hillsphere_tracking.trackers.state import (
    OrbitState,
    field_of,
    predict_angles,
    start,
    validate_measurement,
)

__all__ = ["Average", "AverageState", "Circular"]

_RATE = ROTATION_RATES_RAD_S["teme"]
_MAX_ITERATIONS = 60
"""Steps of the iteration for one measurement at most. Where Newton's method settles it takes a few;
a measurement that has not settled after so many is left out."""
_FLAT, _TILTED = 3.5e-3, 3.5e-2
"""sin i below which the latitude tells nothing of u, and above which all: 0.2° and 2°."""
_PAIRS = np.array([[0, 0, 1], [0, 1, 1]])


@dataclass(frozen=True)
class AverageState(OrbitState):
    """An orbit and how far its measurements scatter.

    Parameters
    ----------
    scatter : ndarray, shape (3, N)
        Sums of squares and products of the deviations of Ω and M from their means, rad²: ΩΩ, ΩM,
        MM.
    """

    scatter: Array


class Average:
    """Means of Ω and M over the measurements; the other elements stay [1]_ (see the module).

    Parameters
    ----------
    spec : AverageSpec
        Its parameters.
    """

    def __init__(self, spec: AverageSpec) -> None:
        self.spec = spec
        self._field = field_of(spec)
        self.short_period = False

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> AverageState:
        """Return the nominal orbit; see `hillsphere.interfaces.Tracker`."""
        state = start(elements, t_s, stations, epoch, orientation)
        return AverageState(**vars(state), scatter=np.zeros((3, state.t_s.size)))

    def update(
        self, state: AverageState, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array
    ) -> AverageState:
        """Take one measurement per case into the means; its sigma is not used.

        A measurement whose iteration does not settle is left out.
        """
        t_s, azimuth, elevation = validate_measurement(state, t_s, az_rad, el_rad)
        now, dt = state.elements.copy(), t_s - state.t_s
        if not state.count.all():
            # up to the first measurement everything moves that the theory moves
            first = state.count == 0.0
            now = np.where(first, propagate_secular(now, dt, self._field), now)
            dt = np.where(first, 0.0, dt)
        there, good = self._solve_measurement(state, now, dt, t_s, azimuth, elevation)
        off = wrap_angle(there - now[3::2])
        if not good.all():
            off = np.where(good, off, 0.0)
        count = state.count + good
        share = 1.0 / np.maximum(count, 1.0)
        now[3::2] += off * share
        # the first measurement replaces the nominal values and says nothing of the scatter
        weight = (count > 1.0) * (1.0 - share)
        scatter = state.scatter + weight * (off[_PAIRS[0]] * off[_PAIRS[1]])
        return AverageState(state.site, t_s, now, state.biases_rad, count, scatter)

    def predict(
        self, state: AverageState, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return azimuth, elevation (K, N) and sky covariance (2, 2, K, N).

        The covariance is that of the means as their scatter shows it: it knows nothing of biases,
        nor of the elements that are held.
        """
        cases = state.t_s.size
        columns = np.zeros((cases, 6, 2))
        columns[:, 3, 0] = columns[:, 5, 1] = 1.0
        spec, n = self.spec, state.count
        some = n > 1.0
        spread = state.scatter / np.where(some, n * (n - 1.0), 1.0)
        covariance = np.empty((cases, 2, 2))
        covariance[:, 0, 0] = np.where(some, spread[0], spec.node_sigma_rad**2)
        covariance[:, 1, 1] = np.where(some, spread[2], spec.mean_anomaly_sigma_rad**2)
        covariance[:, 0, 1] = covariance[:, 1, 0] = np.where(some, spread[1], 0.0)
        return predict_angles(
            state, times_s, self._field, columns, covariance, np.zeros((cases, 2)),
            short_period=False, biased=biased,
        )  # fmt: skip

    def _solve_measurement(
        self,
        state: AverageState,
        now: Array,
        dt: Array,
        t_s: Array,
        azimuth: Array,
        elevation: Array,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return Ω and M (2, N) of a measurement, and which cases have one.

        M in `now` is moved by `dt` in place.
        """
        begin, step = _compile_iteration(self._field)
        given = np.empty((19, t_s.size))
        given[0], given[1], given[2:14] = azimuth, elevation, state.site.place
        given[14:17], given[17], given[18] = now[:3], now[5], dt
        columns = np.empty((13, t_s.size))
        columns[:8] = begin(given)
        now[5] = columns[7]
        columns[7] = state.site.angle_rad + _RATE * t_s
        columns[8:11] = now[:3]
        columns[11:] = now[4:]
        tolerance = self.spec.tolerance * now[0]
        made = step(columns)
        for _ in range(_MAX_ITERATIONS):
            moving = made[1] > tolerance
            if not moving.any():
                break
            columns[0] = np.where(moving, made[0], columns[0])
            made = step(columns)
        return made[2:], (made[1] <= 1e-6 * now[0]) & np.isfinite(azimuth + elevation)


class Circular(Average):
    """Means of Ω and f of a circular orbit [2]_ (see the module).

    The nominal orbit loses its eccentricity at the start, which should be near the pass: the radius
    is a, and M stands for the argument of latitude. For orbits of very small eccentricity only.

    Parameters
    ----------
    spec : AverageSpec
        Its parameters.
    """

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> AverageState:
        """Return the circular orbit on which the satellite is now at the nominal place."""
        state = super().initial(elements, t_s, stations, epoch, orientation)
        a, e, i, node, perigee, mean = state.elements
        argument = perigee + true_anomaly(eccentric_anomaly(mean, e), e)
        zero = np.zeros_like(a)
        circle = np.array([a, zero, i, node, zero, argument])
        return AverageState(**(vars(state) | {"elements": circle}))


@lru_cache(maxsize=16)
def _compile_iteration(field: ZonalField) -> tuple[ArrayFunction, ArrayFunction]:
    """Return the functions of a measurement's direction, and of one step of the iteration.

    The first: azimuth, elevation, the site's 12 numbers, a, e, i, M and a time → the r predicted,
    the antenna's direction c and the station's position R, Earth-fixed, and M then, by its rate due
    to J2 (eq. 20). The second: r, c, R, the Earth's angle, a, e, i, ω and M predicted → a better r
    by Newton's method, how far the old one misses, Ω and M.
    """
    azimuth, elevation = sy.variables("azimuth", "elevation")
    place = sy.variables(*(f"site{k}" for k in range(12)))
    local = (
        sy.cos(elevation) * sy.sin(azimuth),
        sy.cos(elevation) * sy.cos(azimuth),
        sy.sin(elevation),
    )
    fixed = [sy.dot(local, place[3 + k :: 3]) for k in range(3)]
    r, angle, a, e, i, perigee, mean = sy.variables("r", "angle", "a", "e", "i", "perigee", "mean")
    dt = sy.variable("dt")
    ratio, eta2 = field.radius_m / a, 1.0 - e * e
    flat = 1.5 * field.j2 * ratio * ratio * (1.0 - 1.5 * sy.sin(i) * sy.sin(i))
    later = (
        mean + sy.sqrt(field.gm_m3_s2 / (a * a * a)) * (1.0 + flat / (eta2 * sy.sqrt(eta2))) * dt
    )
    expected = a * (1.0 - e * sy.cos(_eccentric(later, e)))
    begin = ArrayFunction(
        [expected, *fixed, *place[:3], later], (azimuth, elevation, *place, a, e, i, mean, dt)
    )

    c, base = sy.variables("cx", "cy", "cz"), sy.variables("x", "y", "z")
    b = sy.dot(base, c)
    reach = sy.maximum(r * r - sy.dot(base, base) + b * b, 1.0)
    distance = sy.sqrt(reach) - b
    x, y, z = (p + distance * q for p, q in zip(base, c, strict=True))
    tilt = sy.sin(i)
    sine = z / (r * sy.maximum(tilt, 1e-12))
    rising = sy.asin(sy.minimum(sy.maximum(sine, -1.0 + 1e-12), 1.0 - 1e-12))
    predicted = perigee + _true(mean, e)
    told = sy.select(sy.less(sy.cos(predicted), 0.0), sy.pi - rising, rising)
    away = told - predicted
    trust = sy.maximum((tilt - _FLAT) / (_TILTED - _FLAT), 0.0)
    held = predicted + trust * sy.atan2(sy.sin(away), sy.cos(away))
    u = sy.select(sy.less(tilt, _TILTED), held, told)
    node = angle + sy.atan2(y, x) - sy.atan2(sy.cos(i) * sy.sin(u), sy.cos(u))
    f = u - perigee
    eta = sy.sqrt(1.0 - e * e)
    below = 1.0 + e * sy.cos(f)
    cos_e, sin_e = (e + sy.cos(f)) / below, eta * sy.sin(f) / below
    anomaly = sy.atan2(sin_e, cos_e) - e * sin_e
    new = a * (1.0 - e * cos_e)
    # damped where the latitude's extreme makes the slope of r(r) wild
    slope = sy.minimum(sy.maximum(sy.gradient(new, [r])[0], -3.0), 0.75)
    outputs = [r + (new - r) / (1.0 - slope), sy.absolute(new - r), node, anomaly]
    return begin, ArrayFunction(outputs, (r, *c, *base, angle, a, e, i, perigee, mean))


def _true(mean: Expr, e: Expr) -> Expr:
    """Return f of M."""
    anomaly = _eccentric(mean, e)
    beta = e / (1.0 + sy.sqrt(1.0 - e * e))
    ahead = sy.atan2(beta * sy.sin(anomaly), 1.0 - beta * sy.cos(anomaly))
    return anomaly + 2.0 * ahead


def _eccentric(mean: Expr, e: Expr) -> Expr:
    """Return E of M."""
    return mean + sy.kepler(e * sy.sin(mean), e * sy.cos(mean), e * sy.sin(mean))
