"""Motion about a body that rotates at its own rate, such as an asteroid on its orbit."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos as cosine
from math import pi
from math import sin as sine

import numpy as np

from hillsphere.engine.start_states import Centre
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.model.ephemeris import anomaly_from_mean, mean_from_true
from hillsphere.model.frame_motion import FrameMotion, turn_about_z
from hillsphere.symbolic import Expr, Params, Vec3, constant, cos, sin
from hillsphere.time import Epoch
from hillsphere_plants.moon_centred import (
    POSITION_AND_VELOCITY,
    ArrayAttraction,
    SymbolicAttraction,
    moon_of,
    vector,
)
from hillsphere_plants.rotation import AxialRotation, anomaly_rates
from hillsphere_plants.specs import ThreeBodySpec
from hillsphere_plants.three_body import ThreeBody
from hillsphere_plants.tidal import tidal_acceleration
from hillsphere_plants.turning import turning_motion

__all__ = ["ArraySpinningBody", "SpinningBody"]

_ANOMALY = Variable("true_anomaly", unit="rad")
_ANGLE = Variable("rotation_angle", unit="rad")


class _SpinningMotion(ThreeBody):
    """The problem about a body with a spin of its own, whatever the gravity."""

    states = (*POSITION_AND_VELOCITY, _ANOMALY, _ANGLE)

    def __init__(self, spec: ThreeBodySpec) -> None:
        super().__init__(spec, 0.0)  # x is longitude 0
        body = moon_of(spec.body)
        if body.rotation_rate_rad_s is None:
            raise InputError(
                f"rotation = 'spin', but body {self.body_name!r} has no rotation_rate; give it "
                "one (rotation_rate_deg_d), or another rotation"
            )
        self.rotation_rate_rad_s: float = body.rotation_rate_rad_s
        self.eccentricity: float = body.eccentricity
        self.gm_m3_s2: float = spec.gravity.get().gm_m3_s2
        self._equinox_rad = body.equinox_anomaly_rad
        self._tilt = (cosine(body.obliquity_rad), sine(body.obliquity_rad))
        self._to_primary = AxialRotation.by(pi - spec.prime_meridian_rad)
        self.mirrors: Mapping[str, tuple[int, ...]] = {}
        if not body.obliquity_rad:
            # Holds if the gravity has the same mirror plane and longitude 0 is under the primary
            # or opposite at both angles zero; check before use.
            self.mirrors = {"xz": (1, -1, 1, -1, 1, -1, -1, -1)}

    @property
    def frame(self) -> str:
        """``body:BODY``."""
        return f"body:{self.body_name}"

    @property
    def scales(self) -> Scales:
        """Natural units of the body's rotation: (Gm/ω²)^(1/3) and 1/ω."""
        rate = self.rotation_rate_rad_s
        return Scales((self.gm_m3_s2 / rate**2) ** (1.0 / 3.0), 1.0 / rate)

    def frame_rate(self, others: Mapping[str, float]) -> Array:
        """Return the angular velocity (3,) of the body, rad/s."""
        return np.array([0.0, 0.0, self.rotation_rate_rad_s])

    def centres(self, others: Mapping[str, float]) -> Mapping[str, Centre]:
        """Return the body alone: an orbit about the Sun begins nowhere near it."""
        return {self.body_name: self._own_centre()}

    def frame_motion(self, epoch: Epoch, t_s: Array, others: Mapping[str, Array]) -> FrameMotion:
        """Return the frame at times (K,) after an epoch; see `hillsphere.model.frame_motion`."""
        zero = np.zeros(t_s.size)
        turned = np.remainder(self.rotation_rate_rad_s * t_s, 2.0 * pi)
        return FrameMotion(
            turn_about_z(self.icrf_axes(epoch), turned),
            np.stack([zero, zero, zero + self.rotation_rate_rad_s]),
            {self.body_name: np.zeros((6, t_s.size))},
        )

    def others_over_time(self, start: Mapping[str, float], t_s: Array) -> Mapping[str, Array]:
        """Return true anomaly and rotation angle (K,), rad, at times after the start."""
        for name in (_ANOMALY.name, _ANGLE.name):
            if name not in start:
                raise InputError(f"others.{name}: expected its value at the start, rad, got none")
        since, e = t_s - t_s[0], self.eccentricity
        mean = mean_from_true(np.array([start[_ANOMALY.name]]), e) + self.mean_motion_rad_s * since
        return {
            _ANOMALY.name: anomaly_from_mean(mean, e),
            _ANGLE.name: start[_ANGLE.name] + self.rotation_rate_rad_s * since,
        }

    def _own_parameters(self) -> tuple[Parameter, ...]:
        return (
            *super()._own_parameters(),
            Parameter("eccentricity", self.eccentricity),
            Parameter("rotation_rate", self.rotation_rate_rad_s, "rad/s", positive=True),
        )

    def _motion(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], p: Params, pull: Vec3
    ) -> tuple[Expr, ...]:
        anomaly, angle = x[6], x[7]
        e, rate = p["eccentricity"], p["rotation_rate"]
        # the orbit enters by the true anomaly as a state: its rate, and the distance at it
        ahead, _ = anomaly_rates(anomaly, e, self._mean_motion(p))
        distance = p["semi_major_axis"] * (1.0 - e * e) / (1.0 + e * cos(anomaly))
        way = self._primary_direction(anomaly, angle)
        d = (distance * way[0], distance * way[1], distance * way[2])
        tide = tidal_acceleration(vector(x[:3]), d, distance, p["primary_gm"])
        return (*turning_motion(x, u, pull, tide, rate, constant(0.0)), ahead, rate)

    def _primary_direction(self, anomaly: Expr, angle: Expr) -> Vec3:
        """Return the unit vector to the primary in the body's frame."""
        upright, tilted = self._tilt
        if not tilted and not self._equinox_rad:
            way: Vec3 = (cos(anomaly - angle), sin(anomaly - angle), constant(0.0))
            return self._to_primary.from_body(way)
        since = anomaly - self._equinox_rad
        # In inertial axes: x to the primary at the equinox, z the spin axis; then turned by θ.
        x, y, z = cos(since), upright * sin(since), tilted * sin(since)
        c, s = cos(angle), sin(angle)
        return self._to_primary.from_body((c * x + s * y, c * y - s * x, z))


