"""Spacecraft near an asteroid that turns, in the Hill frame of its elliptic orbit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import cos as cosine
from math import sin as sine
from types import MappingProxyType

import numpy as np

from hillsphere.base.constants import AU_M
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.gravity import AnyGravityModel, acceleration_at, whole_gravity
from hillsphere.interfaces import (
    Array,
    ArraySurface,
    BoundedSeries,
    Enclosed,
    GravityModel,
    Parameter,
    Piecewise,
    Scales,
    SeriesGravity,
    Surface,
    Variable,
)
from hillsphere.model.bodies import OrbitingBody
from hillsphere.model.ephemeris import anomaly_from_mean, from_equator
from hillsphere.model.frame_motion import FrameMotion
from hillsphere.model.shapes.levels import level_within
from hillsphere.symbolic import (
    Expr,
    Overloaded,
    Params,
    Vec3,
    constant,
    dot,
    minimum,
    parameter,
    power,
    sum_of,
    variable,
)
from hillsphere.symbolic import (
    time as symbolic_time,
)
from hillsphere.time import Epoch
from hillsphere_plants.moon_centred import CONTROLS, POSITION_AND_VELOCITY, moon_of, vector
from hillsphere_plants.proximity_frame import frame_at
from hillsphere_plants.proximity_orbit import (
    OrbitPoint,
    axes_of,
    body_turn,
    orbit_at,
    orbit_known,
    orbit_terms,
)
from hillsphere_plants.proximity_specs import ProximitySpec
from hillsphere_plants.proximity_start import HillFrame
from hillsphere_plants.tidal import tidal_acceleration
from hillsphere_plants.turning import turning_motion

__all__ = ["Proximity", "of_gravity"]

_GRAVITY = "gravity."
_NOMINAL: Mapping[str, float] = MappingProxyType({})


class Proximity:
    r"""Motion of spacecraft about an asteroid, seen from the frame that turns with its orbit.

    In the frame ``hill:BODY`` (x away from the Sun, y along the motion, z the orbit normal), with
    the true anomaly f of the asteroid, its distance R from the Sun at :math:`d = (-R, 0, 0)`, each
    spacecraft moves by [1]_

    .. math::

        \ddot r = \nabla U - GM\left[\frac{r-d}{|r-d|^3} + \frac{d}{R^3}\right]
        - 2\omega\times\dot r - \dot\omega\times r - \omega\times(\omega\times r)
        + \frac{C_R A}{m} P_0 \frac{\mathrm{au}^2}{R^2}\, \hat x + u, \quad
        \omega = \dot f\,\hat z .

    The attraction of the Sun is written without cancellation. The asteroid turns uniformly among
    the stars; at the obliquity 0 its longitude 0 stands at the angle :math:`\varphi = \varphi_0 +
    w t - (f - f_0)` from +x. Time counts from where the true anomaly is f₀. Spacecraft do not
    attract each other.

    Parameters
    ----------
    spec : ProximitySpec
        With its references bound. Run-time parameters: ``primary_gm``, ``semi_major_axis``,
        ``eccentricity``, ``true_anomaly`` and ``rotation_angle`` at time 0, ``rotation_rate``; for
        each spacecraft under radiation pressure ``radiation1`` …, its C_R A/m; those of the gravity
        model, as ``gravity.NAME``.

    Raises
    ------
    InputError
        If the body has no rotation rate.

    References
    ----------
    .. [1] Schaub, H., Junkins, J. L., Analytical Mechanics of Space Systems, 2nd ed., AIAA, 2009,
       chapter 14.
    """

    def __init__(self, spec: ProximitySpec) -> None:
        body = moon_of(spec.body)
        if body.rotation_rate_rad_s is None:
            raise InputError(
                f"proximity: body {body.name!r} has no rotation_rate; give it one "
                "(rotation_rate_deg_d), as a body of type 'asteroid' has"
            )
        self._model: AnyGravityModel = whole_gravity(spec.gravity.get(), body.semi_axes_m)
        self.spec = spec
        self.body: OrbitingBody = body
        self.body_name: str = body.name
        self.spacecraft: tuple[str, ...] = tuple(
            craft.name or f"spacecraft {i + 1}" for i, craft in enumerate(spec.spacecraft)
        )
        self.primary_gm_m3_s2: float = body.primary_gm_m3_s2
        self.primary_distance_m: float = body.semi_major_axis_m
        self.eccentricity: float = body.eccentricity
        self.rotation_rate_rad_s: float = body.rotation_rate_rad_s
        self.prime_meridian_rad: float = spec.rotation_angle_rad
        self.true_anomaly_rad: float = _start(spec, body)
        self._tilt = (cosine(body.obliquity_rad), sine(body.obliquity_rad))
        self._radiation = [
            craft.reflectivity * craft.area_to_mass_m2_kg * bool(spec.radiation_pressure_n_m2)
            for craft in spec.spacecraft
        ]
        shape = body.shape or (None if body.semi_axes_m else self._model)
        self._surface = shape if isinstance(shape, Surface | ArraySurface) else None

    @property
    def frame(self) -> str:
        """``hill:BODY``."""
        return f"hill:{self.body_name}"

    @property
    def states(self) -> tuple[Variable, ...]:
        """Position and velocity of the first spacecraft, then of the next; x1 … if several."""
        return self._number_variables(POSITION_AND_VELOCITY)

    @property
    def controls(self) -> tuple[Variable, ...]:
        """Three accelerations a spacecraft."""
        return self._number_variables(CONTROLS)

    @property
    def scales(self) -> Scales:
        """Natural units of the body's rotation: (Gm/w²)^(1/3) and 1/w."""
        rate = self.rotation_rate_rad_s
        return Scales((self.gm_m3_s2 / rate**2) ** (1.0 / 3.0), 1.0 / rate)

    @cached_property
    def gravity(self) -> GravityModel:
        """The gravity model."""
        model: GravityModel = self._model  # type: ignore[assignment]  # the factory has chosen
        return model

    @property
    def gm_m3_s2(self) -> float:
        """Gravitational parameter of the asteroid, m³/s²."""
        return self._model.gm_m3_s2

    @property
    def semi_axes_m(self) -> tuple[float, float, float] | None:
        """Semi-axes of the surface in the body-fixed frame, m; None if it has none."""
        return self.body.semi_axes_m if self._surface is None else self._surface.semi_axes_m()

    @property
    def surface(self) -> Surface | ArraySurface | None:
        """The surface in the body-fixed frame, if it is more than `semi_axes_m`."""
        return self._surface

    @property
    def gravity_name(self) -> str:
        """Kind of the gravity model in words, for legends: ``"point mass"``."""
        return " ".join(re.findall("[A-Z][a-z0-9]*", type(self._model).__name__)).lower()

    @property
    def series_radius_m(self) -> float | None:
        """Radius inside which the gravity is a series without guarantee; None if it is none.

        The largest radius of the surface, or without one the reference radius of the series.
        """
        series = self._model.series_radius_m if isinstance(self._model, SeriesGravity) else None
        if isinstance(self._model, BoundedSeries):
            return series
        if series is None or self.semi_axes_m is None:
            return series
        if isinstance(self._surface, Enclosed):
            return self._surface.largest_radius_m
        return max(self.semi_axes_m)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of orbit, rotation, pressure and, prefixed, of the gravity."""
        gravity = (replace(q, name=_GRAVITY + q.name) for q in self._model.parameters())
        return (*self._own, *gravity)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI."""
        orbit = orbit_known(p) or orbit_at(t, p)
        rows = self._body_rows(orbit, t, p)
        sun = (-orbit.distance, constant(0.0), constant(0.0))
        rates: list[Expr] = []
        for i in range(len(self.spacecraft)):
            own, command = x[6 * i : 6 * i + 6], u[3 * i : 3 * i + 3]
            r = vector(own[:3])
            pull = self._attraction(i, rows, r, p)
            tide = tidal_acceleration(r, sun, orbit.distance, p["primary_gm"])
            # radiation pressure acts along +x, away from the Sun
            pushed = (sum_of([command[0], self._pressure(i, orbit, p)]), *command[1:])
            rates += turning_motion(own, pushed, pull, tide, orbit.rate, orbit.acceleration)
        return tuple(rates)

    def time_terms(self, t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return the expressions of the orbit, which depend on time alone and are costly."""
        return orbit_terms(orbit_at(t, p))

    def disturbances(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return the accelerations, m/s², that a simple law cancels.

        They are the attraction as of a point mass, and radiation pressure: three expressions a
        spacecraft, like its controls.
        """
        orbit = orbit_known(p) or orbit_at(t, p)
        accelerations: list[Expr] = []
        for i in range(len(self.spacecraft)):
            r = x[6 * i : 6 * i + 3]
            pull = -self._gm(p) * power(dot(r, r), -1.5)
            accelerations += [
                sum_of([pull * r[0], self._pressure(i, orbit, p)]),
                pull * r[1],
                pull * r[2],
            ]
        return tuple(accelerations)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return ``impact`` (if the body has a surface) and ``escape`` (if it is asked for).

        Both are those of the first spacecraft to meet them.
        """
        places = [vector(x[i : i + 3]) for i in range(0, len(x), 6)]
        events: dict[str, Expr] = {}
        if self.semi_axes_m is not None:
            rows = self._body_rows(orbit_at(t, p), t, p)
            levels = [self._level(i, axes_of(rows, r)) for i, r in enumerate(places)]
            events["impact"] = _least(levels)
        if self.spec.escape_radius_m is not None:
            far = self.spec.escape_radius_m**2
            events["escape"] = _least([1.0 - dot(r, r) / far for r in places])
        return events

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return functions at whose zeros the gravity model changes branch.

        An ellipsoid does at its surface.
        """
        model = self._model
        if not isinstance(model, Piecewise):
            return ()
        rows = self._body_rows(orbit_at(t, p), t, p)
        places = [vector(x[i : i + 3]) for i in range(0, len(x), 6)]
        inner = of_gravity(p)
        return tuple(e for r in places for e in model.switches(axes_of(rows, r), inner))

    @property
    def event_terms(self) -> tuple[Variable, ...]:
        """Levels over a surface that is a function of arrays (see `ExternalEvents`)."""
        arrays = isinstance(self._surface, ArraySurface) and not isinstance(self._surface, Surface)
        return tuple(
            Variable(f"surface:level{i + 1}", unit="-")
            for i in range(len(self.spacecraft) if arrays else 0)
        )

    def event_terms_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the levels (S, N) over that surface at states x (6 S, N)."""
        if not isinstance(self._surface, ArraySurface):
            return np.zeros((0, x.shape[1]))
        places, _ = self._body_places(x, t, p)
        flat = self._surface.surface_array(places.reshape(3, -1))
        return flat.reshape(len(self.spacecraft), -1)

    def scene(self, t_s: Array, **values: Array | float) -> dict[str, Array]:
        """Return the Sun's position and the body's orientation at times (N,), for sensors.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            Times, s.
        **values : ndarray, shape (N,), or float
            Parameters of the motion that differ from the nominal, e.g. ``rotation_rate``, SI.

        Returns
        -------
        dict of str to ndarray
            ``"sun"``, shape (3, N): position of the Sun in the plant's frame, m; ``"to_body"``,
            (3, 3, N): matrices from that frame to the body's.

        Raises
        ------
        InputError
            If the motion has no such parameter.
        """
        table = self._surroundings_at(t_s, values)
        sun = np.zeros((3, table.shape[1]))
        sun[0] = -table[0]
        return {"sun": sun, "to_body": table[2:].reshape(3, 3, -1)}

    @property
    def epoch(self) -> str | None:
        """Date (TDB) of time 0, where the body's mean anomaly says where the asteroid is then."""
        given = self.spec.true_anomaly_rad is not None or self.body.mean_anomaly_rad is None
        return None if given else self.body.epoch

    @property
    def oriented(self) -> bool:
        """Whether the body gives all angles of its orbit, so that heliocentric axes are known."""
        body = self.body
        return None not in (body.inclination_rad, body.node_rad, body.periapsis_rad)

    def heliocentric(self, t_s: Array, **values: Array | float) -> dict[str, Array]:
        """Return the heliocentric state and axes of the frame at times (N,), for sensors.

        Parameters
        ----------
        t_s, **values
            As of `scene`.

        Returns
        -------
        dict of str to ndarray
            ``"origin"``, shape (6, N), ``"axes"``, (3, 3, N), and ``"rate"``, (3, N), as in
            `hillsphere_plants.proximity_frame.frame_at`. The axes are the ecliptic and equinox of
            J2000 if the plant is `oriented`, otherwise arbitrary ones.
        """
        t = np.atleast_1d(np.asarray(t_s, dtype=float))
        return frame_at(t, self.body, {q.name: q.value for q in self._own} | values)

    def turning_frame(self, time_s: float) -> HillFrame:
        """Return the Hill frame at a time, about which starts in other forms are placed."""
        frame = self.heliocentric(np.array([time_s]))
        return HillFrame(
            (self.body_name, self.body.primary_name), (self.gm_m3_s2, self.primary_gm_m3_s2),
            frame["origin"][:, 0], frame["axes"][..., 0], frame["rate"][:, 0],
            self.oriented, None if self.epoch is None else Epoch.parse(self.epoch, "TDB"), time_s,
        )  # fmt: skip

    def frame_motion(self, epoch: Epoch, t_s: Array, others: Mapping[str, Array]) -> FrameMotion:
        """Return the Hill frame at times (K,) after an epoch; see `hillsphere.model.frame_motion`.

        Where the body's mean anomaly has a date, that is time 0 of the plant's clock; otherwise the
        epoch is.
        """
        if not self.oriented:
            raise InputError(
                f"body {self.body_name!r} does not say how its orbit stands among the stars: give "
                "it inclination_deg, node_deg and periapsis_deg"
            )
        zero = None if self.epoch is None else Epoch.parse(self.epoch, "TDB")
        ahead = 0.0 if zero is None else epoch.seconds_since(zero)
        there = self.heliocentric(t_s + ahead)
        origin, axes = there["origin"], there["axes"]
        away = [np.einsum("jin,jn->in", axes, q) for q in (origin[:3], origin[3:])]
        to_icrf = from_equator(np.eye(3)[:, :, None])[:, :, 0]
        return FrameMotion(
            np.einsum("ij,jkn->ikn", to_icrf, axes),
            there["rate"],
            {
                self.body_name: np.zeros((6, t_s.size)),
                self.body.primary_name: -np.concatenate(away),
            },
        )

    def others_over_time(self, start: Mapping[str, float], t_s: Array) -> Mapping[str, Array]:
        """Return none: positions and velocities are all states."""
        return {}

    def anomaly(self, t_s: Array) -> Array:
        """Return the true anomaly f (N,), rad, of the asteroid at times (N,)."""
        travelled: Array = self._surroundings_at(t_s)[1]
        return self.true_anomaly_rad + travelled

    def noise_sigma(self, t_s: Array) -> Array:
        """Return the standard deviations (p, N), m/s², of the random accelerations.

        One row per control: each is drawn anew at each step of a simulation and held over it.
        """
        distance = self._distance(np.reshape(t_s, (1, -1)))[0]
        pressure = self.spec.radiation_pressure_n_m2 * (AU_M / distance) ** 2
        sigma = np.full(
            (3 * len(self.spacecraft), distance.size), self.spec.acceleration_noise_m_s2
        )
        # independent errors of the pressure along x and of the accelerations: root of the sum
        for i, value in enumerate(self._radiation):
            sigma[3 * i] = np.hypot(sigma[3 * i], self.spec.radiation_noise * value * pressure)
        return sigma

    @cached_property
    def _own(self) -> tuple[Parameter, ...]:
        """Parameters of the motion itself."""
        own = [
            Parameter("primary_gm", self.primary_gm_m3_s2, "m3/s2", positive=True),
            Parameter("semi_major_axis", self.primary_distance_m, "m", positive=True),
            Parameter("eccentricity", self.eccentricity),
            Parameter("true_anomaly", self.true_anomaly_rad, "rad"),
            Parameter("rotation_rate", self.rotation_rate_rad_s, "rad/s", positive=True),
            Parameter("rotation_angle", self.spec.rotation_angle_rad, "rad"),
        ]
        own += [
            Parameter(f"radiation{i + 1}", value, "m2/kg")
            for i, value in enumerate(self._radiation)
            if value
        ]
        return tuple(own)

    @cached_property
    def _nominal(self) -> Array:
        """Their nominal values (k,)."""
        return np.array([q.value for q in self._own])

    @cached_property
    def _distance(self) -> ArrayFunction:
        """Distance of the Sun at nominal parameters, of time."""
        when = variable("when")
        p = {q.name: constant(q.value) for q in self._own}
        return ArrayFunction([orbit_at(when, p).distance], [when])

    @cached_property
    def _surroundings(self) -> ArrayFunction:
        """Distance of the Sun, f − f₀ and the nine elements of the turn to the body.

        Of time and the parameters of the motion.
        """
        names = [q.name for q in self._own]
        p = {name: parameter(name) for name in names}
        orbit = orbit_at(symbolic_time, p)
        flat = [e for row in self._body_rows(orbit, symbolic_time, p) for e in row]
        return ArrayFunction([orbit.distance, orbit.travelled, *flat], [variable("unused")], names)

    def _surroundings_at(self, t_s: Array, values: Mapping[str, Array | float] = _NOMINAL) -> Array:
        t = np.atleast_1d(np.asarray(t_s, dtype=float))
        p = self._nominal
        if values:
            names = [q.name for q in self._own]
            if unknown := sorted(set(values) - set(names)):
                raise InputError(
                    f"the motion has no parameter {', '.join(unknown)}; it has {', '.join(names)}"
                )
            p = np.array([np.broadcast_to(values.get(q.name, q.value), t.shape) for q in self._own])
        return self._surroundings(np.zeros((1, t.size)), p, t)

    def _body_rows(self, orbit: OrbitPoint, t: Expr, p: Params) -> tuple[Vec3, Vec3, Vec3]:
        return body_turn(t, p, orbit.travelled, self.body.equinox_anomaly_rad, self._tilt)

    def _pressure(self, craft: int, orbit: OrbitPoint, p: Params) -> Expr:
        """Return the acceleration of radiation pressure, away from the Sun."""
        if not self._radiation[craft]:
            return constant(0.0)
        near = AU_M / orbit.distance
        return p[f"radiation{craft + 1}"] * (self.spec.radiation_pressure_n_m2 * near * near)

    def _gm(self, p: Params) -> Expr:
        """Return the body's GM: following the parameter ``gm`` where the gravity has one."""
        nominal = {q.name: q.value for q in self._model.parameters()}.get("gm")
        if not nominal:
            return constant(self.gm_m3_s2)
        return p[_GRAVITY + "gm"] * (self.gm_m3_s2 / nominal)

    def _attraction(self, craft: int, rows: Sequence[Vec3], r: Vec3, p: Params) -> Vec3:
        """Return the asteroid's attraction at r, in the plant's frame, m/s²."""
        force = acceleration_at(self.gravity, axes_of(rows, r), of_gravity(p))
        return axes_of(rows, force, back=True)

    def _level(self, craft: int, place: Vec3) -> Expr:
        if self._surface is not None and isinstance(place[0], Overloaded):
            return level_within(self._surface, place)
        if self.event_terms:
            return variable(self.event_terms[craft].name)
        if isinstance(self._surface, Surface):
            return self._surface.surface(place)
        assert self.body.semi_axes_m is not None
        squares = [q * q / (a * a) for q, a in zip(place, self.body.semi_axes_m, strict=True)]
        return sum_of([*squares, -1.0])

    def _body_places(self, x: Array, t: Array, p: Array) -> tuple[Array, Array]:
        """Return positions (3, S, N) in the body's axes, and the turns (3, 3, N) to them."""
        turn = self._surroundings(np.zeros((1, t.size)), p[: len(self._own)], t)[2:]
        turn = turn.reshape(3, 3, -1)
        places = x.reshape(-1, 6, x.shape[1])[:, :3]
        return np.einsum("ijn,sjn->isn", turn, places), turn

    def _number_variables(self, of_one: Sequence[Variable]) -> tuple[Variable, ...]:
        count = len(self.spacecraft)
        if count == 1:
            return tuple(of_one)
        return tuple(replace(v, name=f"{v.name}{i + 1}") for i in range(count) for v in of_one)


def _start(spec: ProximitySpec, body: OrbitingBody) -> float:
    """Return the true anomaly at time 0."""
    if spec.true_anomaly_rad is not None:
        return spec.true_anomaly_rad
    if body.mean_anomaly_rad is None:
        return 0.0
    return float(anomaly_from_mean(np.array([body.mean_anomaly_rad]), body.eccentricity)[0])


def _least(values: Sequence[Expr]) -> Expr:
    least = values[0]
    for value in values[1:]:
        least = minimum(least, value)
    return least


def of_gravity(p: Params) -> Params:
    """Return the parameters of a plant's gravity under the names of the gravity model."""
    return {k.removeprefix(_GRAVITY): v for k, v in p.items() if k.startswith(_GRAVITY)}
