"""Common parts of the trackers: orbit state, checks of measurements, predicted angles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import EarthOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.dynamics_brouwer import ZonalField
from hillsphere_tracking.kepler import validate_elements
from hillsphere_tracking.trackers.observation import (
    Site,
    angles,
    cotangent,
    derivatives,
    directions,
    fold_over_zenith,
    join_sites,
    select_site,
    site_of,
    tangents,
)
from hillsphere_tracking.trackers.specs import TrackerSpec

__all__ = [
    "JointCases", "JointTracker", "OrbitState", "field_of", "point_antenna", "predict_angles",
    "start", "validate_measurement",
]  # fmt: skip


@dataclass(frozen=True)
class OrbitState:
    """Estimated orbit of a tracker, N cases.

    Parameters
    ----------
    site : Site
        The antennas.
    t_s : ndarray, shape (N,)
        Times of the elements after the epoch given at the start.
    elements : ndarray, shape (6, N)
        Mean elements a, e, i, Ω, ω, M (m, rad), TEME.
    biases_rad : ndarray, shape (2, N)
        Biases of azimuth and elevation, measured minus true; predictions contain them.
    count : ndarray, shape (N,)
        Number of measurements taken.
    """

    site: Site
    t_s: Array
    elements: Array
    biases_rad: Array
    count: Array


S = TypeVar("S", bound=OrbitState)


@runtime_checkable
class JointTracker(Tracker[Any], Contract, Protocol):
    """A tracker whose cases may be of different passes; campaigns then call it far less often.

    What overrides `predict` must override `point` too.
    """

    def join(self, states: Sequence[Any]) -> Any:
        """Return one state with the cases of several, one after the other."""
        ...

    def select(self, state: Any, cases: Integers) -> Any:
        """Return the state of some cases, given by their numbers (n,)."""
        ...

    def point(self, state: Any, times_s: Array) -> tuple[Array, Array]:
        """Return azimuth and elevation (2, K, N) as `predict` does, with and without biases."""
        ...


class JointCases:
    """The parts of a `JointTracker` that all trackers with an `OrbitState` have in common."""

    def join(self, states: Sequence[S]) -> S:
        """Return one state with the cases of several, one after the other."""
        site = join_sites([s.site for s in states], [s.t_s.size for s in states])
        return _with_site(site, lambda parts: np.concatenate(parts, axis=-1), states)

    def select(self, state: S, cases: Integers) -> S:
        """Return the state of some cases, given by their numbers (n,)."""
        return _with_site(
            select_site(state.site, cases), lambda parts: parts[0][..., cases], [state]
        )


def _with_site(site: Site, of: Callable[[Sequence[Array]], Array], states: Sequence[S]) -> S:
    """Return a state with another site, whose arrays, cases last, are made of those of states.

    A state before the first measurement, to which later ones refer, is made likewise.
    """
    parts: dict[str, Any] = {"site": site}
    for name in (f.name for f in fields(states[0]) if f.name != "site"):
        values = [getattr(state, name) for state in states]
        if all(isinstance(value, OrbitState) for value in values):
            parts[name] = _with_site(site, of, values)
        else:
            parts[name] = None if values[0] is None else of(values)
    return type(states[0])(**parts)


def field_of(spec: TrackerSpec) -> ZonalField:
    """Return the gravity field that a Spec describes."""
    return ZonalField(spec.gm_m3_s2, spec.equatorial_radius_m, spec.j2, spec.j4)


def start(
    elements: Array,
    t_s: Array,
    stations: Sequence[Station],
    epoch: Epoch,
    orientation: EarthOrientation,
) -> OrbitState:
    """Return the state before the first measurement; raise `InputError` if shapes do not match."""
    mean = validate_elements(elements)
    cases = mean.shape[1]
    times = np.atleast_1d(np.asarray(t_s, dtype=float))
    if times.size not in (1, cases) or not np.isfinite(times).all():
        raise InputError(f"times of the elements must be finite, one or {cases}, got {times.shape}")
    if len(stations) not in (1, cases):
        raise InputError(f"stations must be one or {cases}, one a case; got {len(stations)}")
    site = site_of(stations, epoch, orientation)
    count = np.zeros(cases)
    return OrbitState(
        site, np.broadcast_to(times, (cases,)).copy(), mean.copy(), np.zeros((2, cases)), count
    )


def validate_measurement(
    state: OrbitState, t_s: Array, azimuth_rad: Array, elevation_rad: Array
) -> tuple[Array, Array, Array]:
    """Check the times and angles of a measurement and return them as floats, shape (N,).

    A case with angles that are not finite has no measurement.

    Raises
    ------
    InputError
        If a shape does not match or a time is not finite.
    """
    cases = state.t_s.shape
    arrays = []
    for name, given in (("t_s", t_s), ("az_rad", azimuth_rad), ("el_rad", elevation_rad)):
        value = np.array(given, dtype=float)  # a state keeps the times: not the caller's array
        if value.shape != cases:
            if value.size not in (1, cases[0]) or value.ndim > 1:
                raise InputError(f"{name} must be one number or ({cases[0]},), got {value.shape}")
            value = np.broadcast_to(value, cases)
        arrays.append(value)
    if np.count_nonzero(np.isfinite(arrays[0])) < cases[0]:
        raise InputError("times of measurements must be finite, got nan or inf")
    return arrays[0], arrays[1], arrays[2]


def point_antenna(
    state: OrbitState,
    times_s: Array,
    field: ZonalField,
    *,
    short_period: bool,
    clock_s: Array | None = None,
    horizon_rad: Array | None = None,
) -> tuple[Array, Array]:
    """Return the angles of `predict_angles` (2, K, N) with and without biases, no covariances.

    Directions alone take an eighth of the time; the parameters are those of `predict_angles`.
    """

    def direct(clock: Array | None) -> tuple[Array, Array]:
        grid = _true_times(state, times_s, clock, biased=True)
        u = directions(*_spread(state, grid), field, short_period=short_period)
        return angles(u.reshape(3, -1, state.t_s.size))

    true = direct(None)
    seen = true if clock_s is None or not clock_s.any() else direct(clock_s)
    return np.array(_encoder_angles(state, *seen, horizon_rad)), np.array(true)


def predict_angles(
    state: OrbitState,
    times_s: Array,
    field: ZonalField,
    columns: Array,
    covariance: Array,
    walk: Array,
    *,
    short_period: bool,
    biased: bool,
    clock_s: Array | None = None,
    horizon_rad: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Predict the angles that an antenna will measure, and their covariance on the sky.

    The covariance is J P Jᵀ with the Jacobian J of the sky components by all estimated quantities,
    plus the growth of the random walk since the last measurement.

    Parameters
    ----------
    state : OrbitState
        N cases.
    times_s : ndarray, shape (K,) or (K, N)
        Times of the station's clock if `biased`, else true times.
    field : ZonalField
        Gravity field of the planet.
    columns : ndarray, shape (N, 6, n)
        Derivatives of the elements by the n estimated quantities.
    covariance : ndarray, shape (N, m, m)
        Covariance of the n quantities and, if m > n, of the two angle biases, the time bias and
        the horizon bias that follow them; the rows of a bias that is not estimated are zero.
    walk : ndarray, shape (N, n)
        Growth rates of the variances of the n quantities, per second.
    short_period : bool
        Add the short-period terms of J2.
    biased : bool
        Include the biases in the angles and in the covariance.
    clock_s : ndarray, shape (N,), optional
        Time bias: true time minus time of the station's clock; zero by default.
    horizon_rad : ndarray, shape (N,), optional
        Horizon bias: factor of cot h in the bias of the elevation; zero by default.

    Returns
    -------
    azimuth, elevation : ndarray, shape (K, N)
        Azimuth in [0, 2π), elevation at most π/2 (see `fold_over_zenith`).
    covariance : ndarray, shape (2, 2, K, N)
        Covariance of cross-elevation (azimuth times cos h) and elevation, rad².
    """
    cases = state.t_s.size
    true = _true_times(state, times_s, clock_s, biased=biased)
    u, slopes = derivatives(*_spread(state, true), field, short_period=short_period)
    u, slopes = u.reshape(3, -1, cases), slopes.reshape(3, 7, -1, cases)
    azimuth, elevation = angles(u)
    # Derivatives along rising azimuth and elevation, (K, N, 2, 7): regular at the zenith.
    axes = tangents(azimuth, elevation)
    by_all = np.einsum("dckn,cekn->knde", axes, slopes)
    by_estimated = by_all[..., :6] @ columns
    n = columns.shape[2]
    total = by_estimated @ covariance[:, :n, :n] @ by_estimated.swapaxes(-1, -2)
    elapsed = np.abs(true - state.t_s)
    total += (by_estimated * (walk * elapsed[..., None])[..., None, :]) @ by_estimated.swapaxes(
        -1, -2
    )
    if biased and covariance.shape[1] > n:
        # Biases on the sky: cos h for azimuth, 1 for elevation, the motion for time, cot h.
        to_sky = np.zeros((*u.shape[1:], 2, 4))
        to_sky[..., 0, 0] = np.hypot(u[0], u[1])
        to_sky[..., 1, 1] = 1.0
        to_sky[..., 2] = by_all[..., 6]
        to_sky[..., 1, 3] = cotangent(elevation)
        crossed = by_estimated @ covariance[:, :n, n:] @ to_sky.swapaxes(-1, -2)
        total += crossed + crossed.swapaxes(-1, -2)
        total += to_sky @ covariance[:, n:, n:] @ to_sky.swapaxes(-1, -2)
    if biased:
        # Beyond the zenith both axes of the sky change sign, which leaves the covariance unchanged.
        azimuth, elevation = _encoder_angles(state, azimuth, elevation, horizon_rad)
    return azimuth, elevation, total.transpose(2, 3, 0, 1)


