"""Where spacecraft of a formation fly whose orbits differ little from that of an asteroid.

References
----------
.. [1] Schaub, H., Junkins, J. L., Analytical Mechanics of Space Systems, 2nd ed., AIAA, 2009,
   section 14.6 (relative motion by differences of orbital elements).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Variable
from hillsphere.model.bodies import OrbitingBody
from hillsphere.presentation import Presentation
from hillsphere.products import FlightSet, Trajectories
from hillsphere.products.fields import Shape
from hillsphere_plants.formation_reference.presentation import present_formation
from hillsphere_plants.proximity_specs import FormationReferenceSpec, RelativeElementsSpec

__all__ = ["FormationReference", "FormationReferenceStage", "reference_states", "relative_orbit"]


@runtime_checkable
class FormationAboutAsteroid(Contract, Protocol):
    """A plant of spacecraft in the Hill frame of an asteroid on its orbit.

    ``spacecraft`` are their names; of the asteroid's orbit ``primary_distance_m`` is the semi-major
    axis and ``primary_gm_m3_s2`` the gravitational parameter.
    """

    spacecraft: tuple[str, ...]
    body: OrbitingBody
    frame: str
    states: tuple[Variable, ...]
    primary_distance_m: float
    primary_gm_m3_s2: float
    eccentricity: float

    @property
    def semi_axes_m(self) -> tuple[float, float, float] | None:
        """Semi-axes of the asteroid's surface, m."""
        ...

    def anomaly(self, t_s: Array) -> Array:
        """Return the true anomaly (N,), rad, of the asteroid at times (N,) of the plant."""
        ...


@dataclass(frozen=True)
class FormationReference(FlightSet):
    """Reference trajectory of a formation: one flight, whose states are those of all spacecraft.

    `flights` is that one flight.
    """

    spacecraft: Annotated[tuple[str, ...], Shape("spacecraft")]
    """Names, in the order of the states."""
    semi_axes_m: Annotated[Array | None, Shape(3)] = None
    """Semi-axes of the asteroid's surface; None without a surface."""


def relative_orbit(
    differences: Array,
    anomaly_rad: Array,
    semi_major_axis_m: float,
    eccentricity: float,
    inclination_rad: float,
    periapsis_rad: float,
    gm_m3_s2: float,
) -> Array:
    r"""Return the states, in the Hill frame, of an orbit that differs little, to first order.

    With η² = 1 − e², R = aη²/(1 + e cos f) and θ = ω + f [1]_

    .. math::

        x &= -a\cos f\,\delta e + \tfrac{a e}{\eta}\sin f\,\delta M, \\
        y &= R\left[\delta\omega + \cos i\,\delta\Omega
             + \frac{\sin f\,(2 + e\cos f)}{\eta^2}\,\delta e
             + \frac{(1 + e\cos f)^2}{\eta^3}\,\delta M\right], \\
        z &= R\left[\sin\theta\,\delta i - \cos\theta\sin i\,\delta\Omega\right].

    Parameters
    ----------
    differences : ndarray, shape (5,)
        δe, δi, δΩ, δω, δM, rad.
    anomaly_rad : ndarray, shape (N,)
        True anomaly f of the asteroid.
    semi_major_axis_m, eccentricity, inclination_rad, periapsis_rad : float
        Elements of the asteroid's orbit: a, e, i, ω.
    gm_m3_s2 : float
        Gravitational parameter of the Sun.

    Returns
    -------
    ndarray, shape (6, N)
        Positions, m, and velocities, m/s.
    """
    de, di, dnode, dperi, dmean = (float(d) for d in differences)
    a, e, f = semi_major_axis_m, eccentricity, np.asarray(anomaly_rad, dtype=float)
    eta = np.sqrt(1.0 - e * e)
    c, s = np.cos(f), np.sin(f)
    ratio = 1.0 + e * c
    distance = a * eta**2 / ratio
    slope = distance * e * s / ratio  # dR/df
    theta = periapsis_rad + f
    ci, si = np.cos(inclination_rad), np.sin(inclination_rad)
    along = dperi + ci * dnode + s * (1.0 + ratio) / eta**2 * de + ratio**2 / eta**3 * dmean
    along_slope = (c * (1.0 + ratio) - e * s * s) / eta**2 * de
    along_slope -= 2.0 * e * s * ratio / eta**3 * dmean
    across = np.sin(theta) * di - np.cos(theta) * si * dnode
    across_slope = np.cos(theta) * di + np.sin(theta) * si * dnode
    place = np.array([-a * c * de + a * e / eta * s * dmean, distance * along, distance * across])
    rates = np.array(
        [
            a * s * de + a * e / eta * c * dmean,
            slope * along + distance * along_slope,
            slope * across + distance * across_slope,
        ]
    )
    turn = np.sqrt(gm_m3_s2 * a) * eta / distance**2
    return np.concatenate([place, turn * rates])


