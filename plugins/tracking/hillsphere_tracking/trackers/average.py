r"""Running means of the node and the anomaly: assisted tracking by Kuga and Carrara [1]_.

An assumed radius r and a pair of angles give a position. The position gives the argument of
latitude u, which gives the node and the anomaly, and the anomaly gives an improved r. With the unit
vector c of the antenna's direction and the station's position R, both Earth-fixed,

.. math::

    ρ &= \sqrt{r^2 - R^2 + B^2} - B, \quad B = R·c, \quad s = R + ρ c, \\
    u &= \arcsin(s_z / (r \sin i)) \text{ or, descending, } π - u, \\
    Ω &= θ_g + \mathrm{atan2}(s_y, s_x) - \mathrm{atan2}(\cos i \sin u, \cos u), \\
    f &= u - ω, \quad r = a (1 - e \cos E(f)).

Near the extremes of the satellite's latitude, node and anomaly are hardly separable. The sine is
then clipped to ±1, and the means remain finite. On an orbit inclined by less than 2° the latitude
determines u poorly: u is blended with its prediction, linearly in sin i, and below 0.2° only the
node is updated, which then absorbs the along-track error. Use `least_squares` for such orbits.

References
----------
.. [1] Kuga, H. K., Carrara, V. (1990), Assisted tracking, 1st Brazilian Symposium of Aerospace
   Technology, eqs. 1-20; here the sign of eq. 8 is corrected, the means are taken modulo 2π, and
   the iteration runs to a tolerance.
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
    JointCases,
    OrbitState,
    field_of,
    point_antenna,
    predict_angles,
    start,
    validate_measurement,
)

__all__ = ["Average", "AverageState", "Circular"]

_RATE = ROTATION_RATES_RAD_S["teme"]
_MAX_ITERATIONS = 60
"""Steps of the iteration for one measurement at most. Where Newton's method settles it takes a few;
a measurement that has not settled after so many is left out."""
_STEPS_AT_ONCE = 3
"""Steps in the first call: as many as a measurement of a pass takes as a rule. A call costs as much
as four steps of one case."""
_FLAT, _TILTED = 3.5e-3, 3.5e-2
"""sin i (0.2° and 2°) between which u is blended from its prediction to the value that follows from
the latitude. An error of 2 km across the track, 0.1° at 1000 km, changes u by 0.4° at i = 2° and by
4° at i = 0.2°, more than the error of any prediction."""
_PAIRS = np.array([[0, 0, 1], [0, 1, 1]])


@dataclass(frozen=True)
class AverageState(OrbitState):
    """Running means of an orbit, with the scatter of the measurements.

    Parameters
    ----------
    scatter : ndarray, shape (3, N)
        Sums of squares and products of the deviations of Ω and M from their running means, rad²:
        ΩΩ, ΩM, MM.
    """

    scatter: Array


class Average(JointCases):
    """Running means of Ω and M over the measurements; the other elements are constant [1]_.

    Parameters
    ----------
    spec : AverageSpec
        Parameters from the mission.
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
        """Update the running means with one measurement per case; `sigma_rad` is not used.

        A measurement whose iteration does not converge is ignored.
        """
        t_s, azimuth, elevation = validate_measurement(state, t_s, az_rad, el_rad)
        now, dt = state.elements.copy(), t_s - state.t_s
        if not state.count.all():
            # Up to the first measurement the full theory moves all elements; from there on only M
            # is propagated, as in [1]_.
            first = state.count == 0.0
            now = np.where(first, propagate_secular(now, dt, self._field), now)
            dt = np.where(first, 0.0, dt)
        there, good = self._solve_measurement(state, now, dt, t_s, azimuth, elevation)
        off = wrap_angle(there - now[3::2])
        if not good.all():
            off = np.where(good, off, 0.0)
        # running mean x̄ ← x̄ + (x − x̄)/n, and Welford's update of the sums of squares
        count = state.count + good
        share = 1.0 / np.maximum(count, 1.0)
        now[3::2] += off * share
        # The first measurement replaces the nominal values; it does not contribute to the scatter.
        weight = (count > 1.0) * (1.0 - share)
        scatter = state.scatter + weight * (off[_PAIRS[0]] * off[_PAIRS[1]])
        return AverageState(state.site, t_s, now, state.biases_rad, count, scatter)

    def point(self, state: AverageState, times_s: Array) -> tuple[Array, Array]:
        """Return azimuth and elevation (2, K, N) as `predict` does, with and without biases."""
        return point_antenna(state, times_s, self._field, short_period=False)

    def predict(
        self, state: AverageState, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return azimuth, elevation (K, N) and sky covariance (2, 2, K, N).

        The covariance is the sample covariance of the means. It includes neither biases nor errors
        of the elements that are constant.
        """
        cases = state.t_s.size
        columns = np.zeros((cases, 6, 2))
        columns[:, 3, 0] = columns[:, 5, 1] = 1.0
        spec, n = self.spec, state.count
        some = n > 1.0
        # covariance of a mean: sum of squares over n (n − 1)
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
        """Return Ω and M (2, N) that follow from a measurement, and where the iteration converged.

        M in `now` is propagated by `dt` in place.
        """
        first, step = _compile_iteration(self._field)
        tolerance = self.spec.tolerance * now[0]
        angle = state.site.angle_rad + _RATE * t_s
        given = np.empty((22, t_s.size))
        given[0], given[1], given[2:14] = azimuth, elevation, state.site.place
        given[14:17], given[17:19], given[19] = now[:3], now[4:], dt
        given[20], given[21] = angle, tolerance
        outputs = first(given)
        iterate, now[5] = outputs[:4], outputs[8]
        moving = iterate[1] > tolerance
        if moving.any():
            columns = np.concatenate([
                outputs[4:8], given[2:5], angle[None], now[:3], now[4:]
            ])  # fmt: skip
            for _ in range(_MAX_ITERATIONS - _STEPS_AT_ONCE):
                columns[0] = np.where(moving, iterate[0], columns[0])
                iterate = step(columns)
                moving = iterate[1] > tolerance
                if not moving.any():
                    break
        # 1e-6 of a, 7 m: a result that is good enough although the tolerance was not reached
        return iterate[2:], (iterate[1] <= 1e-6 * now[0]) & np.isfinite(azimuth + elevation)


class Circular(Average):
    """Running means of Ω and of the argument of latitude of a circular orbit [2]_.

    The eccentricity of the nominal orbit is set to zero at the start, which should be near the
    pass: the radius is a, and M is the argument of latitude. The tracker is meant for orbits of
    very small eccentricity.

    Parameters
    ----------
    spec : AverageSpec
        Parameters from the mission.
    """

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> AverageState:
        """Return the circular orbit through the nominal direction of the satellite at `t_s`."""
        state = super().initial(elements, t_s, stations, epoch, orientation)
        a, e, i, node, perigee, mean = state.elements
        argument = perigee + true_anomaly(eccentric_anomaly(mean, e), e)
        zero = np.zeros_like(a)
        circle = np.array([a, zero, i, node, zero, argument])
        return AverageState(**(vars(state) | {"elements": circle}))


@lru_cache(maxsize=16)
def _compile_iteration(field: ZonalField) -> tuple[ArrayFunction, ArrayFunction]:
    """Compile the first steps of the iteration for one measurement, and a further one.

    The first function takes azimuth, elevation, the 12 numbers of the site, a, e, i, ω, M, an
    interval, the rotation angle of the Earth and the tolerance. Its steps stop where the residual
    is within the tolerance. It returns what the last step does, r before that step, the Earth-fixed
    direction c, and M after the interval, by its rate due to J2 (eq. 20 of [1]_). The second takes
    r, c, the Earth-fixed position R, the rotation angle, a, e, i, ω and the predicted M. It returns
    r after a Newton step, the residual of the old r, Ω and M.
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
    # eq. 20: dM/dt = n (1 + (3/2) J2 (R/a)² (1 − (3/2) sin² i) / (1 − e²)^(3/2))
    ratio, eta2 = field.radius_m / a, 1.0 - e * e
    flat = 1.5 * field.j2 * ratio * ratio * (1.0 - 1.5 * sy.sin(i) * sy.sin(i))
    later = (
        mean + sy.sqrt(field.gm_m3_s2 / (a * a * a)) * (1.0 + flat / (eta2 * sy.sqrt(eta2))) * dt
    )
    expected = a * (1.0 - e * sy.cos(_eccentric(later, e)))
    # ρ of the module's equations; the square root is real for every r beyond the station's distance
    c, base = sy.variables("cx", "cy", "cz"), sy.variables("x", "y", "z")
    b = sy.dot(base, c)
    reach = sy.maximum(r * r - sy.dot(base, base) + b * b, 1.0)
    distance = sy.sqrt(reach) - b
    x, y, z = (p + distance * q for p, q in zip(base, c, strict=True))
    # u from the latitude: of both solutions the one on the predicted side of the orbit's extremes
    tilt = sy.sin(i)
    sine = z / (r * sy.maximum(tilt, 1e-12))
    rising = sy.asin(sy.minimum(sy.maximum(sine, -1.0 + 1e-12), 1.0 - 1e-12))
    predicted = perigee + _true(mean, e)
    from_latitude = sy.select(sy.less(sy.cos(predicted), 0.0), sy.pi - rising, rising)
    away = from_latitude - predicted
    trust = sy.maximum((tilt - _FLAT) / (_TILTED - _FLAT), 0.0)
    blended = predicted + trust * sy.atan2(sy.sin(away), sy.cos(away))
    u = sy.select(sy.less(tilt, _TILTED), blended, from_latitude)
    # Ω: right ascension of the position minus the angle from the node to it along the equator
    node = angle + sy.atan2(y, x) - sy.atan2(sy.cos(i) * sy.sin(u), sy.cos(u))
    # true anomaly, eccentric anomaly, mean anomaly, and the new radius a (1 − e cos E)
    f = u - perigee
    eta = sy.sqrt(1.0 - e * e)
    below = 1.0 + e * sy.cos(f)
    cos_e, sin_e = (e + sy.cos(f)) / below, eta * sy.sin(f) / below
    anomaly = sy.atan2(sin_e, cos_e) - e * sin_e
    new = a * (1.0 - e * cos_e)
    # Newton's method on r(r) − r = 0. Near the latitude's extremes the slope r′ is unbounded; it is
    # limited to [−3, 0.75], which keeps each step between 1/4 and 4 times the fixed-point step.
    slope = sy.minimum(sy.maximum(sy.gradient(new, [r])[0], -3.0), 0.75)
    outputs = [r + (new - r) / (1.0 - slope), sy.absolute(new - r), node, anomaly]
    step = ArrayFunction(outputs, (r, *c, *base, angle, a, e, i, perigee, mean))
    tolerance = sy.variable("tolerance")
    known = dict(zip((*c, *base, mean), (*fixed, *place[:3], later), strict=True))
    own = sy.substitute(outputs, known)
    now = expected
    iterate = sy.substitute(own, {r: now})
    for _ in range(_STEPS_AT_ONCE - 1):
        now = sy.select(sy.less(tolerance, iterate[1]), iterate[0], now)
        iterate = sy.substitute(own, {r: now})
    given = (azimuth, elevation, *place, a, e, i, perigee, mean, dt, angle, tolerance)
    return ArrayFunction([*iterate, now, *fixed, later], given), step


def _true(mean: Expr, e: Expr) -> Expr:
    """Return the true anomaly of a mean anomaly."""
    anomaly = _eccentric(mean, e)
    beta = e / (1.0 + sy.sqrt(1.0 - e * e))
    ahead = sy.atan2(beta * sy.sin(anomaly), 1.0 - beta * sy.cos(anomaly))
    return anomaly + 2.0 * ahead


def _eccentric(mean: Expr, e: Expr) -> Expr:
    """Return the eccentric anomaly of a mean anomaly."""
    return mean + sy.kepler(e * sy.sin(mean), e * sy.cos(mean), e * sy.sin(mean))
