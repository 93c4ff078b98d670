"""Parts of a navigation: sensors, the filter's model with its biases, and its prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hillsphere.engine.course import Rows
from hillsphere.engine.simulation.flow import thrust_vectors
from hillsphere.engine.start_states import covariance_of_start
from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Estimator, Integers, Plant, Sensor
from hillsphere.sensor_suite import SensorSuite
from hillsphere.simulation import ContinuousLaw
from hillsphere.spec import Ref
from hillsphere.uncertainty.copula import covariance_factor
from hillsphere_estimators.bias_states import BiasStates
from hillsphere_estimators.navigation.attitude import attitude_states
from hillsphere_estimators.navigation.specs import OWN, BeliefSpec, BiasSpec, NavigationSpec
from hillsphere_estimators.navigation.world import FaultySensors, noise_of
from hillsphere_estimators.plant_model import PlantModel

__all__ = [
    "InitialBeliefs",
    "biases_of",
    "check_scales",
    "continuous_law",
    "faults_of",
    "intervals_of",
    "members_of",
    "model_of",
    "prior_of",
    "prior_root",
    "refuse_considered",
    "sensors_of",
    "stated_covariance",
    "true_sensors",
    "usable_beliefs",
]

_ROUNDING = 1e-6
"""Relative excess of a duration over whole intervals that is rounding of the units in a mission
(hours to seconds), and must not add an interval."""
_POSITIVE = ("gm", "semi_major_axis", "rotation_rate")


class InitialBeliefs(Protocol):
    """Beliefs before the first measurement, with the true states, of M cases.

    The stage ``initialisation`` produces them.
    """

    @property
    def means(self) -> Array:
        """Means (n, M), SI."""
        ...

    @property
    def covariances(self) -> Array:
        """Covariances (M, n, n), SI."""
        ...

    @property
    def truths(self) -> Array:
        """True states (n, M), SI."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        ...

    @property
    def t_s(self) -> float:
        """Time of the beliefs, s."""
        ...

    @property
    def settled(self) -> Array:
        """1 where the fit converged, else 0 (M,)."""
        ...


def usable_beliefs(spec: NavigationSpec, plant: Plant, given: InitialBeliefs) -> Integers:
    """Return the cases of given beliefs whose fit has converged.

    Raises
    ------
    InputError
        If the beliefs are of other states or of another time than the flight, or none has
        converged.
    """
    names = tuple(variable.name for variable in plant.states)
    if given.names != names:
        raise InputError(
            f"needs.belief: it is of {len(given.names)} states {', '.join(given.names)}; the plant "
            f"has {len(names)}, {', '.join(names)}: take a stage on the same plant"
        )
    if spec.start.time_s not in (0.0, given.t_s):
        raise InputError(
            f"start.time_s: the beliefs of needs.belief are of {given.t_s:g} s, the flight is to "
            f"begin at {spec.start.time_s:g} s; leave start.time_s out"
        )
    cases = np.flatnonzero(np.asarray(given.settled) > 0.0)
    if not cases.size:
        raise InputError(
            f"needs.belief: none of its {len(given.settled)} fits converged, so there is nothing "
            "to begin with; give that stage more sensors or a longer arc"
        )
    return cases


def intervals_of(spec: NavigationSpec) -> int:
    """Return the number of whole intervals of a flight, at least one."""
    return max(1, ceil(spec.duration_s / spec.interval_s * (1.0 - _ROUNDING)))


def continuous_law(spec: NavigationSpec, plant: Plant) -> ContinuousLaw | None:
    """Return the law of the stage, None without one.

    Raises
    ------
    InputError
        If the law is not continuous, or does not act on an estimate of all states of the plant.
    """
    if spec.law is None:
        return None
    law: object = spec.law.get()
    if not isinstance(law, ContinuousLaw) or law.measurement != "held":
        raise InputError(
            f"law: a continuous law that acts on an estimate is needed (type "
            f"'lyapunov_formation'), got a {type(law).__name__}; leave law out for free motion"
        )
    if law.inputs != len(plant.states):
        raise InputError(
            f"law: it sees {law.inputs} values, the plant has {len(plant.states)} states; make it "
            "for this plant"
        )
    return law


