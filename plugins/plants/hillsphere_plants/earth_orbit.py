"""Flight of a satellite about the turning Earth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.engine.start_states import Centre
from hillsphere.errors import InputError
from hillsphere.gravity import (
    AnyGravityModel,
    acceleration_at,
    is_array_model,
    potential_at,
    whole_gravity,
)
from hillsphere.interfaces import (
    Array,
    GravityModel,
    Parameter,
    Piecewise,
    Scales,
    SeriesGravity,
)
from hillsphere.model.earth.planet import StationedPlanet
from hillsphere.model.earth.rotation import (
    ROTATION_RATES_RAD_S,
    InertialFrame,
    celestial_to_intermediate,
    earth_angle,
    earth_fixed,
)
from hillsphere.model.frame_motion import FrameMotion
from hillsphere.symbolic import (
    Expr,
    Params,
    Vec3,
    constant,
    cos,
    cross,
    dot,
    matvec,
    norm,
    sin,
    sum_of,
)
from hillsphere.time import J2000, Epoch
from hillsphere_plants.atmosphere import density
from hillsphere_plants.earth_orbit_specs import EarthOrbitSpec
from hillsphere_plants.moon_centred import CONTROLS, POSITION_AND_VELOCITY, vector
from hillsphere_plants.sun_moon import GM_M3_S2, moon_position, sun_position

__all__ = ["EarthOrbit"]

_GRAVITY = "gravity."
_CENTURY = 36525.0 * DAY_S
_PLACES = {"sun": sun_position, "moon": moon_position}


class EarthOrbit:
    r"""Flight in an inertial frame about a planet that turns uniformly about a fixed axis.

    With the position r, the rotation R(t) to the Earth, its potential U, and the velocity
    :math:`v_a = v - \omega \times r` relative to an atmosphere of the density :math:`\rho` that
    turns with it,

    .. math::

        \ddot r = R^\mathsf{T} \nabla U(R r)
                  - \tfrac12 C_D \tfrac{A}{m} \rho\, |v_a|\, v_a
                  + \sum_k \mu_k \left(\frac{s_k - r}{|s_k - r|^3}
                  - \frac{s_k}{|s_k|^3}\right) + a ,

    the sum over Sun and Moon at s, as far as they are asked for.

    The angle of R is that of the Earth at the epoch (`hillsphere.model.earth.rotation.earth_angle`)
    plus the rotation rate times t; in the frame ``gcrs`` the axis stands where precession and
    nutation put it in the middle of the arc. Polar motion (0.5″) is left out of gravity and drag,
    not of what stations see. Tides and radiation pressure are not modelled.

    Without drag, third bodies and control `energy` is conserved.

    With drag the Taylor propagator compiles in one to two seconds, the step map in about twelve
    (once: the result is kept on disk); a day of low orbit takes 4 ms without drag, 20 ms with it.

    Parameters
    ----------
    spec : EarthOrbitSpec
        With its references bound. Run-time parameters: ``rotation_angle`` (at t = 0) and
        ``rotation_rate``; with drag ``drag.coefficient``, ``drag.area_to_mass``, ``drag.f107``,
        ``drag.f107_average`` and ``drag.ap``; ``sun.gm`` and ``moon.gm`` where they act; those of
        the gravity model, as ``gravity.NAME``.

    Raises
    ------
    InputError
        If the body is no planet, the gravity no expression, or the epoch no date.
    """

    states = POSITION_AND_VELOCITY
    controls = CONTROLS

    def __init__(self, spec: EarthOrbitSpec) -> None:
        planet: object = spec.body.get()
        if not isinstance(planet, StationedPlanet):
            raise InputError(
                f"earth_orbit flies about a body of type 'planet', got a {type(planet).__name__}"
            )
        model: AnyGravityModel = whole_gravity(spec.gravity.get())
        if is_array_model(model):
            raise InputError(
                f"earth_orbit needs gravity that is an expression, got a {type(model).__name__}"
            )
        self.planet = planet
        self.gravity: GravityModel = model  # type: ignore[assignment]  # just checked
        self.epoch = Epoch.parse(spec.epoch, "UTC")
        self.frame: InertialFrame = spec.frame
        self.drag = spec.drag
        self.third_bodies: tuple[str, ...] = spec.third_bodies
        rate = planet.rotation_rate_rad_s
        self.rotation_rate_rad_s = ROTATION_RATES_RAD_S[spec.frame] if rate is None else rate
        now = np.zeros(1)
        angle = earth_angle(spec.frame, self.epoch, now, planet.orientation)
        self.rotation_angle_rad = float(angle[0])
        self.to_equator: Array | None = None
        """Matrix (3, 3) from the frame to one whose z is the Earth's axis; None for none."""
        if spec.frame == "gcrs":
            self.to_equator = celestial_to_intermediate(self.epoch, now + 0.5 * spec.arc_s)[..., 0]

    def frame_rate(self, others: Mapping[str, float]) -> Array:
        """Return zero (3,): the frame does not turn."""
        return np.zeros(3)

    def centres(self, others: Mapping[str, float]) -> Mapping[str, Centre]:
        """Return the planet."""
        return {"earth": Centre(self.gravity.gm_m3_s2, np.zeros(3), np.zeros(3))}

    def icrf_axes(self, epoch: Epoch) -> Array:
        """Return the frame's axes in the ICRF as columns (3, 3) at an epoch: TEME is of date."""
        if self.frame == "gcrs":
            return np.eye(3)
        now = np.zeros(1)
        ours, theirs = (
            earth_fixed(frame, epoch, now, self.planet.orientation)[..., 0]
            for frame in ("teme", "gcrs")
        )
        return theirs.T @ ours

    def frame_motion(self, epoch: Epoch, t_s: Array, others: Mapping[str, Array]) -> FrameMotion:
        """Return the frame at times (K,): it does not turn."""
        axes = np.repeat(np.eye(3)[:, :, None], t_s.size, axis=2)
        name = "GCRF" if self.frame == "gcrs" else "TEME"
        return FrameMotion(axes, np.zeros((3, t_s.size)), {"earth": np.zeros((6, t_s.size))}, name)

    def others_over_time(self, start: Mapping[str, float], t_s: Array) -> Mapping[str, Array]:
        """Return none: positions and velocities are all states."""
        return {}

    @property
    def scales(self) -> Scales:
        """Natural units: 1.2 equatorial radii, and a radian of the circular orbit there."""
        length = 1.2 * self.planet.ellipsoid.equatorial_radius_m
        return Scales(length_m=length, time_s=(length**3 / self.gravity.gm_m3_s2) ** 0.5)

    @property
    def series_radius_m(self) -> float | None:
        """Radius inside which the gravity is a series without guarantee; None if it is none."""
        model = self.gravity
        return model.series_radius_m if isinstance(model, SeriesGravity) else None

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of rotation, drag and, prefixed, of the gravity model."""
        own = [
            Parameter("rotation_angle", self.rotation_angle_rad, "rad"),
            Parameter("rotation_rate", self.rotation_rate_rad_s, "rad/s"),
        ]
        if (drag := self.drag) is not None:
            own += [
                Parameter("drag.coefficient", drag.drag_coefficient, positive=True),
                Parameter("drag.area_to_mass", drag.area_to_mass_m2_kg, "m2/kg", positive=True),
                Parameter("drag.f107", drag.f107, positive=True),
                Parameter("drag.f107_average", drag.f107_average, positive=True),
                Parameter("drag.ap", drag.ap),
            ]
        own += [
            Parameter(f"{name}.gm", GM_M3_S2[name], "m3/s2", True) for name in self.third_bodies
        ]
        gravity = (replace(q, name=_GRAVITY + q.name) for q in self.gravity.parameters())
        return (*own, *gravity)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI."""
        place = self._to_earth(vector(x[:3]), t, p)
        force = acceleration_at(self.gravity, place, _of_gravity(p))
        pull = self._from_earth(force, t, p)
        parts = [pull, u]
        if self.drag is not None:
            parts.append(self._drag(x, place, t, p))
        parts += [self._third_body(name, vector(x[:3]), t, p) for name in self.third_bodies]
        return (*x[3:6], *(sum_of(terms) for terms in zip(*parts, strict=True)))

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return ``impact``, on the planet's ellipsoid: x²/a² + y²/a² + z²/b² − 1."""
        a = self.planet.ellipsoid.equatorial_radius_m
        b = a * (1.0 - self.planet.ellipsoid.flattening)
        px, py, pz = self._to_equator(vector(x[:3]))
        across = (px * px + py * py) / (a * a)
        return {"impact": sum_of([across, pz * pz / (b * b), -1.0])}

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return the functions at whose zeros the gravity model changes branch."""
        if not isinstance(self.gravity, Piecewise):
            return ()
        return self.gravity.switches(self._to_earth(vector(x[:3]), t, p), _of_gravity(p))

    def energy(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Expr:
        """Return the energy in the turning frame, ½v² − U − ω·(r × v), m²/s².

        Conserved without drag, third bodies and control, whatever the gravity. It holds the time,
        and so is no integral in the sense of `hillsphere.interfaces.ConservedQuantity`.
        """
        place, speed = self._to_equator(vector(x[:3])), self._to_equator(vector(x[3:6]))
        potential = potential_at(self.gravity, self._rotate(place, t, p), _of_gravity(p))
        # ω · (r × v): the Jacobi integral of a potential that rotates with the Earth
        spin = p["rotation_rate"] * cross(place, speed)[2]
        return sum_of([0.5 * dot(speed, speed), -potential, -spin])

    def _drag(self, x: tuple[Expr, ...], place: Vec3, t: Expr, p: Params) -> Vec3:
        day = _days_into_year(self.epoch) + t * (1.0 / DAY_S)
        weather = (p["drag.f107"], p["drag.f107_average"], p["drag.ap"])
        rho = density(place, day, self.planet.ellipsoid, *weather)
        px, py, _ = self._to_equator(vector(x[:3]))
        vx, vy, vz = self._to_equator(vector(x[3:6]))
        rate = p["rotation_rate"]
        # velocity relative to the atmosphere, v − ω × r
        wind = (vx + rate * py, vy - rate * px, vz)
        factor = -0.5 * p["drag.coefficient"] * p["drag.area_to_mass"] * rho * norm(wind)
        return self._from_equator((factor * wind[0], factor * wind[1], factor * wind[2]))

    def _third_body(self, name: str, r: Vec3, t: Expr, p: Params) -> Vec3:
        since = self.epoch.to("TDB").seconds_since(J2000) / _CENTURY
        place = _PLACES[name](since + t * (1.0 / _CENTURY))
        body = vector(matvec(self._from_celestial.tolist(), place))
        towards = vector([b - q for b, q in zip(body, r, strict=True)])
        near, far = norm(towards), norm(body)
        gm = p[f"{name}.gm"]
        # attraction of the satellite less that of the Earth
        return vector(
            [
                gm * (d / (near * near * near) - b / (far * far * far))
                for d, b in zip(towards, body, strict=True)
            ]
        )

    @cached_property
    def _from_celestial(self) -> Array:
        """Matrix (3, 3) from the axes of the ICRF to the frame of the states."""
        return self.icrf_axes(self.epoch).T

    def _to_equator(self, r: Vec3) -> Vec3:
        """Return components in axes whose z is the Earth's axis."""
        return r if self.to_equator is None else vector(matvec(self.to_equator.tolist(), r))

    def _from_equator(self, r: Vec3) -> Vec3:
        return r if self.to_equator is None else vector(matvec(self.to_equator.T.tolist(), r))

    def _rotate(self, r: Vec3, t: Expr, p: Params) -> Vec3:
        c, s = _turn(t, p)
        return (c * r[0] + s * r[1], c * r[1] - s * r[0], r[2])

    def _to_earth(self, r: Vec3, t: Expr, p: Params) -> Vec3:
        return self._rotate(self._to_equator(r), t, p)

    def _from_earth(self, r: Vec3, t: Expr, p: Params) -> Vec3:
        c, s = _turn(t, p)
        return self._from_equator((c * r[0] - s * r[1], c * r[1] + s * r[0], r[2]))


def _turn(t: Expr, p: Params) -> tuple[Expr, Expr]:
    angle = p["rotation_angle"] + p["rotation_rate"] * t
    return cos(angle), sin(angle)


def _days_into_year(epoch: Epoch) -> Expr:
    """Return the days since the first of January of the epoch's year."""
    first = Epoch.parse(epoch.isot(np.zeros(1), 0)[0][:4] + "-01-01", "UTC")
    return constant(epoch.seconds_since(first) / DAY_S)


def _of_gravity(p: Params) -> Params:
    return {k.removeprefix(_GRAVITY): v for k, v in p.items() if k.startswith(_GRAVITY)}
