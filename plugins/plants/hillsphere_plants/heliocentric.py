"""Motion of bodies and spacecraft around the Sun, together as one state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hillsphere.base.constants import AU_M
from hillsphere.engine.start_states import Centre
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.model.ephemeris import from_equator
from hillsphere.model.frame_motion import FrameMotion
from hillsphere.symbolic import Expr, Params, dot, power, sum_of
from hillsphere.time import Epoch
from hillsphere_plants.moon_centred import CONTROLS, POSITION_AND_VELOCITY
from hillsphere_plants.proximity_specs import HeliocentricSpec

__all__ = ["Heliocentric"]


class Heliocentric:
    r"""Motion around the Sun of an asteroid and of spacecraft that are far from it.

    In the frame ``ecliptic`` each moves by

    .. math:: \ddot r = -\left(GM - \frac{C_R A}{m} P_0\, \mathrm{au}^2\right)\frac{r}{|r|^3} + u .

    Their mutual attraction is neglected: that of a body of 2 m³/s² is 2e-14 m/s² at 10 000 km.

    Parameters
    ----------
    spec : HeliocentricSpec
        Run-time parameters: ``primary_gm`` and, of each under radiation pressure, ``radiation1`` …,
        its C_R A/m.
    """

    frame = "ecliptic"

    def __init__(self, spec: HeliocentricSpec) -> None:
        self.spec = spec
        self.bodies: tuple[str, ...] = tuple(
            body.name or f"body {i + 1}" for i, body in enumerate(spec.bodies)
        )
        self._radiation = [
            body.reflectivity * body.area_to_mass_m2_kg * bool(spec.radiation_pressure_n_m2)
            for body in spec.bodies
        ]

    @property
    def states(self) -> tuple[Variable, ...]:
        """Position and velocity of the first, then of the next; x1 … if several."""
        return self._number_variables(POSITION_AND_VELOCITY)

    @property
    def controls(self) -> tuple[Variable, ...]:
        """Three accelerations each."""
        return self._number_variables(CONTROLS)

    @property
    def scales(self) -> Scales:
        """1 au, and a radian of the circular orbit there."""
        return Scales(AU_M, (AU_M**3 / self.spec.primary_gm_m3_s2) ** 0.5)

    def frame_rate(self, others: Mapping[str, float]) -> Array:
        """Return zero (3,): the frame does not rotate."""
        return np.zeros(3)

    def centres(self, others: Mapping[str, float]) -> Mapping[str, Centre]:
        """Return the Sun with its full GM, without the reduction by radiation pressure."""
        return {"sun": Centre(self.spec.primary_gm_m3_s2, np.zeros(3), np.zeros(3))}

    def icrf_axes(self, epoch: Epoch) -> Array:
        """Return the axes of ecliptic and equinox J2000 in the ICRF as columns (3, 3)."""
        return np.asarray(from_equator(np.eye(3)[:, :, None])[:, :, 0])

    def frame_motion(self, epoch: Epoch, t_s: Array, others: Mapping[str, Array]) -> FrameMotion:
        """Return the frame at times (K,): it does not turn."""
        axes = np.repeat(self.icrf_axes(epoch)[:, :, None], t_s.size, axis=2)
        return FrameMotion(axes, np.zeros((3, t_s.size)), {"sun": np.zeros((6, t_s.size))})

    def others_over_time(self, start: Mapping[str, float], t_s: Array) -> Mapping[str, Array]:
        """Return none: positions and velocities are all states."""
        return {}

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the Sun's gravitational parameter and those of radiation pressure."""
        pushed = (
            Parameter(f"radiation{i + 1}", value, "m2/kg")
            for i, value in enumerate(self._radiation)
            if value
        )
        return (Parameter("primary_gm", self.spec.primary_gm_m3_s2, "m3/s2", True), *pushed)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI."""
        rates: list[Expr] = []
        for i, value in enumerate(self._radiation):
            r, v, command = x[6 * i : 6 * i + 3], x[6 * i + 3 : 6 * i + 6], u[3 * i : 3 * i + 3]
            gm = p["primary_gm"]
            if value:
                # radiation pressure falls with the square of the distance too: it reduces GM
                push = self.spec.radiation_pressure_n_m2 * AU_M**2
                gm = gm - p[f"radiation{i + 1}"] * push
            pull = -gm * power(dot(r, r), -1.5)
            rates += [*v, *(sum_of([pull * q, c]) for q, c in zip(r, command, strict=True))]
        return tuple(rates)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return none."""
        return {}

    def _number_variables(self, of_one: Sequence[Variable]) -> tuple[Variable, ...]:
        count = len(self.bodies)
        if count == 1:
            return tuple(of_one)
        return tuple(replace(v, name=f"{v.name}{i + 1}") for i in range(count) for v in of_one)
