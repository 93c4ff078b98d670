"""Metrics and histories of the stage ``navigation``: one record for each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from hillsphere.engine.course import Rows
from hillsphere.engine.flight_metrics import FlightHistory, FlightMetric
from hillsphere.interfaces import Array
from hillsphere.simulation import Flights
from hillsphere_estimators.navigation.filtering import FilterLog

__all__ = ["Record", "moment", "navigation_histories", "navigation_metrics", "ratio_to_bound"]


@dataclass(frozen=True)
class Record:
    """Quantities of one block of N flights at K measurements.

    Parameters
    ----------
    rows : Rows
        Rows of positions and velocities of the plant.
    time_s : ndarray, shape (K,)
        Times since the start.
    x : ndarray, shape (n, K, N)
        True states.
    goal : ndarray, shape (n, K)
        Reference.
    error, sigma : ndarray, shape (n, K, N)
        Errors of the estimates, and their standard deviations by the filter.
    nees, nis, used, sent : ndarray, shape (K, N)
        As in `FilterLog`.
    seen : ndarray, shape (B, K, N)
        Whether each of B sensors measured something.
    bound_m : ndarray, shape (S, K, N)
        Cramér-Rao bounds of the position errors, each flight's own.
    dv_m_s : ndarray, shape (N,)
        Δv of the law.
    rms_from_s : float
        Since the start; measurements from then on count in root mean squares and means.
    flights : Flights
        How the simulation ended them.
    """

    rows: Rows
    time_s: Array
    x: Array
    goal: Array
    error: Array
    sigma: Array
    nees: Array
    nis: Array
    used: Array
    sent: Array
    seen: Array
    bound_m: Array
    dv_m_s: Array
    rms_from_s: float
    flights: Flights

    @classmethod
    def of(
        cls, rows: Rows, log: FilterLog, time_s: Array, x: Array, goal: Array, bound_m: Array,
        sensors: int, rms_from_s: float, flights: Flights,
    ) -> Record:  # fmt: skip
        """Return the record of a log, without Δv.

        If all flights have ended early the log has fewer entries than times; the rest is NaN.
        """

        def joined(entries: list[Array], shape: tuple[int, ...]) -> Array:
            out = np.full((len(time_s), *shape), np.nan)
            for k, entry in enumerate(entries):
                out[k] = entry
            return out

        n, count = x.shape[0], x.shape[2]
        error = joined(log.error, (n, count)).transpose(1, 0, 2)
        sigma = joined(log.sigma, (n, count)).transpose(1, 0, 2)
        nees, nis = joined(log.nees, (count,)), joined(log.nis, (count,))
        used, sent = joined(log.used, (count,)), joined(log.sent, (count,))
        seen = joined(log.seen, (sensors, count)).transpose(1, 0, 2)
        return cls(
            rows, time_s, x, goal, error, sigma, nees, nis, used, sent, seen, bound_m,
            np.full(count, np.nan), rms_from_s, flights,
        )  # fmt: skip

    def lengths(self, values: Array, which: str) -> Array:
        """Return the lengths (S, …) of position or velocity vectors among values (n, …)."""
        rows = self.rows.positions if which == "position" else self.rows.velocities
        each = values[rows].reshape(self.rows.vectors, -1, *values.shape[1:])
        return np.asarray(np.sqrt(np.sum(each * each, axis=1)))

    @cached_property
    def position_error_m(self) -> Array:
        """Lengths (S, K, N) of the errors of estimated positions, m."""
        return self.lengths(self.error, "position")

    @cached_property
    def velocity_error_m_s(self) -> Array:
        """Lengths (S, K, N) of the errors of estimated velocities, m/s."""
        return self.lengths(self.error, "velocity")

    @cached_property
    def position_sigma_m(self) -> Array:
        """Roots (S, K, N) of the believed variances of positions, summed over the axes, m."""
        return self.lengths(self.sigma, "position")

    @cached_property
    def control_error_m(self) -> Array:
        """Distances (S, K, N) of the true positions from the reference, m."""
        return self.lengths(self.x - self.goal[:, :, None], "position")

    @cached_property
    def counted(self) -> NDArray[np.bool_]:
        """Mask (K,) of the measurements that count in root mean squares and means."""
        # Times are multiples of the interval, with rounding far below a microsecond.
        return np.asarray(self.time_s >= self.rms_from_s - 1e-6)


def moment(time_s: float) -> str:
    """Return a time as part of the name of a metric: 6h, 90min, 20s."""
    for unit, size in (("h", 3600.0), ("min", 60.0), ("s", 1.0)):
        if abs(time_s / size - round(time_s / size)) < 1e-6:
            return f"{round(time_s / size)}{unit}"
    return f"{time_s:.3f}s".replace(".", "p")


def ratio_to_bound(error: Array, bound: Array) -> tuple[float, float]:
    """Return the ratio of an rms error to its bound, and the standard error of that ratio.

    Parameters
    ----------
    error, bound : ndarray, shape (N,)
        Errors of N flights, each with its own bound; NaN for flights that were lost.

    Returns
    -------
    ratio, standard_error : float
        √(Σe²/Σb²), and its standard error by linearisation (delta method); NaN with fewer than two
        flights.
    """
    there = np.isfinite(error) & np.isfinite(bound)
    e, b = error[there] ** 2, bound[there] ** 2
    if len(e) < 2 or not b.sum() > 0.0:
        return float("nan"), float("nan")
    # of the ratio of two sums: the variance of Σ(e² − q b²) over (Σb²)², q the ratio; then that of
    # √q
    square = float(e.sum() / b.sum())
    spread = float(np.std(e - square * b, ddof=1) * len(e) ** 0.5 / b.sum())
    return square**0.5, 0.5 * spread / max(square, 1e-300) ** 0.5


@dataclass(frozen=True)
class _Spacecraft:
    """One of S spacecraft in a block of flights, at measurement k; −1 is the last."""

    record: Record
    row: int
    k: int = -1

    def rms(self, values: Array) -> Array:
        """Return root mean squares (N,) over the measurements that count, of values (S, K, N)."""
        counted = values[self.row, self.record.counted]
        return np.asarray(np.sqrt(np.mean(counted * counted, axis=0)))


_AT_ANY_TIME: tuple[FlightMetric[_Spacecraft], ...] = (
    FlightMetric("position_error", "m", lambda of: of.record.position_error_m[of.row, of.k]),
    FlightMetric("velocity_error", "m/s", lambda of: of.record.velocity_error_m_s[of.row, of.k]),
    FlightMetric("position_sigma", "m", lambda of: of.record.position_sigma_m[of.row, of.k]),
)
"""Metrics of each spacecraft at the last measurement and at those of `report_at`."""

_OVER_THE_FLIGHT: tuple[FlightMetric[_Spacecraft], ...] = (
    FlightMetric("rms_position_error", "m", lambda of: of.rms(of.record.position_error_m)),
    FlightMetric("rms_velocity_error", "m/s", lambda of: of.rms(of.record.velocity_error_m_s)),
    FlightMetric("control_error", "m", lambda of: of.record.control_error_m[of.row, of.k]),
    FlightMetric("rms_control_error", "m", lambda of: of.rms(of.record.control_error_m)),
    FlightMetric("position_bound", "m", lambda of: of.record.bound_m[of.row, of.k]),
)
"""Further metrics of each spacecraft."""

_OF_THE_FILTER: tuple[FlightMetric[Record], ...] = (
    FlightMetric("nees", "-", lambda record: record.nees[-1]),
    FlightMetric("mean_nees", "-", lambda record: _mean_nees(record)),
    FlightMetric("mean_nis", "-", lambda record: _mean_nis(record)),
    FlightMetric("rejected", "-", lambda record: _rejected_share(record)),
    FlightMetric("least_seen", "-", lambda record: _least_seen(record)),
    FlightMetric("dv", "m/s", lambda record: record.dv_m_s),
)
"""Metrics of a flight, all its spacecraft together.

