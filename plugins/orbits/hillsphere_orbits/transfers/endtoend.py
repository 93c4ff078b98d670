"""Verification of transfers by propagation from their first state: closure and clearance.

A search finds a transfer in pieces (an arc of an orbit, a strand of a manifold), each with
states of its own. Here only the first state is taken over: every coast starts where the last one
really ended, after the impulse as planned, so that what is missed at a patch point shows, and grows
as it would in flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import Taylor
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere.symbolic import dot, gradient
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.survey import LockedMoon

__all__ = ["EndToEnd", "Leg", "heights_m", "least_heights_m", "verify"]

_SURFACE, _APSIS = "surface", "apsis"
_NEWTON = 60
"""Most steps of Newton's iteration. From t = 0 a step makes a_i² + t at most half as large again,
so that these reach places 1e10 semi-axes away."""
_PROPAGATORS: WeakKeyDictionary[Plant, Taylor] = WeakKeyDictionary()


@dataclass(frozen=True)
class Leg:
    """A coast and the impulse at its end, of N transfers at once.

    Parameters
    ----------
    name : str
        What is flown.
    duration_s : ndarray, shape (N,)
        Length of the coast.
    impulse_m_s : ndarray, shape (3, N)
        Planned impulse at its end; zero where there is none.
    end : ndarray, shape (6, N)
        Planned state after the impulse, SI.
    """

    name: str
    duration_s: Array
    impulse_m_s: Array
    end: Array


@dataclass(frozen=True)
class EndToEnd:
    """Misses and altitudes of N transfers of K legs.

    Parameters
    ----------
    names : tuple of str, length K
        The legs.
    position_km : ndarray, shape (K, N)
        Distance of the state flown from the planned one after each leg; infinite after an impact.
    velocity_m_s : ndarray, shape (K, N)
        Likewise of the velocities after the impulse.
    dv_m_s : ndarray, shape (N,)
        Sum of the impulses.
    duration_s : ndarray, shape (N,)
        Sum of the coasts.
    distance_m : ndarray, shape (N,)
        Least distance from the centre of the body.
    altitude_m : ndarray, shape (N,)
        Least height above its surface; NaN if the plant has no surface, zero after an impact.
    impact : ndarray of bool, shape (N,)
        Whether the flight met the surface.
    places_m : ndarray, shape (3, P)
        Where on the ways the body may be nearest.
    place_lane : ndarray of int, shape (P,)
        Their transfers.
    """

    names: tuple[str, ...]
    position_km: Array
    velocity_m_s: Array
    dv_m_s: Array
    duration_s: Array
    distance_m: Array
    altitude_m: Array
    impact: NDArray[np.bool_]
    places_m: Array
    place_lane: NDArray[np.intp]

    @property
    def closure_km(self) -> Array:
        """Largest miss of a patch point, (N,)."""
        return np.asarray(np.max(self.position_km, axis=0))

    @property
    def closure_m_s(self) -> Array:
        """Largest miss of a velocity, (N,)."""
        return np.asarray(np.max(self.velocity_m_s, axis=0))


def verify(plant: Plant, start: Array, legs: Sequence[Leg]) -> EndToEnd:
    """Fly transfers from their first states with the Taylor propagator.

    Parameters
    ----------
    plant : Plant
        Equations of motion, autonomous and wholly symbolic; states x, y, z, vx, vy, vz.
    start : ndarray, shape (6, N)
        States at the beginning, SI.
    legs : sequence of Leg
        In the order of flight.

    Returns
    -------
    EndToEnd
        Misses, sums, least height. After an impact a transfer is flown no further.

    Raises
    ------
    InputError
        If there is no leg, the shapes do not fit, or the plant's terms are functions of arrays.
    PropagationError
        If a flight turns non-finite.
    """
    taylor = _propagator(plant)
    unit, clock = taylor.system.unit[:, None], taylor.system.time_unit_s
    flown = np.array(start, dtype=float)
    if flown.ndim != 2 or len(flown) != len(unit):
        raise InputError(f"start must be ({len(unit)}, N), got {flown.shape}")
    if not legs:
        raise InputError("a transfer needs at least one leg")
    cases = flown.shape[1]
    impact = np.zeros(cases, dtype=bool)
    # places where the body may be nearest, as (states, lane)
    near, whose = [flown[:3]], [np.arange(cases)]
    position, velocity = np.full((2, len(legs), cases), np.inf)
    for k, leg in enumerate(legs):
        if leg.end.shape != flown.shape or leg.impulse_m_s.shape != (3, cases):
            raise InputError(f"leg {leg.name!r}: {cases} transfers, but {leg.end.shape} ends")
        go = np.flatnonzero(~impact)
        # a leg starts from where the last one really ended, so that misses add up
        flight = taylor.fly(flown[:, go] / unit, leg.duration_s[go] / clock)
        impact[go] = [why is not None for why in flight.ended_by]
        flown[:, go] = flight.x * unit
        near.append(flown[:3, go])
        whose.append(go)
        # stationary points of the distance and of the height along the way: the least is among them
        for met in flight.crossings.values():
            near += [states[:3] * unit[:3] for _, states in met]
            whose += [np.full(states.shape[1], i) for i, (_, states) in zip(go, met, strict=True)]
        # the planned impulse, not one that corrects the miss
        flown[3:6] += leg.impulse_m_s
        miss = np.where(impact, np.inf, flown - leg.end)
        position[k] = np.linalg.norm(miss[:3], axis=0) / 1e3
        velocity[k] = np.linalg.norm(miss[3:6], axis=0)
    places, lanes = np.concatenate(near, axis=1), np.concatenate(whose)
    return EndToEnd(
        names=tuple(leg.name for leg in legs),
        position_km=position,
        velocity_m_s=velocity,
        dv_m_s=np.sum([np.linalg.norm(leg.impulse_m_s, axis=0) for leg in legs], axis=0),
        duration_s=np.sum([leg.duration_s for leg in legs], axis=0),
        distance_m=_least(np.linalg.norm(places, axis=0), lanes, cases),
        altitude_m=least_heights_m(plant, places, lanes, impact),
        impact=impact,
        places_m=places,
        place_lane=lanes,
    )


def least_heights_m(
    plant: Plant, places: Array, lanes: NDArray[np.intp], impact: NDArray[np.bool_]
) -> Array:
    """Least height of every transfer; see `heights_m`.

    Parameters
    ----------
    plant : Plant
        Tells of the body.
    places : ndarray, shape (3, P)
        Positions in the plant's frame, m.
    lanes : ndarray of int, shape (P,)
        Their transfers.
    impact : ndarray of bool, shape (N,)
        Whether a transfer met the surface.

    Returns
    -------
    ndarray, shape (N,)
        Least heights, m; zero after an impact, NaN without a surface.
    """
    least = _least(heights_m(plant, places), lanes, impact.size)
    return np.where(impact, 0.0, least)


def heights_m(plant: Plant, places: Array) -> Array:
    """Height of places above the surface of the plant's body.

    Parameters
    ----------
    plant : Plant
        Its body is an ellipsoid at the origin, or it tells of none.
    places : ndarray, shape (3, N)
        Positions in the plant's frame, m.

    Returns
    -------
    ndarray, shape (N,)
        Distance to the nearest point of the surface, m; zero inside, NaN without a surface.

    Notes
    -----
    The nearest point of an ellipsoid is a_i² r_i/(a_i² + t) with the root t ≥ 0 of
    Σ (a_i r_i/(a_i² + t))² = 1, which falls and is convex: Newton's iteration from t = 0 rises to
    it.
    """
    axes = plant.semi_axes_m if isinstance(plant, LockedMoon) else None
    if axes is None or not isinstance(plant, LockedMoon):
        return np.full(places.shape[1], np.nan)
    c, s = np.cos(plant.prime_meridian_rad), np.sin(plant.prime_meridian_rad)
    # into the axes of the body, turned by its prime meridian
    body = np.array([c * places[0] + s * places[1], c * places[1] - s * places[0], places[2]])
    squares = np.array(axes)[:, None] ** 2
    t = np.zeros(places.shape[1])
    for _ in range(_NEWTON):
        parts = squares * body**2 / (squares + t) ** 2
        excess = np.sum(parts, axis=0) - 1.0
        step = 0.5 * excess / np.sum(parts / (squares + t), axis=0, initial=1e-300)
        t = np.maximum(0.0, t + step)
        if np.all(np.abs(step) <= 1e-14 * (squares[0] + t)):
            break
    return np.asarray(np.linalg.norm(t * body / (squares + t), axis=0))


def _propagator(plant: Plant) -> Taylor:
    """Return the plant's propagator that records where the body is nearest; kept with the plant."""
    if plant not in _PROPAGATORS:
        system = flow_of(plant).system
        names = ("x", "y", "z", "vx", "vy", "vz")
        if tuple(v.name for v in system.states) != names:
            raise InputError(f"transfers need a plant with the states {', '.join(names)}")
        record = {_APSIS: dot(system.x[:3], system.x[3:])}
        ends = [name for name in ("impact",) if name in system.events]
        if ends:
            slope = gradient(system.events["impact"], system.x[:3])
            record[_SURFACE] = dot(slope, system.x[3:])
        _PROPAGATORS[plant] = Taylor(system, events=ends, record=record)
    return _PROPAGATORS[plant]


def _least(values: Array, lanes: NDArray[np.intp], cases: int) -> Array:
    """Return the least value of each lane."""
    least = np.full(cases, np.inf)
    np.minimum.at(least, lanes, values)
    return least