def reference_states(
    plant: FormationAboutAsteroid, relative: Sequence[RelativeElementsSpec], t_s: Array
) -> Array:
    """Return the reference states (6 S, N) of a plant's spacecraft at times (N,).

    Parameters
    ----------
    plant : FormationAboutAsteroid
        The plant; its body gives inclination and argument of periapsis.
    relative : sequence of RelativeElementsSpec
        Differences of the elements, one a spacecraft.
    t_s : ndarray, shape (N,)
        Times of the plant.

    Raises
    ------
    InputError
        If there are not as many as spacecraft, or the body lacks an element that is needed.
    """
    check_relative(plant, relative)
    body = plant.body
    anomaly = plant.anomaly(t_s)
    return np.concatenate(
        [
            relative_orbit(
                np.array(
                    [d.eccentricity, d.inclination_rad, d.node_rad, d.periapsis_rad,
                     d.mean_anomaly_rad]
                ),
                anomaly,
                plant.primary_distance_m,
                plant.eccentricity,
                body.inclination_rad or 0.0,
                body.periapsis_rad or 0.0,
                plant.primary_gm_m3_s2,
            )
            for d in relative
        ]
    )  # fmt: skip


def check_relative(plant: FormationAboutAsteroid, relative: Sequence[RelativeElementsSpec]) -> None:
    """Raise `InputError` as `reference_states` does, without its work."""
    count = len(plant.spacecraft)
    if len(relative) != count:
        raise InputError(
            f"relative: {len(relative)} differences of elements for {count} spacecraft of the "
            "plant; give one table each"
        )
    body = plant.body
    tilted = any(d.node_rad or d.inclination_rad for d in relative)
    needed = {"inclination_deg": body.inclination_rad, "periapsis_deg": body.periapsis_rad}
    missing = [key for key, value in needed.items() if value is None]
    if tilted and missing:
        raise InputError(
            f"body {body.name!r} lacks {', '.join(missing)}: differences of node or inclination "
            "need the orientation of its orbit"
        )


class FormationReferenceStage:
    """Reference trajectory of a formation by differences of orbital elements.

    Parameters
    ----------
    spec : FormationReferenceSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant is no formation near an asteroid, there are not as many differences as
        spacecraft, or the body lacks an element that is needed.
    """

    def __init__(self, spec: FormationReferenceSpec) -> None:
        plant: object = spec.plant.get()
        if not isinstance(plant, FormationAboutAsteroid):
            raise InputError(
                "plant: spacecraft near an asteroid on its orbit are needed, as in a plant of type "
                f"'proximity', got a {type(plant).__name__}"
            )
        check_relative(plant, spec.relative)
        self.spec = spec
        self.plant = plant

    def run(self, ctx: Context) -> FormationReference:
        """Return the trajectory, from time 0 on."""
        spec, plant = self.spec, self.plant
        points = max(2, round(spec.duration_s / spec.interval_s) + 1)
        t = np.linspace(0.0, spec.duration_s, points)
        x = reference_states(plant, spec.relative, t)
        names = tuple(v.name for v in plant.states)
        flights = Trajectories(
            plant.frame, names, ("formation",), ("formation",), t[:, None], x[:, :, None]
        )
        axes = plant.semi_axes_m
        return FormationReference(
            flights, plant.spacecraft, None if axes is None else np.array(axes)
        )

    def present(self, product: FormationReference) -> Presentation:
        """Show distances and paths."""
        return present_formation(product.flights, product.spacecraft, product.semi_axes_m)