def check_scales(scale: Mapping[str, float], nominal: Mapping[str, float]) -> None:
    """Raise `InputError` if scaled parameters of the true plant are impossible.

    A gravitational parameter, a semi-major axis and a rotation rate must not be zero; an
    eccentricity must be that of an ellipse.

    Parameters
    ----------
    scale : mapping
        Factors by name.
    nominal : mapping
        Nominal values by name.
    """
    for name, factor in scale.items():
        last = name.rpartition(".")[2]
        if factor == 0.0 and last.endswith(_POSITIVE):
            raise InputError(f"truth.scale: {name} must stay above zero, got the factor 0")
        value = nominal[name] * factor
        if last == "eccentricity" and not 0.0 <= value < 1.0:
            raise InputError(
                f"truth.scale: {name} must stay below 1, got {nominal[name]:g} × {factor:g} = "
                f"{value:g}"
            )


def sensors_of(refs: Sequence[Ref]) -> tuple[Sensor, ...]:
    """Return the sensors of references."""
    sensors = []
    for ref in refs:
        sensor: object = ref.get()
        if not isinstance(sensor, Sensor):
            raise InputError(f"sensors: a sensor is needed, got a {type(sensor).__name__}")
        sensors.append(sensor)
    return tuple(sensors)


def true_sensors(spec: NavigationSpec, believed: SensorSuite) -> SensorSuite:
    """Return the suite of the true sensors.

    Raises
    ------
    InputError
        If their channels differ from those of the filter's model.
    """
    if not spec.truth.sensors:
        return believed
    suite = SensorSuite(sensors_of(spec.truth.sensors))
    if suite.blocks != believed.blocks:
        raise InputError(
            "truth.sensors: their channels must be those of 'sensors', one by one: "
            f"{_channels(suite)} instead of {_channels(believed)}"
        )
    return suite


def faults_of(spec: NavigationSpec, suite: SensorSuite) -> FaultySensors:
    """Return the true sensors with dropouts, outliers and outages."""
    names = [ref.name for ref in spec.sensors]
    silent = [
        (
            [i for i, name in enumerate(names) if not out.sensors or name in out.sensors],
            *out.interval_s,
        )
        for out in spec.outages
    ]
    return FaultySensors(
        suite, spec.dropouts, spec.outliers, spec.outlier_sigmas, silent, spec.faults_from_s
    )


def members_of(spec: NavigationSpec, suite: SensorSuite) -> tuple[NDArray[np.bool_], ...]:
    """Return the rows (m,) of each member of the filter; all for a joint filter."""
    if not spec.members:
        return (np.ones(suite.rows, dtype=bool),)
    names = [ref.name for ref in spec.sensors]
    rows = [sum(channel.rows for channel in block) for block in suite.blocks]
    return tuple(np.repeat([name in group for name in names], rows) for group in spec.members)


def model_of(
    spec: NavigationSpec, plant: Plant, suite: SensorSuite, law: ContinuousLaw | None
) -> PlantModel:
    """Return the filter's model of the world, without biases."""
    return PlantModel(
        plant,
        suite,
        law=law,
        noise=noise_of(plant),
        step_s=spec.step_s,
        noise_step_s=spec.noise_step_s,
        method=spec.method,
    )


