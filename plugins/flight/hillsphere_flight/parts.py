"""Navigation, actuator and effectiveness of a control law, as the Specs declare them."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.course import Rows
from hillsphere.engine.simulation.flow import thrust_vectors
from hillsphere.errors import InputError
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.interfaces.control import Compensator
from hillsphere.interfaces.plant import Plant
from hillsphere.interfaces.quantities import Parameter, Variable
from hillsphere.simulation import (
    ContinuousLaw,
    Navigation,
    NavigationErrors,
    PerfectNavigation,
    SeenStates,
    Thruster,
)
from hillsphere_flight.specs import ActuatorSpec, NavigationSpec

__all__ = [
    "Effectiveness",
    "actuator_of",
    "command_rows",
    "law_input_rows",
    "navigation_of",
    "unit_of",
]


def law_input_rows(rows: Rows, law: Compensator | ContinuousLaw, names: Sequence[str]) -> list[int]:
    """Return the states that are the input of a law.

    Parameters
    ----------
    rows : Rows
        Rows of the plant's positions and velocities.
    law : Compensator or ContinuousLaw
        One that measures continuously sees all.
    names : sequence of str
        States that the mission names; empty for all positions and velocities.

    Returns
    -------
    list of int
        In the law's order.

    Raises
    ------
    InputError
        If there is no such state.
    """
    if unknown := [name for name in names if name not in rows.names]:
        raise InputError(
            f"sees: the plant has no state {', '.join(unknown)}; it has {', '.join(rows.names)}"
        )
    everything = list(range(len(rows.names)))
    if isinstance(law, ContinuousLaw) and law.measurement == "continuous":
        if names and list(names) != list(rows.names):
            raise InputError("sees: a law that measures continuously sees all states; leave it out")
        return everything
    return [rows.names.index(name) for name in names] if names else rows.moving


def navigation_of(spec: NavigationSpec, rows: Rows, seen: Sequence[int]) -> Navigation:
    """Return the navigation that feeds a law these states, with the errors declared.

    Parameters
    ----------
    spec : NavigationSpec
        Errors of positions and velocities; other states have none.
    rows : Rows
        Rows of the plant's positions and velocities.
    seen : sequence of int
        Which states.

    Returns
    -------
    Navigation
        Without errors it draws no random numbers.
    """
    sigma = np.zeros(len(rows.names))
    sigma[rows.positions], sigma[rows.velocities] = spec.position_m, spec.velocity_m_s
    errors: Navigation = (
        NavigationErrors(sigma[list(seen)], spec.correlation_time_s)
        if sigma.any()
        else PerfectNavigation()
    )
    return errors if list(seen) == list(range(len(rows.names))) else SeenStates(seen, errors)


def command_rows(plant: Plant, rows: Rows, law: Compensator | ContinuousLaw) -> tuple[str, ...]:
    """Return the names of a command's components: controls, or velocities for impulsive laws."""
    if not isinstance(law, ContinuousLaw) and law.actuation == "impulse":
        return tuple(rows.names[i] for i in rows.velocities)
    return tuple(v.name for v in plant.controls)


def actuator_of(
    spec: ActuatorSpec | None, law: Compensator | ContinuousLaw, count: int
) -> Thruster | None:
    """Return the actuator declared.

    Parameters
    ----------
    spec : ActuatorSpec or None
        None for a perfect actuator.
    law : Compensator or ContinuousLaw
        The law whose commands it executes.
    count : int
        Number of rows of a command: thrust vectors of three components, or one vector.

    Returns
    -------
    Thruster or None
        None for a perfect one.

    Raises
    ------
    InputError
        If the command of the law is part of the equations of motion, or if the limits are those of
        impulses and the law commands accelerations, or the other way round.
    """
    if spec is None:
        return None
    if isinstance(law, ContinuousLaw):
        raise InputError(
            "actuator: the command of this law changes between samples, as part of the equations "
            "of motion, where no actuator model applies; leave it out (actuator.gain.ROW may still "
            "be dispersed), or take a law that acts at samples"
        )
    held = law.actuation == "hold"
    wrong = (
        ("minimum_impulse_m_s", "maximum_impulse_m_s", "quantum_impulse_m_s")
        if held
        else ("minimum_acceleration_m_s2", "maximum_acceleration_m_s2", "quantum_acceleration_m_s2")
    )
    for key in wrong:
        if getattr(spec, key):
            kind = "a held acceleration" if held else "impulses"
            raise InputError(f"actuator.{key}: the law commands {kind}; limit those")
    if held:
        minimum, maximum = spec.minimum_acceleration_m_s2, spec.maximum_acceleration_m_s2
        quantum = spec.quantum_acceleration_m_s2
    else:
        minimum, maximum = spec.minimum_impulse_m_s, spec.maximum_impulse_m_s
        quantum = spec.quantum_impulse_m_s
    vectors = thrust_vectors(count)
    return Thruster(
        magnitude_sigma=spec.magnitude,
        pointing_sigma_rad=spec.pointing_rad,
        minimum=minimum,
        maximum=inf if maximum is None else maximum,
        quantum=quantum,
        dimension=count // vectors,
        thrusters=vectors,
    )


