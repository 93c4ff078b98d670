"""Presentation of the stage ``pointing``: tables of errors and axis motions, figures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.presentation import Chart, Metric, Presentation
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere.time import Epoch
from hillsphere_tracking.pointing.figures import (
    axis_chart,
    culmination_chart,
    error_chart,
    keyhole_chart,
)
from hillsphere_tracking.pointing.products import Pointing

__all__ = ["present_pointing"]


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
        "pointing_mounts": tabulate("Mounts", _mount_columns(product)),
        "pointing_errors": tabulate("Errors of pointing", _error_columns(product), notes),
        "pointing_axes": tabulate(
            "Motion of the axes, planned",
            _axis_columns(product, start),
            (
                'Accelerations include the start from rest. The column "ramp begins before the '
                'keyhole" counts from the beginning of the ramp to the nearest approach to the '
                "keyhole. Rewinds are ramps, too.",
            ),
        ),
        "pointing_predictions": tabulate(
            "Predictions and what lies between them", _prediction_columns(product)
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


def _each_mount(product: Pointing, values: Callable[[int], Array]) -> Array:
    """Return values (P,) of each mount, one mount after the other."""
    return np.concatenate([values(m) for m in range(len(product.mounts))])


def _pass_columns(of: FieldColumns) -> list[FilledColumn]:
    return [of("stations", "station"), of("satellites", "satellite"), of("revolution")]


def _mount_columns(product: Pointing) -> list[FilledColumn]:
    of, mounts = FieldColumns(product, "mounts"), range(len(product.mounts))
    columns = [of("mounts", "mount"), of("kinds", "kind")]
    for axis, limits in (
        ("primary", product.primary_limits),
        ("secondary", product.secondary_limits),
    ):
        columns += [
            column(f"{axis}_lower_deg", limits[0], f"{axis}: lower stop", 5),
            column(f"{axis}_upper_deg", limits[1], f"{axis}: upper stop", 5),
            column(f"{axis}_rate_limit_deg_s", limits[2], f"{axis}: largest rate", 5),
            column(
                f"{axis}_acceleration_limit_deg_s2", limits[3], f"{axis}: largest acceleration", 5,
                unit="deg/s2",
            ),
        ]  # fmt: skip
    columns.append(column("passes", [int(product.count.size)] * len(mounts), "passes"))
    for key, error, label in (
        ("followed", product.error_rad, "kept within the lock angle, planned"),
        ("followed_naive", product.naive_error_rad, "kept within it, naive"),
    ):
        kept = [int(np.count_nonzero(_outside(product, error, m) == 0.0)) for m in mounts]
        columns.append(column(key, kept, label))
    return columns


def _error_columns(product: Pointing) -> list[FilledColumn]:
    of = FieldColumns(product, "mounts", "passes")
    planned, naive = product.error_rad, product.naive_error_rad
    distance = _each_mount(product, lambda m: np.nanmin(product.keyhole_distance(m), axis=0))

    def largest_of(error: Array) -> Array:
        return _each_mount(product, lambda m: np.nanmax(error[:, :, m], axis=0))

    def outside_of(error: Array) -> Array:
        return _each_mount(product, lambda m: _outside(product, error, m))

    largest, largest_naive = largest_of(planned), largest_of(naive)
    outside, outside_naive = outside_of(planned), outside_of(naive)
    return [
        of("mounts", "mount"),
        *_pass_columns(of),
        of("elevation_max_rad"),
        column("keyhole_distance_deg", distance, "least distance from the keyhole", 4),
        column("error_max_deg", largest, "largest error, planned", 3),
        of("unramped_error_max_rad", "error_max_unramped_deg"),
        column("error_max_naive_deg", largest_naive, "largest error, naive", 3),
        column("outside_s", outside, "beyond the lock angle, planned", 5),
        of("unramped_outside_s", "outside_unramped_s"),
        column("outside_naive_s", outside_naive, "beyond it, naive", 5),
        text_column("followed", outside == 0.0, "kept within the lock angle"),
    ]


def _axis_columns(product: Pointing, start: Epoch) -> list[FilledColumn]:
    of = FieldColumns(product, "mounts", "passes")
    mounts = range(len(product.mounts))
    pairs = [(m, k, int(n)) for m in mounts for k, n in enumerate(product.count)]
    nearest = [np.nanargmin(product.keyhole_distance(m), axis=0) for m in mounts]
    begin = tuple(start.isot(product.rise_s, 1))
    flipped = [product.flipped[:, k, m].any() for m, k, _ in pairs]
    leads = [_lead(product.ramp[:n, k, m], int(nearest[m][k])) for m, k, n in pairs]
    columns = [
        of("mounts", "mount"),
        *_pass_columns(of),
        text_column("begin", of.spread(begin, "passes"), "begins, UTC"),
        column(
            "primary_begin_deg", [product.primary_rad[0, k, m] for m, k, _ in pairs],
            "primary at the beginning", 5,
        ),
        column(
            "primary_end_deg", [product.primary_rad[n - 1, k, m] for m, k, n in pairs],
            "primary at the end", 5,
        ),
        text_column("flipped", flipped, "over the top"),
        column(
            "ramp_s",
            [product.period_s * int(np.count_nonzero(product.ramp[:n, k, m])) for m, k, n in pairs],
            "on ramps", 5,
        ),
        column(
            "pre_slew_s", [product.period_s * lead for lead in leads],
            "ramp begins before the keyhole", 5,
        ),
        of("primary_rate_on_target_rad_s"),
    ]  # fmt: skip
    for axis, angles in (("primary", product.primary_rad), ("secondary", product.secondary_rad)):
        motion = [_peak_motion(angles[:n, k, m], product.period_s) for m, k, n in pairs]
        columns += [
            column(
                f"{axis}_rate_max_deg_s", [rate for rate, _ in motion], f"{axis}'s rate used", 4,
                is_si=False,
            ),
            column(
                f"{axis}_acceleration_max_deg_s2", [most for _, most in motion],
                "its acceleration used", 3, unit="deg/s2", is_si=False,
            ),
        ]  # fmt: skip
    return columns


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


def _prediction_columns(product: Pointing) -> list[FilledColumn]:
    of = FieldColumns(product, "passes")
    return [
        *_pass_columns(of),
        of("count", "commands"),
        of("sampling_error_rad"),
        of("interpolation_error_rad"),
        of("interpolation_bound_rad"),
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


def _figures(product: Pointing) -> dict[str, Chart]:
    table = "pointing_errors"
    figures = {
        f"pointing_axes_{name}": axis_chart(product, m, table)
        for m, name in enumerate(product.mounts)
    }
    figures["pointing_keyholes"] = keyhole_chart(product, table)
    figures["pointing_errors"] = error_chart(product, table)
    if product.count.size > 1:
        figures["pointing_errors_by_culmination"] = culmination_chart(product, table)
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