The mean NIS is per row of measurements that was used. `rejected` is the share of the rows sent that
the gate left out, `least_seen` the share of measurements at which the sensor that saw least saw
something.
"""


def _mean_nees(record: Record) -> Array:
    return np.asarray(np.mean(record.nees[record.counted], axis=0))


def _mean_nis(record: Record) -> Array:
    used = np.sum(record.used[record.counted], axis=0)
    return np.asarray(np.sum(record.nis[record.counted], axis=0) / np.maximum(used, 1.0))


def _rejected_share(record: Record) -> Array:
    sent = np.sum(record.sent, axis=0)
    return np.asarray(1.0 - np.sum(record.used, axis=0) / np.maximum(sent, 1.0))


def _least_seen(record: Record) -> Array:
    return np.asarray(np.min(np.mean(record.seen, axis=1), axis=0))


def navigation_metrics(
    vectors: int, time_s: Array, report_at_s: tuple[float, ...]
) -> tuple[FlightMetric[Record], ...]:
    """Return the metrics of flights.

    Parameters
    ----------
    vectors : int
        Number of spacecraft. The names of their metrics end in 1, 2 …
    time_s : ndarray, shape (K,)
        Times of the measurements since the start.
    report_at_s : tuple of float
        Times of measurements at which errors are given.
    """
    made: list[FlightMetric[Record]] = []
    for row in range(vectors):
        made += [_bind(metric, f"_{row + 1}", row) for metric in (*_AT_ANY_TIME, *_OVER_THE_FLIGHT)]
    made += _OF_THE_FILTER
    for time in report_at_s:
        k, name = int(np.argmin(np.abs(time_s - time))), moment(time)
        for row in range(vectors):
            made += [_bind(m, f"_{row + 1}_at_{name}", row, k) for m in _AT_ANY_TIME]
        made.append(FlightMetric(f"nees_at_{name}", "-", partial(_nees_at, k=k)))
    return tuple(made)


def _bind(
    metric: FlightMetric[_Spacecraft], suffix: str, row: int, k: int = -1
) -> FlightMetric[Record]:
    """Return the metric of one spacecraft at one measurement as a metric of the flight."""
    return FlightMetric(
        metric.name + suffix, metric.unit, lambda record: metric.value(_Spacecraft(record, row, k))
    )


def _nees_at(record: Record, k: int) -> Array:
    return np.asarray(record.nees[k])


def navigation_histories(rows: Rows) -> tuple[FlightHistory[Record], ...]:
    """Return the quantities of which the stage keeps histories, at its measurements.

    Their names are, per spacecraft, ``position_error_S``, ``velocity_error_S``,
    ``position_sigma_S`` and ``control_error_S``; then ``nees``, ``nis`` (per used row),
    ``error.STATE`` and ``sigma.STATE``.

    Parameters
    ----------
    record : Record
        The flights.
    begun_s : float
        Time of the plant at the start.
    history : bool or sequence of str
        All, none, or the names of those that are kept.
    """
    made: list[FlightHistory[Record]] = []
    for row in range(rows.vectors):
        for name, unit, source in (
            ("position_error", "m", "position_error_m"),
            ("velocity_error", "m/s", "velocity_error_m_s"),
            ("position_sigma", "m", "position_sigma_m"),
            ("control_error", "m", "control_error_m"),
        ):
            values = partial(_row_of, source=source, row=row)
            made.append(FlightHistory(f"{name}_{row + 1}", unit, values))
    made.append(FlightHistory("nees", "-", lambda record: record.nees))
    made.append(FlightHistory("nis", "-", lambda record: record.nis / np.maximum(record.used, 1.0)))
    for j, state in enumerate(rows.names):
        unit = "m/s" if j in rows.velocities else "m"
        for name in ("error", "sigma"):
            values = partial(_row_of, source=name, row=j)
            made.append(FlightHistory(f"{name}.{state}", unit, values))
    return tuple(made)


def _row_of(record: Record, source: str, row: int) -> Array:
    values: Array = getattr(record, source)
    return np.asarray(values[row])
