"""Ephemerides of bodies on Keplerian orbits around the Sun, and their Hill frames.

States are rows of position (m) and velocity (m/s), heliocentric, in the axes of ecliptic and
equinox J2000. Elements describe ellipses; `kepler_step` also propagates hyperbolas.

References
----------
.. [1] Battin, R. H., An Introduction to the Mathematics and Methods of Astrodynamics, revised
   edition, AIAA, 1999, sections 3.3, 4.3 and 5.3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch

if TYPE_CHECKING:
    from hillsphere.model.bodies import OrbitingBody
    from hillsphere.model.ephemeris_specs import KeplerOrbitSpec

__all__ = [
    "ECLIPTIC_OBLIQUITY_RAD",
    "Ephemeris",
    "KeplerOrbit",
    "anomaly_from_mean",
    "from_equator",
    "hill_axes",
    "kepler_step",
    "mean_from_true",
    "states_of_elements",
]

ECLIPTIC_OBLIQUITY_RAD = 84381.448 / 3600.0 * np.pi / 180.0
"""Obliquity of the ecliptic at J2000 (IAU 1976), the convention of published elements."""

_ITERATIONS = 60
"""Most iterations for Kepler's equation. Newton's method takes about five; bisection alone, where
every Newton step leaves its bracket, reaches rounding after 54."""


@runtime_checkable
class Ephemeris(Contract, Protocol):
    """The position and velocity of a body in the Solar System over time."""

    @property
    def name(self) -> str:
        """Name, for tables and figures."""
        ...

    def states(self, t_s: Array, epoch: Epoch | None = None) -> Array:
        """Return the heliocentric states (6, N), m and m/s, at times (N,), s after an epoch.

        The axes are those of ecliptic and equinox J2000. Without an epoch, times count from the
        epoch of the body.
        """
        ...


@runtime_checkable
class FixedOrbit(Contract, Protocol):
    """A body with constant orbital elements, such as `KeplerOrbit`.

    ``elements``, shape (6,), are a (m), e, i, Ω, ω, M (rad); ``gm_m3_s2`` is that of the Sun.
    """

    elements: Array
    gm_m3_s2: float


class KeplerOrbit:
    """A body on a Keplerian ellipse around the Sun.

    Parameters
    ----------
    spec : KeplerOrbitSpec
        Its elements.
    """

    def __init__(self, spec: KeplerOrbitSpec) -> None:
        self.name = spec.name
        self.gm_m3_s2 = spec.primary_gm_m3_s2
        self.epoch: Epoch | None = Epoch.parse(spec.epoch, "TDB")
        self.elements = np.array(
            [
                spec.semi_major_axis_m,
                spec.eccentricity,
                spec.inclination_rad,
                spec.node_rad,
                spec.periapsis_rad,
                spec.mean_anomaly_rad,
            ]
        )

    @classmethod
    def of(cls, body: OrbitingBody, mean_anomaly_rad: float | None = None) -> KeplerOrbit:
        """Return the orbit of a body of type ``asteroid`` with all six elements.

        If the body has no epoch (`Moon.epoch`), its mean anomaly is valid at the origin of the
        times.

        Parameters
        ----------
        body : OrbitingBody
            The body.
        mean_anomaly_rad : float, optional
            Mean anomaly at the origin of the times; by default the body's own.

        Returns
        -------
        KeplerOrbit
            The orbit.

        Raises
        ------
        InputError
            If an element is missing.
        """
        mean = body.mean_anomaly_rad if mean_anomaly_rad is None else mean_anomaly_rad
        angles = (body.inclination_rad, body.node_rad, body.periapsis_rad, mean)
        keys = ("inclination", "node", "periapsis", "mean_anomaly")
        given = [value for value in angles if value is not None]
        if len(given) < len(keys):
            missing = [f"{k}_deg" for k, v in zip(keys, angles, strict=True) if v is None]
            raise InputError(
                f"body {body.name!r} lacks {', '.join(missing)}: its place in the Solar System "
                "needs all elements of its orbit"
            )
        made = cls.__new__(cls)
        made.name, made.gm_m3_s2 = body.name, body.primary_gm_m3_s2
        own = body.epoch if mean_anomaly_rad is None else None
        made.epoch = None if own is None else Epoch.parse(own, "TDB")
        made.elements = np.array([body.semi_major_axis_m, body.eccentricity, *given])
        return made

    def states(self, t_s: Array, epoch: Epoch | None = None) -> Array:
        """Return the heliocentric states (6, N) at times (N,).

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            Seconds after the epoch.
        epoch : Epoch, optional
            Origin of the times; by default the epoch of the elements.
        """
        t = np.atleast_1d(np.asarray(t_s, dtype=float))
        a = self.elements[0]
        rate = np.sqrt(self.gm_m3_s2 / a**3)
        since = 0.0
        if epoch is not None and self.epoch is not None:
            since = epoch.to("TDB").seconds_since(self.epoch)
        elements = np.repeat(self.elements[:, None], t.size, axis=1)
        elements[5] = np.remainder(elements[5] + rate * since, 2.0 * np.pi) + rate * t
        return states_of_elements(elements, self.gm_m3_s2)


def anomaly_from_mean(mean_rad: Array, eccentricity: float | Array) -> Array:
    """Return the true anomaly f (N,), rad, in the same revolution as the mean anomaly M (N,)."""
    mean, e = np.broadcast_arrays(np.asarray(mean_rad, float), np.asarray(eccentricity, float))
    # From E₀ = 0 Kepler's equation is D − e sin D = M. The true anomaly follows from
    # tan((f − E)/2) = β sin E / (1 − β cos E), which is never near a pole.
    eccentric = _difference(e * 0.0, e, mean)
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    sine, cosine = np.sin(eccentric), np.cos(eccentric)
    return np.asarray(eccentric + 2.0 * np.arctan2(beta * sine, 1.0 - beta * cosine))


def mean_from_true(true_rad: Array, eccentricity: float | Array) -> Array:
    """Return the mean anomaly M (N,), rad, in the same revolution as the true anomaly f (N,)."""
    true, e = np.broadcast_arrays(np.asarray(true_rad, float), np.asarray(eccentricity, float))
    # tan((f - E)/2) = β sin f / (1 + β cos f), which is never near a pole
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    sine, cosine = np.sin(true), np.cos(true)
    eccentric = true - 2.0 * np.arctan2(beta * sine, 1.0 + beta * cosine)
    return np.asarray(eccentric - e * np.sin(eccentric))


def states_of_elements(elements: Array, gm_m3_s2: Array | float) -> Array:
    """Return the states (6, N) of elements a (m), e, i, Ω, ω, M (rad), shape (6, N).

    Raises
    ------
    InputError
        If an element is not finite, a ≤ 0, or e outside [0, 1).
    """
    a, e, i, node, periapsis, mean = np.asarray(elements, dtype=float)
    if not np.isfinite(elements).all() or not (a > 0).all() or not ((e >= 0) & (e < 1)).all():
        raise InputError("elements must be finite, with a > 0 and 0 ≤ e < 1")
    eccentric = _difference(e * 0.0, e, mean)
    c, s, root = np.cos(eccentric), np.sin(eccentric), np.sqrt(1.0 - e * e)
    # Position and velocity along the perifocal axes p (to the periapsis) and q, with
    # r = a (1 − e cos E) and dE/dt = √(GM/a) / r.
    speed = np.sqrt(gm_m3_s2 * a) / (a * (1.0 - e * c))
    plane = np.array([[a * (c - e), a * root * s], [-speed * s, speed * root * c]])
    cw, sw, ci, si, co, so = (f(angle) for angle in (periapsis, i, node) for f in (np.cos, np.sin))
    p = np.array([co * cw - so * sw * ci, so * cw + co * sw * ci, sw * si])
    q = np.array([-co * sw - so * cw * ci, -so * sw + co * cw * ci, cw * si])
    return np.concatenate([part[0] * p + part[1] * q for part in plane])


def kepler_step(states: Array, duration_s: Array | float, gm_m3_s2: float) -> Array:
    """Propagate heliocentric states (6, N) on Keplerian orbits over durations (N,) of either sign.

    From the escape speed on the orbit is a hyperbola; a parabola is replaced by a hyperbola that
    hardly differs from it.
    """
    x = np.asarray(states, dtype=float)
    dt = np.broadcast_to(np.asarray(duration_s, dtype=float), x.shape[1:])
    r0 = np.sqrt(np.sum(x[:3] ** 2, axis=0))
    inverse = 2.0 / r0 - np.sum(x[3:] ** 2, axis=0) / gm_m3_s2
    escaping = inverse <= 0.0
    if escaping.any():
        propagated = np.full(x.shape, np.nan)
        propagated[:, escaping] = _hyperbolic_step(x[:, escaping], dt[escaping], gm_m3_s2)
        bound = ~escaping
        if bound.any():
            propagated[:, bound] = kepler_step(x[:, bound], dt[bound], gm_m3_s2)
        return propagated
    # Lagrange's coefficients by the change D of the eccentric anomaly ([1]_, section 4.3), with
    # e sin E₀ = r·v/√(GM a) and e cos E₀ = 1 − r₀/a. c is 1 − cos D.
    a = 1.0 / inverse
    e_sin = np.sum(x[:3] * x[3:], axis=0) / np.sqrt(gm_m3_s2 * a)
    e_cos = 1.0 - r0 / a
    rate = np.sqrt(gm_m3_s2 / a**3)
    ahead = _difference(e_sin, e_cos, rate * dt)
    c, s = 1.0 - np.cos(ahead), np.sin(ahead)
    r = a * (1.0 - e_cos * (1.0 - c) + e_sin * s)
    f, f_dot = 1.0 - a / r0 * c, -np.sqrt(gm_m3_s2 * a) * s / (r * r0)
    g = dt - (ahead - s) / rate
    g_dot = 1.0 - a / r * c
    return np.concatenate([f * x[:3] + g * x[3:], f_dot * x[:3] + g_dot * x[3:]])


def _hyperbolic_step(x: Array, dt: Array, gm_m3_s2: float) -> Array:
    """Propagate states (6, N) on hyperbolas, by the change D of the hyperbolic anomaly [1]_.

    D solves sinh D − D + ε sinh D + s (cosh D − 1) = M, with ε = r₀/|a|, s = r·v/√(GM |a|) and
    M = √(GM/|a|³) Δt.
    """
    r0 = np.sqrt(np.sum(x[:3] ** 2, axis=0))
    inverse = np.maximum(np.sum(x[3:] ** 2, axis=0) / gm_m3_s2 - 2.0 / r0, 1e-12 / r0)
    a = 1.0 / inverse
    near, s = r0 * inverse, np.sum(x[:3] * x[3:], axis=0) / np.sqrt(gm_m3_s2 * a)
    rate = np.sqrt(gm_m3_s2 / a**3)
    mean = rate * dt
    most = 1.0 + np.log1p(np.abs(mean))
    d = np.clip(mean / near, -most, most)
    for _ in range(_ITERATIONS):
        sine, cosine = np.sinh(d), 2.0 * np.sinh(0.5 * d) ** 2
        off = _sinh_less(d) + near * sine + s * cosine - mean
        step = np.clip(off / (cosine + near * (1.0 + cosine) + s * sine), -1.0, 1.0)
        d = d - step
        if (np.abs(step) <= 4e-16 * np.abs(d)).all():
            break
    sine, cosine = np.sinh(d), 2.0 * np.sinh(0.5 * d) ** 2
    r = r0 * (1.0 + cosine) + a * (cosine + s * sine)
    f, f_dot = 1.0 - a / r0 * cosine, -np.sqrt(gm_m3_s2 * a) * sine / (r * r0)
    g, g_dot = dt - _sinh_less(d) / rate, 1.0 - a / r * cosine
    return np.concatenate([f * x[:3] + g * x[3:], f_dot * x[:3] + g_dot * x[3:]])


def _sinh_less(d: Array) -> Array:
    """Return sinh D − D, by its series for small D, where the two terms cancel."""
    q = d * d
    series = d * q / 6.0 * (1.0 + q / 20.0 * (1.0 + q / 42.0 * (1.0 + q / 72.0)))
    return np.where(np.abs(d) < 0.1, series, np.sinh(d) - d)


def hill_axes(states: Array) -> tuple[Array, Array]:
    """Return axes and angular velocity of the Hill frame of bodies on heliocentric orbits.

    Parameters
    ----------
    states : ndarray, shape (6, N)
        Heliocentric states.

    Returns
    -------
    axes : ndarray, shape (3, 3, N)
        Columns: radial, along the motion, orbit normal, in the axes of the states.
    rate : ndarray, shape (3, N)
        Angular velocity of the frame along its own axes, rad/s.
    """
    r, v = np.asarray(states, dtype=float)[:3], np.asarray(states, dtype=float)[3:]
    distance = np.sqrt(np.sum(r * r, axis=0))
    h = np.cross(r, v, axis=0)
    size = np.sqrt(np.sum(h * h, axis=0))
    out, normal = r / distance, h / size
    axes = np.stack([out, np.cross(normal, out, axis=0), normal], axis=1)
    rate = np.zeros_like(r)
    rate[2] = size / distance**2
    return axes, rate


def from_equator(matrices: Array) -> Array:
    """Convert matrices (3, 3, N) that act on ICRF vectors to act on ecliptic J2000 vectors.

    The matrices multiply column vectors: ``earth_fixed("gcrs", …)`` becomes the rotation of
    heliocentric vectors to the rotating Earth.
    """
    c, s = np.cos(ECLIPTIC_OBLIQUITY_RAD), np.sin(ECLIPTIC_OBLIQUITY_RAD)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.asarray(np.einsum("ijn,jk->ikn", matrices, tilt))


def _whole(angle: Array) -> Array:
    """Return the multiple of 2π that is nearest to an angle, rad."""
    return np.asarray(2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def _difference(e_sin: Array, e_cos: Array, mean: Array) -> Array:
    """Solve D + s (1 − cos D) − c sin D = M for D, in the revolution of M, by Newton's method.

    The left side is monotone and differs from D by at most 2 (s² + c²)^½, which gives a first
    bracket. A Newton step that leaves the bracket is replaced by bisection.
    """
    reduced = np.asarray(mean - _whole(mean))
    size = 2.0 * np.hypot(e_sin, e_cos)
    low, high = reduced - size, reduced + size
    anomaly = reduced + e_cos * np.sin(reduced) - e_sin * (1.0 - np.cos(reduced))
    for _ in range(_ITERATIONS):
        s, c = np.sin(anomaly), np.cos(anomaly)
        off = anomaly + e_sin * (1.0 - c) - e_cos * s - reduced
        low, high = np.where(off < 0.0, anomaly, low), np.where(off > 0.0, anomaly, high)
        step = off / (1.0 + e_sin * s - e_cos * c)
        new = anomaly - step
        new = np.where((new < low) | (new > high), 0.5 * (low + high), new)
        done = np.abs(new - anomaly) <= 4e-16 * np.maximum(np.abs(new), 1e-3)
        anomaly = new
        if done.all():
            break
    return np.asarray(anomaly + _whole(mean))