def _encoder_angles(
    state: OrbitState, azimuth: Array, elevation: Array, horizon_rad: Array | None
) -> tuple[Array, Array]:
    """Return the angles that an antenna with the state's biases shows."""
    if horizon_rad is not None:
        elevation = elevation + horizon_rad * cotangent(elevation)
    return fold_over_zenith(azimuth + state.biases_rad[0], elevation + state.biases_rad[1])


def _true_times(state: OrbitState, times_s: Array, clock_s: Array | None, *, biased: bool) -> Array:
    """Return true times (K, N) of times of the station's clock if `biased`, else of true times."""
    times = np.atleast_1d(np.asarray(times_s, dtype=float))
    cases = state.t_s.size
    if times.ndim == 1:
        times = times[:, None]
    if times.ndim != 2 or times.shape[1] not in (1, cases) or not np.isfinite(times).all():
        raise InputError(f"times must be finite, (K,) or (K, {cases}), got {np.shape(times_s)}")
    grid = np.broadcast_to(times, (times.shape[0], cases))
    return grid + clock_s if biased and clock_s is not None else grid


def _spread(state: OrbitState, grid: Array) -> tuple[Array, Array, Array, Site]:
    """Return the K·N columns of elements, intervals since them, times, and sites."""
    elements, place, angle = state.elements, state.site.place, state.site.angle_rad
    since = (grid - state.t_s).ravel()
    if (times := grid.shape[0]) > 1:
        elements = np.tile(elements, times)
        place = np.tile(place, times) if place.shape[1] > 1 else place
        angle = np.tile(angle, times) if np.ndim(angle) else angle
    return elements, since, grid.ravel(), Site(place, angle)
