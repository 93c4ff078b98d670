"""The estimator's model of a plant that is tracked: its motion, and what observers expect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from hillsphere.interfaces import Array, Channel, Integers, Plant
from hillsphere_estimators.orbit_fit.light_time import Path
from hillsphere_estimators.orbit_fit.observables import Aberration, Observable, expected_values
from hillsphere_estimators.orbit_fit.surroundings import Surroundings
from hillsphere_estimators.orbit_fit.uplink import Transmission
from hillsphere_estimators.plant_model import PlantModel

__all__ = ["TrackingModel"]


class TrackingModel(PlantModel):
    """An `hillsphere.interfaces.EstimationModel` of a plant and its observables.

    Parameters
    ----------
    plant : Plant
        Motion of one spacecraft, six states.
    observables : sequence of Observable
        In the order of the rows.
    surroundings : Surroundings
        Where everything is.
    craft : str
        Name of the spacecraft among the participants.
    aberration : {"none", "observer", "stars", "instantaneous"}
        Of directions.
    transmissions : mapping of str to Transmission
        Frequencies by the name of the participant that sends first.
    active : mapping of float to tuple of int
        Time → numbers of the observables that are measured then. Rows of others are zero, which
        saves their light times.
    noise, step_s, noise_step_s
        As for `PlantModel`.
    """

    def __init__(
        self,
        plant: Plant,
        observables: Sequence[Observable],
        surroundings: Surroundings,
        craft: str,
        aberration: Aberration,
        transmissions: Mapping[str, Transmission],
        active: Mapping[float, tuple[int, ...]],
        *,
        noise: Callable[[Array], Array] | None = None,
        step_s: float = 60.0,
        noise_step_s: float = 60.0,
    ) -> None:
        super().__init__(plant, None, noise=noise, step_s=step_s, noise_step_s=noise_step_s)
        self.observables, self.surroundings = tuple(observables), surroundings
        self._craft, self._aberration = craft, aberration
        self._transmissions, self._active = transmissions, active
        self._near = [
            surroundings.is_near(name for name in o.travelled if name != craft) for o in observables
        ]
        ends = np.cumsum([0, *(len(o.names) for o in observables)]).tolist()
        self.rows = [slice(a, b) for a, b in pairwise(ends)]
        """Rows of each observable."""
        self._count = ends[-1]

    @property
    def blocks(self) -> tuple[tuple[Channel, ...], ...]:
        """Channels of the rows, a block for each observable."""
        return tuple(o.channels for o in self.observables)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the expected values (m, K); see `hillsphere.interfaces.EstimationModel`."""
        rows = np.zeros((self._count, x.shape[1]))
        first = float(t_s[0])
        some: Sequence[int] | None = None
        if (t_s == first).all():
            some = self._active.get(first)
        numbers = range(len(self.observables)) if some is None else some

        def follow(near: bool) -> Callable[[str], Path]:
            def states(name: str) -> Path:
                if name != self._craft:
                    return lambda dt: self.surroundings.observer(name, t_s + dt, near)
                return lambda dt: self._craft_at(x, t_s, dt, case, near)

            return states

        for number in numbers:
            o = self.observables[number]
            near = self._near[number]
            rows[self.rows[number]] = expected_values(
                o, follow(near), self.surroundings, t_s, self._aberration,
                self._transmissions.get(o.path[0]), near,
            )  # fmt: skip
        return rows

    def _craft_at(self, x: Array, t_s: Array, dt: Array, case: Integers, near: bool) -> Array:
        """Return the inertial states (6, K) of the spacecraft at times after the tags."""
        lost = ~np.isfinite(dt)
        there = t_s + np.where(lost, 0.0, dt)
        if dt.any():
            x = self.advance(x, t_s, there, np.zeros((0, x.shape[1])), case)
        states = self.surroundings.craft(x, there, near)
        # a signal that is further away than `FARTHEST_S` has no states
        return np.where(lost, np.nan, states) if lost.any() else states
