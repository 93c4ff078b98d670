"""Metrics of each flight of a navigation, and its histories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.engine.course import Rows
from hillsphere.interfaces import Array
from hillsphere.interfaces.cases import Histories, histories_to_keep
from hillsphere_estimators.navigation.filtering import FilterLog

__all__ = ["Record", "histories_of", "metrics_of", "moment", "ratio_to_bound"]


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

    @classmethod
    def of(
        cls, rows: Rows, log: FilterLog, time_s: Array, x: Array, goal: Array, bound_m: Array,
        sensors: int,
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
            np.full(count, np.nan),
        )  # fmt: skip

    def lengths(self, values: Array, which: str) -> Array:
        """Return the lengths (S, …) of position or velocity vectors among values (n, …)."""
        rows = self.rows.positions if which == "position" else self.rows.velocities
        each = values[rows].reshape(self.rows.vectors, -1, *values.shape[1:])
        return np.asarray(np.sqrt(np.sum(each * each, axis=1)))


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
        Of N flights, each with its own bound; NaN for flights that were lost.

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


def metrics_of(
    record: Record, report_at_s: tuple[float, ...], rms_from_s: float
) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Return names, units and values (m, N) of the metrics.

    Parameters
    ----------
    record : Record
        The flights.
    report_at_s : tuple of float
        Times of measurements at which errors are reported.
    rms_from_s : float
        Time from which root mean squares count.
    """
    position = record.lengths(record.error, "position")
    velocity = record.lengths(record.error, "velocity")
    sigma = record.lengths(record.sigma, "position")
    away = record.lengths(record.x - record.goal[:, :, None], "position")
    counted = record.time_s >= rms_from_s - 1e-6
    metrics: dict[str, tuple[str, Array]] = {}
    for i in range(record.rows.vectors):
        s = i + 1
        metrics[f"position_error_{s}"] = "m", position[i, -1]
        metrics[f"velocity_error_{s}"] = "m/s", velocity[i, -1]
        metrics[f"position_sigma_{s}"] = "m", sigma[i, -1]
        metrics[f"rms_position_error_{s}"] = "m", _rms(position[i, counted])
        metrics[f"rms_velocity_error_{s}"] = "m/s", _rms(velocity[i, counted])
        metrics[f"control_error_{s}"] = "m", away[i, -1]
        metrics[f"rms_control_error_{s}"] = "m", _rms(away[i, counted])
        metrics[f"position_bound_{s}"] = "m", record.bound_m[i, -1]
    metrics["nees"] = "-", record.nees[-1]
    metrics["mean_nees"] = "-", np.mean(record.nees[counted], axis=0)
    dof = np.sum(record.used[counted], axis=0)
    metrics["mean_nis"] = "-", np.sum(record.nis[counted], axis=0) / np.maximum(dof, 1.0)
    sent = np.sum(record.sent, axis=0)
    metrics["rejected"] = "-", 1.0 - np.sum(record.used, axis=0) / np.maximum(sent, 1.0)
    metrics["least_seen"] = "-", np.min(np.mean(record.seen, axis=1), axis=0)
    metrics["dv"] = "m/s", record.dv_m_s
    for time in report_at_s:
        k = int(np.argmin(np.abs(record.time_s - time)))
        name = moment(time)
        for i in range(record.rows.vectors):
            metrics[f"position_error_{i + 1}_at_{name}"] = "m", position[i, k]
            metrics[f"velocity_error_{i + 1}_at_{name}"] = "m/s", velocity[i, k]
            metrics[f"position_sigma_{i + 1}_at_{name}"] = "m", sigma[i, k]
        metrics[f"nees_at_{name}"] = "-", record.nees[k]
    units = tuple(unit for unit, _ in metrics.values())
    return tuple(metrics), units, np.array([values for _, values in metrics.values()])


def histories_of(record: Record, begun_s: float, history: bool | Sequence[str]) -> Histories:
    """Return the requested histories of the flights, one value per measurement.

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
    position = record.lengths(record.error, "position")
    velocity = record.lengths(record.error, "velocity")
    sigma = record.lengths(record.sigma, "position")
    away = record.lengths(record.x - record.goal[:, :, None], "position")
    made: dict[str, tuple[str, Array]] = {}
    for i in range(record.rows.vectors):
        made[f"position_error_{i + 1}"] = "m", position[i]
        made[f"velocity_error_{i + 1}"] = "m/s", velocity[i]
        made[f"position_sigma_{i + 1}"] = "m", sigma[i]
        made[f"control_error_{i + 1}"] = "m", away[i]
    made["nees"] = "-", record.nees
    made["nis"] = "-", record.nis / np.maximum(record.used, 1.0)
    for j, name in enumerate(record.rows.names):
        unit = "m/s" if j in record.rows.velocities else "m"
        made[f"error.{name}"] = unit, record.error[j]
        made[f"sigma.{name}"] = unit, record.sigma[j]
    names = histories_to_keep(history, tuple(made))
    times = np.where(np.isnan(record.nees), np.nan, record.time_s[:, None] + begun_s)
    return Histories(
        times, names, tuple(made[n][0] for n in names), np.array([made[n][1] for n in names])
    )


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values * values, axis=0)))
