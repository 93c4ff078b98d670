"""Small bodies: moons and asteroids on Keplerian orbits, with their rotation."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from pydantic import model_validator

from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2
from hillsphere.base.contracts import Contract
from hillsphere.base.ranges import BODY_RADIUS_M, ORBIT_RADIUS_M, ROTATION_RAD_S
from hillsphere.spec.base import Ref, Spec, Vector3, option, quantity, reference, rule

if TYPE_CHECKING:
    from hillsphere.interfaces.surface import ArraySurface, Surface

__all__ = ["AsteroidSpec", "Moon", "MoonSpec", "OrbitingBody", "Orientation", "SurfacedBody"]


class MoonSpec(Spec):
    """A small moon on a Keplerian orbit around its primary."""

    examples = (
        {
            "primary_gm_km3_s2": 42828.37,
            "semi_major_axis_km": 9377.0,
            "pole_right_ascension_deg": 317.67,
            "pole_declination_deg": 52.89,
            "prime_meridian_deg": 35.19,
        },
        {
            "primary_gm_km3_s2": 42828.37,
            "semi_major_axis_km": 9376.0,
            "eccentricity": 0.0151,
            "libration_amplitude_deg": -1.09,
        },
    )

    name: str = option("name used in frames and figures", default="body", min_length=1)
    primary_gm_m3_s2: float = quantity(
        "gravitational_parameter", "gravitational parameter of the primary", gt=0, ge=1e-20
    )
    semi_major_axis_m: float = quantity("length", "semi-major axis of the orbit", **ORBIT_RADIUS_M)
    eccentricity: float = option(
        "eccentricity of the orbit, for plants that move the moon on its ellipse",
        default=0.0,
        ge=0,
        lt=1,
    )
    libration_amplitude_rad: float = quantity(
        "angle",
        "amplitude A of the physical libration in longitude: the moon has turned by M + A sin M "
        "at the mean anomaly M; forced libration is negative where the free one is slower than "
        "the orbit (Phobos: -1.09°); for plants whose moon librates",
        default=0.0,
    )
    primary_name: str = option("name of the primary, for files", default="primary", min_length=1)
    pole_right_ascension_rad: float | None = quantity(
        "angle", "right ascension α0 of the north pole, ICRF, IAU convention", default=None
    )
    pole_declination_rad: float | None = quantity(
        "angle", "declination δ0 of the north pole, ICRF", default=None, ge=-pi / 2, le=pi / 2
    )
    prime_meridian_rad: float | None = quantity(
        "angle", "angle W of longitude 0 at J2000.0 TDB, IAU convention", default=None
    )
    rotation_rate_rad_s: float | None = quantity(
        "angular_rate",
        "rate of W, by which it is carried to an epoch, and at which a body with a spin of its own "
        "turns; left out: the mean motion",
        default=None,
        **ROTATION_RAD_S,
    )
    semi_axes_m: Vector3 | None = quantity(
        "length",
        "semi-axes of the body's surface along x, y, z, for impacts; left out: that of the shape, "
        "or else of the gravity model, if it has one",
        default=None,
        **BODY_RADIUS_M,
    )
    shape: Ref | None = reference(
        "shape", "the body's surface, for impacts and landing sites, if not semi-axes", default=None
    )

    @model_validator(mode="after")
    def _one_surface(self) -> Self:
        if self.shape is not None and self.semi_axes_m is not None:
            text = "shape and semi-axes both give the surface; keep one"
            raise rule("shape", text)
        return self

    @model_validator(mode="after")
    def _whole_orientation(self) -> Self:
        keys = ("pole_right_ascension_rad", "pole_declination_rad", "prime_meridian_rad")
        given = [key for key in keys if getattr(self, key) is not None]
        if given and len(given) < len(keys):
            missing = next(key for key in keys if key not in given)
            needed = ", ".join(key.removesuffix("_rad") + "_deg" for key in keys)
            missing = missing.removesuffix("_rad")
            text = f"missing: {missing}_deg (or _rad); an orientation needs {needed}"
            raise rule(given[0], text)
        return self


class AsteroidSpec(MoonSpec):
    """An asteroid that rotates uniformly, on a Keplerian orbit around the Sun."""

    examples = (
        {
            "name": "eros",
            "semi_major_axis_m": 2.18e11,
            "eccentricity": 0.22,
            "rotation_rate_deg_d": 1639.389232,
            "shape": "ellipsoid",
            "inclination_deg": 10.8,
            "node_deg": 304.3,
            "periapsis_deg": 178.9,
        },
        {
            "semi_major_axis_m": 1.7e11,
            "rotation_rate_deg_d": 2011.1,
            "semi_axes_m": [280, 270, 250],
        },
    )

    primary_name: str = option("name of the primary, for files", default="sun", min_length=1)
    primary_gm_m3_s2: float = quantity(
        "gravitational_parameter",
        "gravitational parameter of the primary; left out: the Sun's nominal value",
        default=NOMINAL_SOLAR_GM_M3_S2,
        gt=0,
        ge=1e-20,
    )
    rotation_rate_rad_s: float = quantity(
        "angular_rate", "rate of the spin about +z, among the stars", **ROTATION_RAD_S
    )
    obliquity_rad: float = quantity(
        "angle", "angle between spin axis and orbit normal", default=0.0, ge=0, le=pi
    )
    equinox_anomaly_rad: float = quantity(
        "angle",
        "true anomaly at which the primary comes north over the equator; with an obliquity of 0 "
        "only where the rotation angle is counted from",
        default=0.0,
    )
    inclination_rad: float | None = quantity(
        "angle", "inclination of the orbit, ecliptic J2000", default=None, ge=0, le=pi
    )
    node_rad: float | None = quantity(
        "angle", "longitude of the ascending node, ecliptic and equinox J2000", default=None
    )
    periapsis_rad: float | None = quantity("angle", "argument of periapsis", default=None)
    mean_anomaly_rad: float | None = quantity(
        "angle", "mean anomaly at the epoch; without one, at t = 0", default=None
    )
    epoch: str | None = option(
        "epoch (TDB) of the mean anomaly; left out: the epoch of t = 0",
        default=None,
        max_length=40,
    )


@dataclass(frozen=True)
class Orientation:
    """Orientation of a body in the ICRF by the IAU's angles, without periodic terms.

    Parameters
    ----------
    right_ascension_rad, declination_rad : float
        North pole, α0 and δ0.
    prime_meridian_rad : float
        W at J2000.0 TDB: from the ascending node of the body's equator on that of the ICRF,
        eastward to longitude 0.
    rate_rad_s : float
        Rate of W.

    References
    ----------
    .. [1] Archinal, B. A., et al., Report of the IAU Working Group on Cartographic Coordinates and
       Rotational Elements: 2015, Celest. Mech. Dyn. Astron. 130, 22, 2018, section 2.
    """

    right_ascension_rad: float
    declination_rad: float
    prime_meridian_rad: float
    rate_rad_s: float


@runtime_checkable
class SurfacedBody(Contract, Protocol):
    """A body that may have a surface, given by semi-axes (m) or by a shape."""

    semi_axes_m: tuple[float, float, float] | None
    shape: Surface | ArraySurface | None


@runtime_checkable
class OrbitingBody(SurfacedBody, Protocol):
    """Interface of a small body on a Keplerian orbit, for plants and sensors; see `Moon`.

    Unknown elements, epoch, orientation and rotation rate are ``None``.
    """

    name: str
    primary_name: str
    primary_gm_m3_s2: float
    semi_major_axis_m: float
    eccentricity: float
    libration_amplitude_rad: float
    rotation_rate_rad_s: float | None
    obliquity_rad: float
    equinox_anomaly_rad: float
    inclination_rad: float | None
    node_rad: float | None
    periapsis_rad: float | None
    mean_anomaly_rad: float | None
    epoch: str | None
    orientation: Orientation | None

    @property
    def mean_motion_rad_s(self) -> float:
        """Mean motion √(GM/a³) of a body of negligible mass, rad/s."""
        ...


class Moon:
    """A small body on a Keplerian orbit around its primary: a moon, or an asteroid.

    Parameters
    ----------
    spec : MoonSpec
        Its parameters.
    """

    def __init__(self, spec: MoonSpec) -> None:
        self.name = spec.name
        self.primary_gm_m3_s2 = spec.primary_gm_m3_s2
        self.semi_major_axis_m = spec.semi_major_axis_m
        self.eccentricity = spec.eccentricity
        self.libration_amplitude_rad = spec.libration_amplitude_rad
        self.shape: Surface | ArraySurface | None = spec.shape.get() if spec.shape else None
        self.semi_axes_m = spec.semi_axes_m if self.shape is None else self.shape.semi_axes_m()
        self.rotation_rate_rad_s = spec.rotation_rate_rad_s
        self.obliquity_rad = self.equinox_anomaly_rad = 0.0
        self.inclination_rad: float | None = None
        self.node_rad: float | None = None
        self.periapsis_rad: float | None = None
        self.mean_anomaly_rad: float | None = None
        self.epoch: str | None = None
        if isinstance(spec, AsteroidSpec):
            self.obliquity_rad = spec.obliquity_rad
            self.equinox_anomaly_rad = spec.equinox_anomaly_rad
            self.inclination_rad, self.node_rad = spec.inclination_rad, spec.node_rad
            self.periapsis_rad, self.mean_anomaly_rad = spec.periapsis_rad, spec.mean_anomaly_rad
            self.epoch = spec.epoch
        self.primary_name = spec.primary_name
        self.orientation: Orientation | None = None
        ra, dec, w = (
            spec.pole_right_ascension_rad, spec.pole_declination_rad, spec.prime_meridian_rad
        )  # fmt: skip
        if ra is not None and dec is not None and w is not None:
            rate = spec.rotation_rate_rad_s or self.mean_motion_rad_s
            self.orientation = Orientation(ra, dec, w, rate)

    @property
    def mean_motion_rad_s(self) -> float:
        """Mean motion √(GM/a³) of a body of negligible mass, rad/s."""
        return sqrt(self.primary_gm_m3_s2 / self.semi_major_axis_m**3)