class SpinningBody(SymbolicAttraction, _SpinningMotion):
    r"""Motion fixed in a body that turns uniformly at a rate of its own.

    In the frame ``body:BODY`` (x towards longitude 0, z the spin axis), with the true anomaly ν of
    the body and the angle θ by which it has turned as seventh and eighth state,

    .. math::

        \ddot r = \nabla U - GM\left[\frac{r-d}{|r-d|^3} + \frac{d}{D^3}\right]
        - 2\omega\times\dot r - \omega\times(\omega\times r) + a_c, \quad
        \dot\nu = n\frac{(1+e\cos\nu)^2}{(1-e^2)^{3/2}}, \quad \dot\theta = \omega .

    The primary stands at :math:`d = D\,R_3(\alpha-\theta)(\cos u, \sin u\cos\varepsilon,
    \sin u\sin\varepsilon)`, with the obliquity ε of the body's axis, u = ν − ν₀ counted from the
    equinox at which the primary comes north over the equator, and α = 180° less the angle of the
    prime meridian. Without obliquity, at ν = θ = 0 longitude 0 stands at that angle from away from
    the primary: by default under it.

    Parameters
    ----------
    spec : ThreeBodySpec
        With its references bound.

    Raises
    ------
    InputError
        If the body has no rotation rate.

    References
    ----------
    .. [1] Scheeres, D. J., Orbital Motion in Strongly Perturbed Environments, Springer, 2012.
    """


class ArraySpinningBody(ArrayAttraction, _SpinningMotion):
    """The same with gravity that is a function of arrays.

    Parameters
    ----------
    spec : ThreeBodySpec
        With its references bound.
    """
