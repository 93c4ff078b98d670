"""Initial states of flights: in the plant's frame, in inertial axes, or as Keplerian elements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere.engine.start_messages import MessageStart, start_of_message
from hillsphere.engine.start_specs import InertialStartSpec, KeplerianStartSpec, StartFormsSpec
from hillsphere.model.ephemeris import mean_from_true, states_of_elements
from hillsphere.spec.base import Spec

__all__ = [
    "Centre",
    "TimedFrame",
    "TurningFrame",
    "covariance_of_start",
    "place_start",
    "with_placed_start",
    "with_placed_start_of",
]

_S = TypeVar("_S", bound="StartFormsSpec")


@dataclass(frozen=True, eq=False)
class Centre:
    """A body relative to which an initial state may be given.

    Parameters
    ----------
    gm_m3_s2 : float
        Its gravitational parameter.
    position_m : ndarray, shape (3,)
        Its position in the plant's frame at the start.
    velocity_m_s : ndarray, shape (3,)
        Its velocity relative to the frame's origin, in inertial axes that coincide with the frame's
        axes at the start.
    """

    gm_m3_s2: float
    position_m: Array
    velocity_m_s: Array


@runtime_checkable
class TurningFrame(Contract, Protocol):
    """A plant with a known rotation of its frame and known positions of bodies."""

    def frame_rate(self, others: Mapping[str, float]) -> Array:
        """Return the frame's angular velocity (3,), rad/s, along its axes.

        `others` are the states that are neither position nor velocity, by name.
        """
        ...

    def centres(self, others: Mapping[str, float]) -> Mapping[str, Centre]:
        """Return the bodies by name, the one at the origin first."""
        ...

    def icrf_axes(self, epoch: Epoch) -> Array:
        """Return the frame's axes in the ICRF as columns (3, 3) at an epoch.

        Raises
        ------
        InputError
            If the inertial orientation of the frame is not known.
        """
        ...


@runtime_checkable
class TimedFrame(Contract, Protocol):
    """A plant whose frame and bodies depend on time as well as on states."""

    def turning_frame(self, time_s: float) -> TurningFrame:
        """Return the frame at a time of the plant's clock, s."""
        ...


def place_start(
    start: StartFormsSpec, plant: object, others: Mapping[str, float], where: str
) -> tuple[Array, Array] | None:
    r"""Convert an initial state to position and velocity in the plant's frame.

    With the frame's angular velocity ω and the centre at :math:`r_c` with the inertial velocity
    :math:`v_c`: :math:`r = r_c + r'`, :math:`v = v_c + v' - \omega \times r`.

    Parameters
    ----------
    start : StartFormsSpec
        The initial state.
    plant : object
        A `TurningFrame`, or a `TimedFrame`, which is evaluated at the start's ``time_s``.
    others : mapping of str to float
        States that are neither position nor velocity, at the start, SI.
    where : str
        The key, for errors.

    Returns
    -------
    tuple of ndarray, each of shape (3,), or None
        Position, m, and velocity, m/s; None if the state is given in the plant's frame already.

    Raises
    ------
    InputError
        If the plant moves several bodies, its frame's rotation or the centre is not known, or the
        elements are invalid.
    """
    form: InertialStartSpec | KeplerianStartSpec | None = start.inertial or start.elements
    if start.message is not None:
        return _from_message(start, plant, others, where)
    if form is None:
        return None
    key = f"{where}.{'inertial' if start.inertial else 'elements'}"
    positions = [v.name for v in getattr(plant, "states", ()) if (v.length, v.time) == (1, 0)]
    if len(positions) > 3:
        raise InputError(
            f"{key}: the plant moves {len(positions) // 3} bodies ({', '.join(positions)}) and "
            f"this is the start of one; give {where}.position and {where}.velocity, three numbers "
            "for each in the plant's frame"
        )
    if isinstance(plant, TimedFrame):
        plant = plant.turning_frame(getattr(start, "time_s", 0.0))
    if not isinstance(plant, TurningFrame):
        raise InputError(
            f"{key}: plant {type(plant).__name__} does not say how its frame turns; give "
            f"{where}.position and {where}.velocity in the plant's frame"
        )
    try:
        centres, rate = plant.centres(others), plant.frame_rate(others)
    except InputError as error:
        raise InputError(f"{key}: {error}") from error
    name = form.about or next(iter(centres))
    if name not in centres:
        raise InputError(f"{key}.about: no body {name!r}; the plant has {', '.join(centres)}")
    centre = centres[name]
    if isinstance(form, InertialStartSpec):
        x = np.array([*form.position_m, *form.velocity_m_s])
    else:
        x = _kepler(form, centre.gm_m3_s2)
    if form.epoch is not None:
        try:
            axes = plant.icrf_axes(Epoch.parse(form.epoch, "TDB"))
        except InputError as error:
            raise InputError(f"{key}: {error}") from error
        x = np.concatenate([axes.T @ x[:3], axes.T @ x[3:]])
    r = centre.position_m + x[:3]
    v = centre.velocity_m_s + x[3:] - np.cross(rate, r)
    return r, v


