"""Linearisation of a plant's equations of motion at a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.dynamics import Derivatives, system
from hillsphere.engine.simulation.flow import velocity_rows
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant

__all__ = ["LinearisedPlant", "linearise_plant"]


@dataclass(frozen=True)
class LinearisedPlant:
    """Linearised motion ẋ = A x + B u + f of the deviation x from a state.

    Parameters
    ----------
    a, b : ndarray, shape (n, n), (n, m)
        Derivatives by positions and velocities, and by the controls, SI.
    drift : ndarray, shape (n,)
        f: the rates at the state itself.
    names : tuple of str
        Positions and velocities, in the plant's order: what a law sees.
    """

    a: Array
    b: Array
    drift: Array
    names: tuple[str, ...]


def linearise_plant(
    plant: Plant,
    position_m: Sequence[float],
    velocity_m_s: Sequence[float] = (),
    others: dict[str, float] | None = None,
    time_s: float = 0.0,
) -> LinearisedPlant:
    """Linearise a plant's equations of motion at a state.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    position_m, velocity_m_s : sequence of float
        Positions and velocities, in the plant's order; no velocities are zero.
    others : dict of str to float, optional
        Values of other states, such as a true anomaly, by name; they count as constant.
    time_s : float
        Time.

    Returns
    -------
    LinearisedPlant
        Of the positions and velocities.

    Raises
    ------
    InputError
        If the numbers do not fit the plant, or the rates there are not finite.
    """
    names = tuple(v.name for v in plant.states)
    places = [i for i, v in enumerate(plant.states) if (v.length, v.time) == (1, 0)]
    rates = velocity_rows(plant)
    given, rest = others or {}, [n for i, n in enumerate(names) if i not in (*places, *rates)]
    for what, rows, values in (
        ("position_m", places, position_m),
        ("velocity_m_s", rates, velocity_m_s or [0.0] * len(rates)),
    ):
        if len(values) != len(rows):
            listed = ", ".join(names[i] for i in rows)
            raise InputError(f"{what}: the plant has {listed}; got {len(values)} numbers")
    if set(given) != set(rest):
        raise InputError(
            f"others: the plant's states beside positions and velocities are "
            f"{', '.join(rest) or 'none'}; got {', '.join(sorted(given)) or 'none'}"
        )
    x = np.zeros(len(names))
    x[places] = position_m
    if velocity_m_s:
        x[rates] = velocity_m_s
    for name, value in given.items():
        x[names.index(name)] = value
    controls = [f"u:{v.name}" for v in plant.controls]
    slopes = Derivatives(system(plant, controls=True), controls)
    rate, jacobian = slopes.both(x[:, None], None, time_s)
    if not (np.isfinite(rate).all() and np.isfinite(jacobian).all()):
        raise InputError(f"the plant's rates are not finite at {x.tolist()}; is it inside a body?")
    moving = sorted([*places, *rates])
    matrix = jacobian[:, :, 0]
    return LinearisedPlant(
        np.ascontiguousarray(matrix[np.ix_(moving, moving)]),
        np.ascontiguousarray(matrix[moving, len(names) :]),
        np.ascontiguousarray(rate[moving, 0]),
        tuple(names[i] for i in moving),
    )
