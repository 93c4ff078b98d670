"""Periodic orbits as curves: the point nearest to a state, and the phase there."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import StageError
from hillsphere.interfaces import Array, Plant
from hillsphere.products import PeriodicOrbits
from hillsphere_orbits.fidelity_ladder.rung import Rung
from hillsphere_orbits.flow import flow_of

__all__ = ["NearOrbit", "OrbitCurves"]

_Lanes: TypeAlias = NDArray[np.intp]
_SPACING = 0.02
"""Longest step of the table, natural units: the interpolation errs by 1e-9 of the orbit."""
_NEWTON = 4
"""Steps of Gauss and Newton's iteration for the nearest phase. Their number is fixed, so that a
flight does not depend on the others of its batch; the phase of the last iteration is near."""
_LONGEST = 0.3
"""Longest change of a phase at once, natural units."""
_SAME_EQUATIONS = 1e-8
"""Largest closure beside the growth of errors over half a period, natural units, of orbits that
count as solutions of this plant's equations. They were computed to 1e-9 or better; other equations
(another gravity model, say) give far more."""
_TRACK_POINTS = 1200
"""Points of a stored track, about: a smooth curve in a figure."""


class OrbitCurves:
    """N periodic orbits as tables of states, interpolated.

    Parameters
    ----------
    plant : Plant
        Equations that the orbits solve; six states.
    orbits : PeriodicOrbits
        The orbits.

    Raises
    ------
    StageError
        If they do not solve the equations.
    """

    def __init__(self, plant: Plant, orbits: PeriodicOrbits) -> None:
        flow = flow_of(plant)
        system = flow.system
        self.unit, self.time_unit_s = system.unit, system.time_unit_s
        x = orbits.x0 / self.unit[:, None] if orbits.x0.shape[0] == len(self.unit) else None
        self.period = orbits.period_s / self.time_unit_s
        error = np.inf
        if x is not None and orbits.frame == system.frame:
            # Half a period to either side: errors grow with the root of the multiplier only.
            lanes, halves = np.concatenate([x, x], axis=1), 0.5 * self.period
            growth = np.sqrt(np.maximum(1.0, np.max(np.abs(orbits.monodromy), axis=(0, 1))))
            both = np.concatenate([halves, -halves])
            steps = flow.steps_for(lanes, both, 1e-11 * float(np.max(growth, initial=1.0)))
            steps = max(steps, int(np.ceil(np.max(halves, initial=0.0) / _SPACING)))
            ahead, back = np.split(flow.plain.trajectory(lanes, both, steps, strict=False), 2, 2)
            gap = np.max(np.abs(ahead[:, -1] - back[:, -1]), axis=0)
            error = float(np.max(gap / growth, initial=0.0))
            table = np.concatenate([back[:, :0:-1], ahead], axis=1)
        if not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the orbits (frame {orbits.frame}) do not solve the equations of the first rung "
                f"(frame {system.frame}; closure {error:.1e}); name the plant with which they were "
                "computed first"
            )
        self.table = table
        rate = flow.rate(np.ascontiguousarray(table.reshape(len(self.unit), -1)))
        self.rate = rate.reshape(table.shape)
        self.step = 0.5 * self.period / steps

    def track_m(self) -> Array:
        """Return positions (3, P, N) along one period, m, ends included."""
        thin = max(1, self.table.shape[1] // _TRACK_POINTS)
        return np.ascontiguousarray(self.table[:3, ::thin]) * self.unit[:3, None, None]

    def amplitudes_m(self) -> Array:
        """Return the largest |x|, |y|, |z| of each orbit, (3, N), m."""
        return np.asarray(np.max(np.abs(self.table[:3]), axis=1) * self.unit[:3, None])

    def at(self, phase: Array, lanes: _Lanes) -> tuple[Array, Array]:
        """Return states and rates (n, k, L), normalised, at phases (k, L) in units of time."""
        h = self.step[lanes]
        place = np.mod((phase + 0.5 * self.period[lanes]) / h, self.table.shape[1] - 1)
        # interval of the table, periodic in the phase
        i = np.minimum(place.astype(np.intp), self.table.shape[1] - 2)
        s = place - i
        a, b = self.table[:, i, lanes], self.table[:, i + 1, lanes]
        da, db = self.rate[:, i, lanes] * h, self.rate[:, i + 1, lanes] * h
        # cubic of Hermite and its slope
        c2, c3 = 3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db
        value = a + s * (da + s * (c2 + s * c3))
        return value, (da + s * (2.0 * c2 + 3.0 * s * c3)) / h

    def nearest(self, x: Array, phase: Array, lanes: _Lanes) -> Array:
        """Return the phases (k, L), near to given ones, at which orbits come nearest to x."""
        for _ in range(_NEWTON):
            here, rate = self.at(phase, lanes)
            # Gauss and Newton: project the gap on the rate along the orbit
            change = np.sum((x - here) * rate, axis=0) / np.sum(rate**2, axis=0)
            phase = phase + np.clip(change, -_LONGEST, _LONGEST)
        return phase


class NearOrbit:
    """The target "near its periodic orbit, at any phase" of flights on a rung.

    Parameters
    ----------
    curves : OrbitCurves
        The orbits, one per flight.
    rung : Rung
        The plant that the flights obey.
    """

    def __init__(self, curves: OrbitCurves, rung: Rung) -> None:
        self.curves, self.rung = curves, rung
        self.t = rung.t_s / curves.time_unit_s

    def start(self) -> Array:
        """Return the nodes (n, K + 1, N), SI, of flights on the orbits themselves."""
        lanes = np.arange(len(self.curves.period))
        phase = np.repeat(self.t[:, None], len(lanes), axis=1)
        hill, _ = self.curves.at(phase, lanes)
        return self.rung.states(hill * self.curves.unit[:, None, None], slice(0, len(self.t)))

    def near(
        self, x: Array, nodes: slice, lanes: _Lanes, slip: Array
    ) -> tuple[Array, Array | None, Array]:
        """Return the nearest states of the orbits, the directions along them, and the slips.

        A slip is the phase on the orbit less the time, natural units. Arguments as those of
        `hillsphere_orbits.multiple_shooting.Target`.
        """
        unit = self.curves.unit[:, None, None]
        t = self.t[nodes, None]
        phase = self.curves.nearest(self.rung.hill(x) / unit, t + slip, lanes)
        place, rate = self.curves.at(phase, lanes)
        along = self.rung.states(rate * unit, nodes)
        return self.rung.states(place * unit, nodes), along, phase - t