def covariance_of_start(start: StartFormsSpec, plant: object, where: str = "start") -> Array:
    """Return the covariance (6, 6) of an initial state that a message states, in a plant's frame.

    Parameters
    ----------
    start : StartFormsSpec
        The initial state.
    plant : object
        The plant that defines the frame.
    where : str
        The key, for errors.

    Raises
    ------
    InputError
        If the start is no message, or its message states no covariance at this time.
    """
    given = start.message
    if given is None:
        raise InputError(
            f"{where}.message: expected a message that states a covariance, got a start without one"
        )
    covariance = _read_message(start, plant, getattr(start, "others", {}), where).covariance
    if covariance is None:
        raise InputError(
            f"{where}.message: {Path(given.file).name} states no covariance at the time of the "
            "start; give an OPM with one, or an epoch at which the OEM has one"
        )
    return covariance


def _from_message(
    start: StartFormsSpec, plant: object, others: Mapping[str, float], where: str
) -> tuple[Array, Array]:
    placed = _read_message(start, plant, others, where)
    return placed.x[:3], placed.x[3:]


def _read_message(
    start: StartFormsSpec, plant: object, others: Mapping[str, float], where: str
) -> MessageStart:
    given = start.message
    assert given is not None
    try:
        return start_of_message(
            given.file, plant, name=given.object, epoch=given.epoch, others=others,
            time_s=getattr(start, "time_s", 0.0), lenient=given.lenient, kernels=given.kernels,
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{where}.message: {error}") from error


def with_placed_start(start: _S, plant: object, where: str = "start") -> _S:
    """Return an initial state of any form with position and velocity in the plant's frame.

    Parameters
    ----------
    start : StartFormsSpec
        The initial state, with fields ``position_m``, ``velocity_m_s`` and ``others``.
    plant : object
        The plant that defines the frame.
    where : str
        The key, for errors.

    Returns
    -------
    StartFormsSpec
        `start` itself if it is in the plant's frame already.
    """
    others: Mapping[str, float] = getattr(start, "others", {})
    placed = place_start(start, plant, others, where)
    if placed is None:
        return start
    changes: dict[str, Any] = {
        "position_m": tuple(placed[0].tolist()),
        "velocity_m_s": tuple(placed[1].tolist()),
        "inertial": None,
        "elements": None,
        "message": None,
    }
    return start.model_copy(update=changes)


_SPEC = TypeVar("_SPEC", bound=Spec)


def with_placed_start_of(spec: _SPEC, plant: object) -> _SPEC:
    """Return a stage's Spec with its ``start`` in the plant's frame, see `with_placed_start`."""
    start: StartFormsSpec = spec.start  # type: ignore[attr-defined]
    placed = with_placed_start(start, plant)
    return spec if placed is start else spec.model_copy(update={"start": placed})


def _kepler(form: KeplerianStartSpec, gm_m3_s2: float) -> Array:
    mean = form.mean_anomaly_rad
    if mean is None:
        assert form.true_anomaly_rad is not None
        mean = float(mean_from_true(np.array([form.true_anomaly_rad]), form.eccentricity)[0])
    elements = [
        form.semi_major_axis_m, form.eccentricity, form.inclination_rad, form.node_rad,
        form.periapsis_rad, mean,
    ]  # fmt: skip
    return states_of_elements(np.array(elements)[:, None], gm_m3_s2)[:, 0]
