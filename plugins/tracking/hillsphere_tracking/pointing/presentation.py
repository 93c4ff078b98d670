"""Presentation of the stage ``pointing``: tables of errors and axis motions, figures."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere.time import Epoch
from hillsphere_tracking.pointing.figures import (
    draw_axes,
    draw_errors,
    draw_errors_by_culmination,
    draw_keyholes,
)
from hillsphere_tracking.pointing.products import Pointing

__all__ = ["present_pointing"]

_PASS = (
    Column("mount", "", "mount"),
    Column("station", "", "station"),
    Column("satellite", "", "satellite"),
    Column("revolution", "-", "revolution"),
)
_ERRORS = (
    *_PASS,
    Column("elevation_max_deg", "deg", "highest elevation", 4),
    Column("keyhole_distance_deg", "deg", "least distance from the keyhole", 4),
    Column("error_max_deg", "deg", "largest error, planned", 3),
    Column("error_max_unramped_deg", "deg", "largest error, only the turn planned", 3),
    Column("error_max_naive_deg", "deg", "largest error, naive", 3),
    Column("outside_s", "s", "beyond the lock angle, planned", 5),
    Column("outside_unramped_s", "s", "beyond it, only the turn planned", 5),
    Column("outside_naive_s", "s", "beyond it, naive", 5),
    Column("followed", "", "kept within the lock angle"),
)
_AXES = (
    *_PASS,
    Column("begin", "", "begins, UTC"),
    Column("primary_begin_deg", "deg", "primary at the beginning", 5),
    Column("primary_end_deg", "deg", "primary at the end", 5),
    Column("flipped", "", "over the top"),
    Column("ramp_s", "s", "on ramps", 5),
    Column("pre_slew_s", "s", "ramp begins before the keyhole", 5),
    Column("primary_rate_on_target_deg_s", "deg/s", "primary's rate if on target", 4),
    Column("primary_rate_max_deg_s", "deg/s", "primary's rate used", 4),
    Column("primary_acceleration_max_deg_s2", "deg/s2", "its acceleration used", 3),
    Column("secondary_rate_max_deg_s", "deg/s", "secondary's rate used", 4),
    Column("secondary_acceleration_max_deg_s2", "deg/s2", "its acceleration used", 3),
)
_MOUNTS = (
    Column("mount", "", "mount"),
    Column("kind", "", "kind"),
    *(
        Column(f"{axis}_{name}_{unit.replace('/', '_')}", unit, f"{axis}: {label}", 5)
        for axis in ("primary", "secondary")
        for name, unit, label in (
            ("lower", "deg", "lower stop"),
            ("upper", "deg", "upper stop"),
            ("rate_limit", "deg/s", "largest rate"),
            ("acceleration_limit", "deg/s2", "largest acceleration"),
        )
    ),
    Column("passes", "-", "passes"),
    Column("followed", "-", "kept within the lock angle, planned"),
    Column("followed_naive", "-", "kept within it, naive"),
)
_PREDICTIONS = (
    *_PASS[1:],
    Column("commands", "-", "commands"),
    Column("sampling_error_deg", "deg", "course of the satellite, from half its samples", 2),
    Column("interpolation_error_deg", "deg", "error between predictions", 2),
    Column("interpolation_bound_deg", "deg", "its bound", 2),
)


def present_pointing(product: Pointing, start: Epoch) -> Presentation:
    """Return tables, figures and verdict of mounts that follow passes.

    Parameters
    ----------
    product : Pointing
        Commands and errors.
    start : Epoch
        Origin of the times of its passes.

    Returns
    -------
    Presentation
        Presentation; the metrics describe the worst pass of each mount.
    """
    lock = np.degrees(product.lock_angle_rad)
    notes = (
        f"Errors are angles on the sky between beam and satellite, at commands every "
        f"{product.period_s:g} s; the lock angle is {lock:g}°.",
        "Planned: turn, flip, rewinds and ramps through keyholes are chosen before the pass. A "
        "ramp minimises the largest error, not the time beyond the lock angle. Only the turn "
        "planned: the axes begin on the turn of the plan and follow the target as fast as they "
        "can. Naive: "
        "the axes begin on the turn nearest to the middle of the stops, and rewind at a stop.",
        "All axes begin at rest at the rise, on their first command.",
    )
    tables = {
        "pointing_mounts": Table("Mounts", _MOUNTS, _mount_rows(product)),
        "pointing_errors": Table("Errors of pointing", _ERRORS, _error_rows(product), notes),
        "pointing_axes": Table(
            "Motion of the axes, planned",
            _AXES,
            _axis_rows(product, start),
            (
                'Accelerations include the start from rest. The column "ramp begins before the '
                'keyhole" counts from the beginning of the ramp to the nearest approach to the '
                "keyhole. Rewinds are ramps, too.",
            ),
        ),
        "pointing_predictions": Table(
            "Predictions and what lies between them", _PREDICTIONS, _prediction_rows(product)
        ),
    }
    return Presentation(
        metrics=_metrics(product),
        tables=tables,
        figures=_figures(product),
        verdict=_verdict(product),
    )


def _largest(error: Array, mount: int) -> Array:
    """Return the largest error of each pass (deg), shape (P,)."""
    return np.asarray(np.degrees(np.nanmax(error[:, :, mount], axis=0)))


def _outside(product: Pointing, error: Array, mount: int) -> Array:
    """Return the time for which the error of each pass exceeds the lock angle (s), shape (P,)."""
    beyond = np.count_nonzero(error[:, :, mount] > product.lock_angle_rad, axis=0)
    return np.asarray(product.period_s * beyond)


def _pass_cells(product: Pointing, k: int) -> dict[str, Cell]:
    return {
        "station": product.stations[k],
        "satellite": product.satellites[k],
        "revolution": int(product.revolution[k]),
    }


def _mount_rows(product: Pointing) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for m, name in enumerate(product.mounts):
        row: dict[str, Cell] = {"mount": name, "kind": product.kinds[m]}
        for axis, limits in (
            ("primary", product.primary_limits),
            ("secondary", product.secondary_limits),
        ):
            for key, value in zip(
                ("lower_deg", "upper_deg", "rate_limit_deg_s", "acceleration_limit_deg_s2"),
                np.degrees(limits[:, m]).tolist(),
                strict=True,
            ):
                row[f"{axis}_{key}"] = value
        row["passes"] = int(product.count.size)
        for key, error in (
            ("followed", product.error_rad),
            ("followed_naive", product.naive_error_rad),
        ):
            row[key] = int(np.count_nonzero(_outside(product, error, m) == 0.0))
        rows.append(row)
    return rows


def _error_rows(product: Pointing) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for m, name in enumerate(product.mounts):
        distance = np.degrees(np.nanmin(product.keyhole_distance(m), axis=0))
        planned, naive = (_largest(q, m) for q in (product.error_rad, product.naive_error_rad))
        lost, lost_naive = (
            _outside(product, q, m) for q in (product.error_rad, product.naive_error_rad)
        )
        rows += [
            {
                "mount": name,
                **_pass_cells(product, k),
                "elevation_max_deg": float(np.degrees(product.elevation_max_rad[k])),
                "keyhole_distance_deg": float(distance[k]),
                "error_max_deg": float(planned[k]),
                "error_max_unramped_deg": float(np.degrees(product.unramped_error_max_rad[k, m])),
                "error_max_naive_deg": float(naive[k]),
                "outside_s": float(lost[k]),
                "outside_unramped_s": float(product.unramped_outside_s[k, m]),
                "outside_naive_s": float(lost_naive[k]),
                "followed": bool(lost[k] == 0.0),
            }
            for k in range(product.count.size)
        ]
    return rows


def _axis_rows(product: Pointing, start: Epoch) -> list[dict[str, Cell]]:
    begin = start.isot(product.rise_s, 1)
    rows: list[dict[str, Cell]] = []
    for m, name in enumerate(product.mounts):
        distance = product.keyhole_distance(m)
        for k, n in enumerate(product.count):
            primary = product.primary_rad[:n, k, m]
            ramp = product.ramp[:n, k, m]
            rate, acceleration = _peak_motion(primary, product.period_s)
            rate_2, acceleration_2 = _peak_motion(product.secondary_rad[:n, k, m], product.period_s)
            lead = _lead(ramp, int(np.nanargmin(distance[:, k])))
            rows.append(
                {
                    "mount": name,
                    **_pass_cells(product, k),
                    "begin": begin[k],
                    "primary_begin_deg": float(np.degrees(primary[0])),
                    "primary_end_deg": float(np.degrees(primary[-1])),
                    "flipped": bool(product.flipped[:, k, m].any()),
                    "ramp_s": product.period_s * int(np.count_nonzero(ramp)),
                    "pre_slew_s": product.period_s * lead,
                    "primary_rate_on_target_deg_s": float(
                        np.degrees(product.primary_rate_on_target_rad_s[k, m])
                    ),
                    "primary_rate_max_deg_s": rate,
                    "primary_acceleration_max_deg_s2": acceleration,
                    "secondary_rate_max_deg_s": rate_2,
                    "secondary_acceleration_max_deg_s2": acceleration_2,
                }
            )
    return rows


def _peak_motion(angle: Array, period_s: float) -> tuple[float, float]:
    """Return the largest rate (deg/s) and acceleration (deg/s²) of commands that start at rest."""
    rate = np.diff(np.degrees(angle), prepend=np.degrees(angle[0])) / period_s
    return float(np.abs(rate).max()), float(np.abs(np.diff(rate)).max()) / period_s


def _lead(ramp: NDArray[np.bool_], nearest: int) -> int:
    """Return the number of commands from the beginning of a ramp to the nearest approach."""
    if not ramp[nearest]:
        return 0
    off = np.flatnonzero(~ramp[:nearest])
    return nearest - (int(off[-1]) + 1 if off.size else 0)


def _prediction_rows(product: Pointing) -> list[dict[str, Cell]]:
    return [
        {
            **_pass_cells(product, k),
            "commands": int(product.count[k]),
            "sampling_error_deg": float(np.degrees(product.sampling_error_rad[k])),
            "interpolation_error_deg": float(np.degrees(product.interpolation_error_rad[k])),
            "interpolation_bound_deg": float(np.degrees(product.interpolation_bound_rad[k])),
        }
        for k in range(product.count.size)
    ]


def _metrics(product: Pointing) -> dict[str, Metric]:
    metrics = {"pointing_passes": Metric(int(product.count.size))}
    for m, name in enumerate(product.mounts):
        for suffix, error in (("", product.error_rad), ("_naive", product.naive_error_rad)):
            lost = _outside(product, error, m)
            metrics[f"{name}_error_max{suffix}"] = Metric(float(_largest(error, m).max()), "deg")
            metrics[f"{name}_outside_max{suffix}"] = Metric(float(lost.max()), "s")
            metrics[f"{name}_followed{suffix}"] = Metric(int(np.count_nonzero(lost == 0.0)))
    return metrics


def _figures(product: Pointing) -> dict[str, Figure]:
    mounts = len(product.mounts)
    figures = {
        f"pointing_axes_{name}": Figure(
            f"Axes of {name}",
            partial(draw_axes, product=product, mount=m, chosen=product.telling_pass(m)),
            "Angles and rates of both axes in the pass with the largest error, or with the largest "
            "naive error if all planned errors are small. Dotted: stops and largest rates.",
            size_in=(8.6, 5.6),
        )
        for m, name in enumerate(product.mounts)
    }
    figures["pointing_keyholes"] = Figure(
        "Satellite and beam near the keyhole",
        partial(draw_keyholes, product=product),
        "The same passes, around the direction of the primary axis. Thin lines connect satellite "
        "and planned beam at equal times.",
        size_in=(4.4 * min(2, mounts), 0.3 + 4.1 * -(-mounts // 2)),
    )
    figures["pointing_errors"] = Figure(
        "Errors during a pass",
        partial(draw_errors, product=product),
        "The same passes; the largest error of each second. Errors below 1e-4° are drawn at 1e-4°.",
        size_in=(7.5, 0.8 + 2.2 * mounts),
    )
    if product.count.size > 1:
        figures["pointing_errors_by_culmination"] = Figure(
            "Largest errors of all passes",
            partial(draw_errors_by_culmination, product=product),
            "Filled: planned. Open: naive. Errors below 1e-4° are drawn at 1e-4°.",
            size_in=(7.0, 4.2),
        )
    return figures


def _verdict(product: Pointing) -> list[str]:
    lock, count = np.degrees(product.lock_angle_rad), product.count.size
    said = []
    for m, name in enumerate(product.mounts):
        planned, naive = (_largest(q, m) for q in (product.error_rad, product.naive_error_rad))
        lost, lost_naive = (
            _outside(product, q, m) for q in (product.error_rad, product.naive_error_rad)
        )
        k = int(np.argmax(planned))
        kept, kept_naive = (int(np.count_nonzero(q <= lock)) for q in (planned, naive))
        said.append(
            f"Mount {name}: the error stays within {lock:g}° in {kept} of {count} "
            f"pass{'' if count == 1 else 'es'} with a plan, in {kept_naive} without. Largest "
            f"error {planned[k]:.3g}° ({naive[k]:.3g}° without a plan) over "
            f"{product.stations[k]}, revolution {product.revolution[k]}. Time beyond the lock "
            f"angle: {lost.sum():.3g} s in total ({lost_naive.sum():.3g} s without a plan), "
            f"{lost.max():.3g} s at most in one pass ({lost_naive.max():.3g} s)."
        )
    if product.short:
        said.append(
            f"{product.short} pass{'' if product.short == 1 else 'es'} "
            f"{'is' if product.short == 1 else 'are'} left out: too short for a plan."
        )
    doubtful = product.sampling_error_rad > 0.1 * product.lock_angle_rad
    if doubtful.any():
        said.append(
            f"In {int(np.count_nonzero(doubtful))} passes the interpolation between the samples "
            "may be wrong by more than a tenth of the lock angle."
        )
    return said