class Effectiveness:
    r"""Effectiveness of the thrust, constant over a flight: scale · rotation · (gain + coupling).

    Each thrust vector of three components is multiplied by its gains on the diagonal and the
    coupling c beside it, c (1 1ᵀ − I). The result is rotated by the rotation
    vector of its misalignments :math:`\theta` (Rodrigues' formula,
    :math:`R = I + \frac{\sin\theta}{\theta}[\theta]_\times +
    \frac{1-\cos\theta}{\theta^2}[\theta]_\times^2`) and scaled. This applies to the whole
    command, the sum of those of the law and of the reference.

    Parameters
    ----------
    names : tuple of str
        Rows of a command.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._turns = len(names) % 3 == 0

    def inputs(self) -> tuple[Parameter, ...]:
        """Return what may differ from case to case."""
        parameters = [Parameter("actuator.scale", 1.0)]
        parameters += [Parameter(f"actuator.gain.{name}", 1.0) for name in self._names]
        if self._turns:
            parameters += [Parameter(f"actuator.turn.{name}", 0.0, "rad") for name in self._names]
        if len(self._names) > 1:
            parameters.append(Parameter("actuator.coupling", 0.0))
        return tuple(parameters)

    def gain(self, batch: CaseBatch) -> Array | None:
        """Return the matrices (p, p, N); None if none of the inputs differs."""
        inputs = self.inputs()
        if not {q.name for q in inputs} & set(batch.names):
            return None
        count, width = len(self._names), len(batch.numbers)
        values = {q.name: batch.value(q.name, q.value) for q in inputs}
        matrix = np.zeros((count, count, width))
        for i, name in enumerate(self._names):
            matrix[i, i] = values[f"actuator.gain.{name}"]
        if "actuator.coupling" in batch.names:
            size = count // thrust_vectors(count)
            for i, j in np.ndindex(count, count):
                if i != j and i // size == j // size:
                    matrix[i, j] = values["actuator.coupling"]
        if self._turns:
            for first in range(0, count, 3):
                own = slice(first, first + 3)
                angles = [values[f"actuator.turn.{name}"] for name in self._names[own]]
                turned = np.einsum("ijN,jkN->ikN", _rotation(np.array(angles)), matrix[own, own])
                matrix[own, own] = turned
        return np.ascontiguousarray(matrix * values["actuator.scale"])


def unit_of(variable: Variable) -> str:
    """Return the SI unit of a variable of a plant: ``"m/s"``."""
    if variable.unit:
        return variable.unit
    if not variable.length and not variable.time:
        return "-"
    parts = {"m": variable.length, "s": variable.time}
    above, below = (
        "".join(
            unit + (str(abs(power)) if abs(power) > 1 else "")
            for unit, power in parts.items()
            if power * sign > 0
        )
        for sign in (1, -1)
    )
    return f"{above or '1'}/{below}" if below else above


def _rotation(v: Array) -> Array:
    """Return the rotation matrices (3, 3, N) of rotation vectors (3, N), rad.

    Rodrigues' formula; sin θ/θ and (1 − cos θ)/θ² = ½ (sin(θ/2)/(θ/2))² are regular at θ = 0.
    """
    zero = np.zeros(v.shape[1])
    cross = np.array([[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]])
    angle = np.sqrt(np.sum(v * v, axis=0))
    one = np.sinc(angle / np.pi)
    half = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2  # (1 − cos θ)/θ²
    square = np.einsum("ijN,jkN->ikN", cross, cross)
    return np.asarray(np.eye(3)[:, :, None] + one * cross + half * square)
