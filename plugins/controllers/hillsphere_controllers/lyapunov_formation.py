"""Continuous control of a formation by a Lyapunov function of the estimated states."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, ExternalInputs, Plant, TimedPlant, Variable
from hillsphere.symbolic import Expr, Params, constant, exp, sum_of
from hillsphere_controllers.formation_specs import LyapunovFormationSpec

__all__ = ["FormationPlant", "LyapunovFormation"]


@runtime_checkable
class FormationPlant(Plant, Contract, Protocol):
    """A plant of one or more spacecraft: six states and three controls each, in turn."""

    @property
    def spacecraft(self) -> Sequence[str]:
        """Names of the spacecraft."""
        ...

    def disturbances(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return the accelerations that a law cancels, m/s², one per control."""
        ...


class LyapunovFormation:
    r"""The law that lets :math:`V = \tfrac12|v|^2 + \tfrac12 K|r - r_\mathrm{ref}|^2` fall.

    With the estimate :math:`\hat r, \hat v` of each spacecraft and its reference [1]_

    .. math::

        u = -d(\hat r, t) - g(t)\left[K(\hat r - r_\mathrm{ref}) + c_d \hat v\right], \quad
        g = 1 - e^{-t/\tau},

    where d is what the plant declares as to be cancelled (attraction as of a point, radiation
    pressure) and :math:`\dot V = -c_d|v|^2` but for what else acts. It stands in the equations of
    motion: holding u over a step dt would take K dt/2 off the damping, and with K = 1e-5 1/s²,
    c_d = 1e-4 1/s a step of 20 s all of it. Between samples the estimate flies on by the plant at
    its nominal parameters under the same u, and the reference along its velocity.

    Parameters
    ----------
    spec : LyapunovFormationSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant is no formation, or its gravity a function of arrays.

    References
    ----------
    .. [1] Vasile, M., Maddock, C. A., Design of a formation of solar pumped lasers for asteroid
       deflection, Advances in Space Research 50(7), 891-905, 2012.
    """

    measurement: Literal["held", "continuous"] = "held"

    def __init__(self, spec: LyapunovFormationSpec) -> None:
        plant: object = spec.plant.get()
        if not isinstance(plant, FormationPlant):
            raise InputError(
                f"plant: a plant of spacecraft with 'disturbances' is needed (type 'proximity'), "
                f"got a {type(plant).__name__}"
            )
        if isinstance(plant, ExternalInputs):
            raise InputError(
                "plant: its gravity is a function of arrays (a table, a polyhedron), along which "
                "the law cannot carry an estimate; give it a plant with a harmonic or ellipsoid "
                "model of the body"
            )
        self.spec = spec
        self.period_s = spec.period_s
        self.plant = plant
        self._p: Params = {q.name: constant(q.value) for q in plant.parameters()}
        self._n = len(plant.states)

    @property
    def inputs(self) -> int:
        """Six a spacecraft: estimate and reference."""
        return self._n

    @property
    def states(self) -> tuple[Variable, ...]:
        """How far the estimate has moved since the sample, and the time since then."""
        moved = (Variable(f"moved:{v.name}", v.length, v.time) for v in self.plant.states)
        return (*moved, Variable("moved:time", 0, 1))

    @property
    def fastest_rad_s(self) -> float:
        """√K, 1/s."""
        return sqrt(self.spec.stiffness_1_s2)

    def initial(self, n_cases: int) -> Array:
        """Return zeros."""
        return np.zeros((self._n + 1, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        """Return zeros: a new estimate is where it is."""
        return np.zeros_like(xc)

    def derivative(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return the rates of the estimate under the law's own command, and of time."""
        return self.rates_and_command(xc, y, ref, t)[0]

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return the accelerations, m/s²."""
        return self._command(self._estimate(xc, y), xc[-1], ref, t, self._p)

    def rates_and_command(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[tuple[Expr, ...], tuple[Expr, ...]]:
        """Return both at once; see `hillsphere.simulation.JointLaw`."""
        here, p = self._estimate(xc, y), self._p
        if isinstance(self.plant, TimedPlant):
            # what depends on time alone is evaluated once for the command and the motion
            p = {**p, **self.plant.time_terms(t, p)}
        u = self._command(here, xc[-1], ref, t, p)
        return (*self.plant.derivative(here, u, t, p), constant(1.0)), u

    def _command(
        self, here: tuple[Expr, ...], since: Expr, ref: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return the accelerations at an estimate, some time after the sample."""
        spec = self.spec
        grown = 1.0 - exp(-t / spec.ramp_s) if spec.ramp_s else constant(1.0)
        accelerations = []
        for i, acceleration in enumerate(self.plant.disturbances(here, t, p)):
            place = 6 * (i // 3) + i % 3
            goal = ref[place] + since * ref[place + 3]
            back = spec.stiffness_1_s2 * (here[place] - goal)
            slow = spec.damping_1_s * here[place + 3]
            accelerations.append(sum_of([-acceleration, -grown * (back + slow)]))
        return tuple(accelerations)

    def _estimate(self, xc: tuple[Expr, ...], y: tuple[Expr, ...]) -> tuple[Expr, ...]:
        return tuple(a + b for a, b in zip(y, xc[:-1], strict=True))