def biases_of(
    spec: NavigationSpec, plant: Plant, suite: SensorSuite, law: ContinuousLaw | None
) -> BiasStates | None:
    """Return the bias states of the filter, those of the attitudes last; None without any.

    Raises
    ------
    InputError
        If a channel or a control is unknown, or a thrust bias is given without a law.
    """
    if not spec.biases and spec.attitude is None:
        return None
    first = 0 if law is None else 2 * law.inputs
    count = len(plant.controls)
    controls = first + count * (1 if law is None else 2)
    shown, commanded = [], []
    columns: list[BiasSpec] = []
    for bias in spec.biases:
        if bias.of == "thrust" and law is None:
            raise InputError("biases: 'thrust' needs a law; without one nothing is commanded")
        if bias.of == "acceleration":
            # one bias for each axis; its rows follow the law's estimate and reference
            groups = [[first + i] for i in _axes_of(bias, plant)]
        elif bias.of == "thrust":  # the same for all axes of a spacecraft
            size = count // thrust_vectors(count)
            groups = [list(range(j, j + size)) for j in range(first + count, controls, size)]
        else:
            groups = [[row] for row in _rows_of(spec, bias, suite)]
        for rows in groups:
            one = np.zeros((suite.rows, 1)), np.zeros((controls, 1))
            one[bias.of in OWN][rows] = 1.0
            shown.append(one[0])
            commanded.append(one[1])
            columns.append(bias)
    angles = 3 * (len(plant.states) // 6)
    turns = [] if spec.attitude is None else attitude_states(spec.attitude)
    k, count = len(columns), angles * len(turns)
    shown.append(np.zeros((suite.rows, count)))
    commanded.append(np.zeros((controls, count)))
    return BiasStates(
        np.array([bias.sigma for bias in columns] + [s for s, _ in turns for _ in range(angles)]),
        np.array([bias.time_s or np.inf for bias in columns]
                 + [time for _, time in turns for _ in range(angles)]),
        np.concatenate(shown, axis=1),
        np.concatenate(commanded, axis=1),
        np.array([bias.considered for bias in columns] + [False] * count),
        np.concatenate([np.zeros((angles, k)), *[np.eye(angles)] * len(turns)], axis=1)
        if turns else None,
    )  # fmt: skip


def refuse_considered(key: str, estimator: Estimator) -> None:
    """Refuse an estimator that takes no considered states, by the key of a mission that names it.

    Raises
    ------
    InputError
        If its attribute ``considers`` is False, see `hillsphere.interfaces.Estimator`.
    """
    if not getattr(estimator, "considers", True):
        raise InputError(
            f"{key}: it estimates all states, but biases has considered ones; take one of type "
            "unscented, iterated_extended or information, or set considered = false"
        )


def stated_covariance(spec: NavigationSpec, plant: Plant) -> Array | None:
    """Return the covariance (6, 6) of the start that its message states; None for a stated belief.

    Raises
    ------
    InputError
        If it is that of the message, and the message states none.
    """
    if spec.belief is None and spec.start.message is None:
        return None
    if spec.belief is not None and spec.belief.source == "stated":
        return None
    try:
        return covariance_of_start(spec.start, plant)
    except InputError as error:
        hint = "" if spec.belief else "; or give belief, with standard deviations"
        raise InputError(f"{error}{hint}") from error


def prior_root(spec: NavigationSpec, rows: Rows, start: Array, stated: Array | None) -> Array:
    """Return a lower root (n, n) of the covariance of the states before the first measurement.

    It is that of a stated covariance (6, 6). Otherwise it is diagonal, for a position the larger of
    an absolute value and a part of the distance from the origin.
    """
    if stated is not None:
        order = np.concatenate([rows.positions, rows.velocities])
        covariance = np.zeros((len(order), len(order)))
        covariance[np.ix_(order, order)] = stated
        return covariance_factor(covariance)
    belief = spec.belief or BeliefSpec(position_relative=0.1)
    sigma = np.full(len(rows.names), belief.velocity_m_s)
    places = start[rows.positions].reshape(-1, 3 if len(rows.positions) % 3 == 0 else 1)
    away = np.repeat(np.linalg.norm(places, axis=1), places.shape[1])
    sigma[rows.positions] = np.maximum(belief.position_relative * away, belief.position_m)
    return np.diag(sigma)


def prior_of(root: Array, x: Array, t_s: Array) -> Belief:
    """Return a belief of means x (n, N) with the same root (n, n) in all cases."""
    roots = np.repeat(root[None], x.shape[1], axis=0)
    return Belief(np.ascontiguousarray(x), roots, t_s)


def _axes_of(bias: BiasSpec, plant: Plant) -> list[int]:
    """Return the controls to which a constant acceleration is added."""
    names = [control.name for control in plant.controls]
    if bias.channel and bias.channel not in names:
        raise InputError(
            f"biases: the plant has no control {bias.channel!r}; it has {', '.join(names)}"
        )
    return [i for i, name in enumerate(names) if bias.channel in ("", name)]


def _rows_of(spec: NavigationSpec, bias: BiasSpec, suite: SensorSuite) -> list[int]:
    """Return the rows of a sensor's channels that have a bias."""
    first, rows, known = 0, [], []
    for ref, block in zip(spec.sensors, suite.blocks, strict=True):
        for channel in block:
            if ref.name == bias.of:
                known.append(channel.name)
                if bias.channel in ("", channel.name):
                    if channel.kind == "direction":
                        raise InputError(
                            f"biases: channel {channel.name!r} of {bias.of!r} is a direction, "
                            "which cannot have one; take a sensor that shows angles"
                        )
                    rows.append(first)
            first += channel.rows
    if not rows:
        raise InputError(
            f"biases: sensor {bias.of!r} has no channel {bias.channel!r}; it has {', '.join(known)}"
        )
    return rows


def _channels(suite: SensorSuite) -> str:
    return "; ".join(", ".join(channel.name for channel in block) for block in suite.blocks)
