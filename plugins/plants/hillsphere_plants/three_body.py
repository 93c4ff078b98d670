"""The three-body problem about a moon: its primary at its true distance, circular or elliptic."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from math import pi, sqrt

import numpy as np

from hillsphere.dynamics import ArrayFunction, bracketed_roots
from hillsphere.engine.start_states import Centre
from hillsphere.errors import InputError
from hillsphere.gravity import whole_gravity
from hillsphere.interfaces import Array, Parameter, Variable
from hillsphere.model.frame_motion import FrameMotion, turn_about_z
from hillsphere.symbolic import (
    Expr,
    Params,
    Vec3,
    constant,
    cos,
    dot,
    power,
    sin,
    sum_of,
    variable,
)
from hillsphere.symbolic import sqrt as symbolic_sqrt
from hillsphere.time import Epoch
from hillsphere_plants.moon_centred import (
    POSITION_AND_VELOCITY,
    ArrayAttraction,
    MoonCentred,
    SymbolicAttraction,
    moon_of,
    vector,
)
from hillsphere_plants.rotation import (
    AxialRotation,
    Spin,
    anomaly_rates,
    librating_spin,
    locked_spin,
    mean_anomaly,
)
from hillsphere_plants.specs import ThreeBodySpec
from hillsphere_plants.tidal import tidal_acceleration, tidal_potential
from hillsphere_plants.turning import turning_motion

__all__ = [
    "ArrayCircularThreeBody",
    "ArrayEllipticThreeBody",
    "CircularThreeBody",
    "EllipticThreeBody",
    "ThreeBody",
]

_ANOMALY = Variable("true_anomaly", unit="rad")


def _require_anomaly(others: Mapping[str, float]) -> float:
    """Return the true anomaly among the states at a start, or raise `InputError`."""
    if _ANOMALY.name not in others:
        raise InputError(
            "the plant's frame depends on the body's true anomaly; give start.others."
            f"{_ANOMALY.name}, also with a reference"
        )
    return others[_ANOMALY.name]


class ThreeBody(MoonCentred):
    """Common part of all three-body problems.

    Parameters
    ----------
    spec : ThreeBodySpec
        With its references bound.
    meridian_rad : float
        Angle about +z from +x to the body's longitude 0.
    """

    def __init__(self, spec: ThreeBodySpec, meridian_rad: float) -> None:
        body = moon_of(spec.body)
        total = body.primary_gm_m3_s2 + whole_gravity(spec.gravity.get()).gm_m3_s2
        super().__init__(spec, meridian_rad, sqrt(total / body.semi_major_axis_m**3))
        self.gm_m3_s2: float = spec.gravity.get().gm_m3_s2
        self.primary_gm_m3_s2: float = body.primary_gm_m3_s2

    def _own_parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter("primary_gm", self.primary_gm_m3_s2, "m3/s2", positive=True),
            Parameter("semi_major_axis", self.primary_distance_m, "m", positive=True),
        )

    def _mean_motion(self, p: Params) -> Expr:
        """Return n = √((GM + Gm)/a³), rad/s."""
        total = p["primary_gm"] + self._moon_gm(p)
        return symbolic_sqrt(total * power(p["semi_major_axis"], -3.0))


class _CircularMotion(ThreeBody):
    """The circular problem, for any gravity."""

    mirrors: Mapping[str, tuple[int, ...]] = {"xz": (1, -1, 1, -1, 1, -1)}
    """Time reversal that holds if the gravity has the same mirror plane; check before use."""

    def __init__(self, spec: ThreeBodySpec) -> None:
        super().__init__(spec, spec.prime_meridian_rad)

    def _primary(self, p: Params) -> Vec3:
        return (-p["semi_major_axis"], constant(0.0), constant(0.0))

    def _motion(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], p: Params, pull: Vec3
    ) -> tuple[Expr, ...]:
        px, py, _, vx, vy, vz = x
        n = self._mean_motion(p)
        tide = tidal_acceleration(
            vector(x[:3]), self._primary(p), p["semi_major_axis"], p["primary_gm"]
        )
        return (
            vx,
            vy,
            vz,
            # Coriolis and centrifugal acceleration; the tide replaces both attractions of the
            # primary
            sum_of([2.0 * n * vy, n * n * px, tide[0], pull[0], u[0]]),
            sum_of([-2.0 * n * vx, n * n * py, tide[1], pull[1], u[1]]),
            sum_of([tide[2], pull[2], u[2]]),
        )

    def _integral_without_gravity(self, x: tuple[Expr, ...], p: Params) -> Expr:
        n, distance = self._mean_motion(p), p["semi_major_axis"]
        tide = tidal_potential(vector(x[:3]), self._primary(p), distance, p["primary_gm"])
        return tide + 0.5 * n * n * dot(x[:2], x[:2]) - 0.5 * dot(x[3:6], x[3:6])


class CircularThreeBody(SymbolicAttraction, _CircularMotion):
    r"""Circular restricted three-body problem, seen from the moon.

    In the frame ``hill:BODY`` (x away from the primary, y along the moon's orbital velocity, z its
    orbit normal; rotating with n = √((GM + Gm)/a³)), with the primary at d = (−a, 0, 0),

    .. math::

        \ddot r = \nabla U - GM\left[\frac{r-d}{|r-d|^3} + \frac{d}{a^3}\right]
        - 2\omega\times\dot r - \omega\times(\omega\times r) + a_c .

    The moon is locked; its gravity is any model. Without control

    .. math:: C = \tfrac12 n^2(x^2+y^2) + GM\left[\frac1{|r-d|} - \frac1a
              - \frac{r\cdot d}{a^3}\right] + U - \tfrac12 v^2

    is conserved. Equations, C and natural units go over into those of the plant ``hill`` as a
    grows; C and the usual Jacobi constant of the problem differ by a constant.

    Parameters
    ----------
    spec : ThreeBodySpec
        With its references bound.

    References
    ----------
    .. [1] Szebehely, V., Theory of Orbits, Academic Press, 1967, chapter 1.
    """

    integral_variable = Variable("jacobi", 2, -2)

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        """Return the Jacobi constant C, m²/s²; larger means closer or slower."""
        return self._integral_without_gravity(x, p) + self._potential(x, p)


class ArrayCircularThreeBody(ArrayAttraction, _CircularMotion):
    """The circular problem with gravity that is a function of arrays.

    Parameters
    ----------
    spec : ThreeBodySpec
        With its references bound.
    """

    def integral_array(self, x: Array) -> Array:
        """Return the Jacobi constant C (N,), m²/s², at states x (6, N), SI, nominal parameters."""
        return np.asarray(self._rest(x)[0] + self._potential_array(x))

    @cached_property
    def _rest(self) -> ArrayFunction:
        states = tuple(variable(v.name) for v in self.states)
        p = {q.name: constant(q.value) for q in self.parameters()}
        return ArrayFunction([self._integral_without_gravity(states, p)], states)


class _EllipticMotion(ThreeBody):
    """The elliptic problem, for any gravity."""

    states = (*POSITION_AND_VELOCITY, _ANOMALY)
    mirrors: Mapping[str, tuple[int, ...]] = {"xz": (1, -1, 1, -1, 1, -1, -1)}
    """Time reversal that holds if the gravity has the same mirror plane and longitude 0 is under
    the primary or opposite; check before use."""

    def __init__(self, spec: ThreeBodySpec) -> None:
        super().__init__(spec, 0.0)  # x is longitude 0
        body = moon_of(spec.body)
        self.eccentricity: float = body.eccentricity
        self.libration_amplitude_rad: float = body.libration_amplitude_rad
        self.mode = spec.rotation
        if self.mode == "libration" and self.libration_amplitude_rad == 0.0:
            raise InputError(
                "rotation = 'libration', but the libration_amplitude_deg of body "
                f"{self.body_name!r} is 0; give the body its amplitude, or let it turn with "
                "rotation = 'uniform'"
            )
        self.primary_longitude_rad = pi - spec.prime_meridian_rad
        self._to_primary = AxialRotation.by(self.primary_longitude_rad)

    @property
    def frame(self) -> str:
        """``body:BODY``."""
        return f"body:{self.body_name}"

    def in_hill_frame(self, x: Array) -> Array:
        """Return positions and velocities in the frame that rotates with the line to the primary.

        Parameters
        ----------
        x : ndarray, shape (7, N)
            States of this plant, SI.

        Returns
        -------
        ndarray, shape (6, N)
            x points away from the primary, z is the orbit normal; velocities are relative to that
            frame.
        """
        angle, rate, anomaly_rate = self._orientation(x[6:])
        return _rotate_states(x[:6], -angle, rate - anomaly_rate)

    def from_hill_frame(self, x: Array, true_anomaly_rad: Array) -> Array:
        """Return states of this plant (7, N), SI; the inverse of `in_hill_frame`.

        Parameters
        ----------
        x : ndarray, shape (6, N)
            States in the frame that turns with the line to the primary.
        true_anomaly_rad : ndarray, shape (N,)
            True anomaly of the moon.
        """
        angle, rate, anomaly_rate = self._orientation(true_anomaly_rad[None])
        return np.concatenate(
            [_rotate_states(x, angle, anomaly_rate - rate), true_anomaly_rad[None]]
        )

    def frame_rate(self, others: Mapping[str, float]) -> Array:
        """Return the angular velocity (3,) of the body, rad/s, at its true anomaly."""
        anomaly = np.array([[_require_anomaly(others)]])
        return np.array([0.0, 0.0, float(self._orientation(anomaly)[1][0])])

    def centres(self, others: Mapping[str, float]) -> Mapping[str, Centre]:
        """Return the moon, and its primary at the true anomaly."""
        anomaly = _require_anomaly(others)
        place = self._primary(np.array([anomaly]))[:, 0]
        return {
            self.body_name: self._own_centre(),
            self.moon.primary_name: Centre(self.moon.primary_gm_m3_s2, place[:3], place[3:]),
        }

    def frame_motion(self, epoch: Epoch, t_s: Array, others: Mapping[str, Array]) -> FrameMotion:
        """Return the frame at times (K,) after an epoch; see `hillsphere.model.frame_motion`.

        At the first time it stands as `icrf_axes` says, and turns as the body does from there on.
        """
        anomaly = np.unwrap(others["true_anomaly"])
        angle, rate, _ = self._orientation(anomaly[None])
        turned = anomaly - angle
        zero = np.zeros(t_s.size)
        start = epoch.after(float(t_s[0]))
        return FrameMotion(
            turn_about_z(self.icrf_axes(start), turned - turned[0]),
            np.stack([zero, zero, rate]),
            {
                self.body_name: np.zeros((6, t_s.size)),
                self.moon.primary_name: self._primary(anomaly),
            },
        )

    def others_over_time(self, start: Mapping[str, float], t_s: Array) -> Mapping[str, Array]:
        """Return the true anomaly (K,), rad, of the moon at times after the start."""
        since = t_s - t_s[0]
        return {"true_anomaly": self.true_anomaly_after(_require_anomaly(start), since)}

    def _primary(self, anomaly: Array) -> Array:
        """Return position, m, and inertial velocity, m/s, (6, N) of the primary in the frame."""
        e, n = self.eccentricity, self.mean_motion_rad_s
        root = np.sqrt(1.0 - e * e)
        zero = np.zeros(anomaly.size)
        distance = self.primary_distance_m * root**2 / (1.0 + e * np.cos(anomaly))
        # radial velocity Ṙ = a n e sin ν / √(1 − e²)
        away = self.primary_distance_m * n * e * np.sin(anomaly) / root
        hill = np.stack([-distance, zero, zero, -away, zero, zero])
        x = self.from_hill_frame(hill, anomaly)[:6]
        rate = np.stack([zero, zero, self._orientation(anomaly[None])[1]])
        return np.concatenate([x[:3], x[3:] + np.cross(rate, x[:3], axis=0)])

    def true_anomaly_after(self, start_rad: float, t_s: Array) -> Array:
        """Return the true anomaly (N,), rad, at times after it was `start_rad`; not wrapped.

        Parameters
        ----------
        start_rad : float
            True anomaly at time zero.
        t_s : ndarray, shape (N,)
            Times.
        """
        start = float(self._mean_anomaly(np.array([start_rad]))[0])
        target = start + self.mean_motion_rad_s * np.atleast_1d(np.asarray(t_s, dtype=float))

        def excess(anomaly: Array) -> Array:
            return np.asarray(self._mean_anomaly(anomaly[None])[0] - target)

        # M and ν pass every multiple of π together, so that |ν − M| < π brackets the root
        low, high = target - pi, target + pi
        width = 4.0 * np.spacing(np.maximum(1.0, np.abs(target)))
        return bracketed_roots(excess, low, high, excess(low), excess(high), width)

    def _own_parameters(self) -> tuple[Parameter, ...]:
        own = (*super()._own_parameters(), Parameter("eccentricity", self.eccentricity))
        if self.mode == "libration":
            own += (Parameter("libration_amplitude", self.libration_amplitude_rad, "rad"),)
        return own

    def _spin(self, anomaly: Expr, p: Params) -> Spin:
        e, n = p["eccentricity"], self._mean_motion(p)
        if self.mode == "locked":
            return locked_spin(anomaly, e, n)
        return librating_spin(anomaly, e, n, p.get("libration_amplitude"))

    def _motion(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], p: Params, pull: Vec3
    ) -> tuple[Expr, ...]:
        anomaly = x[6]
        e = p["eccentricity"]
        spin = self._spin(anomaly, p)
        # distance and direction of the primary in the body's frame, at the true anomaly
        ahead, _ = anomaly_rates(anomaly, e, self._mean_motion(p))
        distance = p["semi_major_axis"] * (1.0 - e * e) / (1.0 + e * cos(anomaly))
        zero = constant(0.0)
        direction = self._to_primary.from_body((cos(spin.angle), sin(spin.angle), zero))
        d = (distance * direction[0], distance * direction[1], zero)
        tide = tidal_acceleration(vector(x[:3]), d, distance, p["primary_gm"])
        return (*turning_motion(x, u, pull, tide, spin.rate, spin.acceleration), ahead)

    def _nominal(self) -> tuple[Expr, Params]:
        p = {q.name: constant(q.value) for q in self.parameters()}
        return variable(_ANOMALY.name), p

    @cached_property
    def _orientation_function(self) -> ArrayFunction:
        anomaly, p = self._nominal()
        spin = self._spin(anomaly, p)
        ahead, _ = anomaly_rates(anomaly, p["eccentricity"], self._mean_motion(p))
        return ArrayFunction([spin.angle, spin.rate, ahead], [anomaly])

    @cached_property
    def _mean_anomaly(self) -> ArrayFunction:
        anomaly, p = self._nominal()
        return ArrayFunction([mean_anomaly(anomaly, p["eccentricity"])[0]], [anomaly])

    def _orientation(self, anomaly: Array) -> tuple[Array, Array, Array]:
        """Angle from the Hill frame's x to that of the body, its rate and the anomaly's rate."""
        angle, rate, ahead = self._orientation_function(anomaly)
        # the primary stands at π in the Hill frame, at ψ + its mean longitude in the body's
        return angle + (self.primary_longitude_rad - pi), rate, ahead


class EllipticThreeBody(SymbolicAttraction, _EllipticMotion):
    r"""Elliptic restricted three-body problem, fixed in a moon that turns with its orbit.

    In the frame ``body:BODY`` (x towards longitude 0, z the spin axis and orbit normal), with the
    true anomaly ν of the moon as seventh state and the primary at d = D (cos(ψ+α), sin(ψ+α), 0),
    D = a(1−e²)/(1 + e cos ν), α the mean longitude of the primary (zero in the IAU convention),

    .. math::

        \ddot r = \nabla U - GM\left[\frac{r-d}{|r-d|^3} + \frac{d}{D^3}\right]
        - 2\omega\times\dot r - \dot\omega\times r - \omega\times(\omega\times r) + a_c, \quad
        \dot\nu = n\frac{(1+e\cos\nu)^2}{(1-e^2)^{3/2}} .

    The rotation is ``locked`` (ψ = 0, ω = ν̇), ``uniform`` (ψ = ν − M, ω = n) or that of a
    ``libration`` in longitude of amplitude A (ψ = ν − M − A sin M, ω = n(1 + A cos M)). With a
    ``spin`` of the body's own the plant is `hillsphere_plants.spinning.SpinningBody`.

    Parameters
    ----------
    spec : ThreeBodySpec
        With its references bound.

    References
    ----------
    .. [1] Szebehely, V., Theory of Orbits, Academic Press, 1967, chapter 10.
    """


class ArrayEllipticThreeBody(ArrayAttraction, _EllipticMotion):
    """The elliptic problem with gravity that is a function of arrays.

    Parameters
    ----------
    spec : ThreeBodySpec
        With its references bound.
    """


def _rotate_states(x: Array, angle: Array, rate: Array) -> Array:
    """Rotate states (6, N) about z, after adding the velocity ``rate · z × r``."""
    c, s = np.cos(angle), np.sin(angle)
    px, py, pz, vx, vy, vz = x
    ux, uy = vx - rate * py, vy + rate * px
    return np.array([c * px - s * py, s * px + c * py, pz, c * ux - s * uy, s * ux + c * uy, vz])
