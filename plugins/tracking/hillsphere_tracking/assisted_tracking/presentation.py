"""Presentation of one case of ``assisted_tracking``: tables beside published values, figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import Cell, Chart, Column, Metric, Presentation, Table
from hillsphere.show.reference import (
    PAPER_SUFFIX,
    ReferenceTable,
    beside,
    difference_notes,
    with_paper,
)
from hillsphere.show.tables import FieldColumns, column, tabulate, text_column
from hillsphere_tracking.assisted_tracking.figures import (
    ROWS_PER_FIGURE,
    SKIES_PER_FIGURE,
    error_chart,
    sky_chart,
    spread_chart,
)
from hillsphere_tracking.assisted_tracking.measures import MEASURES, MetricName
from hillsphere_tracking.assisted_tracking.products import AssistedTracking
from hillsphere_tracking.assisted_tracking.specs import AssistedTrackingSpec

__all__ = ["case_values", "present_case"]

_MOST_PASSES = 12
"""Passes that are drawn at most: four figures of three rows, as many as a reader compares."""
_DRAWN = ("noise_azimuth_deg", "noise_elevation_deg")
_PUBLISHED = "published_"
_SUFFIXES = {"rad": "_deg", "s": "_s", "-": ""}
"""Suffix of the columns of a measure, by its unit."""
_HEADINGS = {
    "error_max": "largest error √(ΔA² + Δh²)",
    "sky_error_max": "largest error on the sky",
    "encoder_error_max": "largest error at the encoders",
    "time_outside": "time outside the beam",
    "nees": "NEES in the middle of the outage",
    "time_to_reacquire": "time to reacquire, to the set if not found",
    "found": "found before the set",
    "found_at_once": "found at once",
}


def present_case(product: AssistedTracking, spec: AssistedTrackingSpec) -> Presentation:
    """Return tables, figures, metrics and verdict of one case.

    Parameters
    ----------
    product : AssistedTracking
        The case.
    spec : AssistedTrackingSpec
        Spec of the stage, with the published values and the label.

    Returns
    -------
    Presentation
        Tables ``tracked_passes``, ``antenna_errors`` and ``tracking``; figures ``tracking_errors``,
        ``tracking_spread`` and ``tracking_sky``; metrics with the mean over the outages of each
        tracker's largest errors.

    Raises
    ------
    InputError
        If the published values cannot be read, or have no column ``pass``.
    """
    reference = ReferenceTable.read(spec.reference) if spec.reference else None
    suffix = f"_{spec.label}" if spec.label else ""
    values = case_values(product)
    tables = {
        "tracked_passes": _pass_table(product, reference),
        "antenna_errors": _error_table(product, reference),
        "tracking": _case_table(product, values),
    }
    metrics = {
        f"tracking_{tracker}_{measure}".lower().replace("-", "_"): Metric(
            float(np.mean(values[measure][t])), MEASURES[measure]
        )
        for measure in ("error_max", "encoder_error_max")
        for t, tracker in enumerate(product.trackers)
        if np.isfinite(values[measure][t]).all()
    }
    return Presentation(
        metrics={name + suffix: metric for name, metric in metrics.items()},
        tables={name + suffix: table for name, table in tables.items()},
        figures={name + suffix: figure for name, figure in _figures(product, suffix).items()},
        verdict=_verdict(product, values),
    )


def case_values(product: AssistedTracking) -> dict[str, Array]:
    """Return the values (T, L) of each measure of the case; NaN where a measure has no value."""
    trackers = {name: t for t, name in enumerate(product.trackers)}
    outages = {
        (product.passes[p], name): k
        for k, (p, name) in enumerate(zip(product.outage_pass, product.outage_names, strict=True))
    }
    values = {name: np.full((len(trackers), len(outages)), np.nan) for name in MEASURES}
    for metric, value in zip(product.metrics, product.values, strict=True):
        name = MetricName.parse(metric)
        if name is not None and name.measure in values:
            values[name.measure][trackers[name.tracker], outages[name.pass_, name.outage]] = value
    return values


def _pass_table(product: AssistedTracking, reference: ReferenceTable | None) -> Table:
    of = FieldColumns(product, "passes")
    notes = [
        "The Earth is turned by the least angle to the requested side that gives the elevation."
    ]
    table = tabulate(
        "Passes",
        [
            of("passes", "pass"),
            of("stations", "station"),
            of("revolution"),
            of("directions", "direction"),
            of("plain_duration_s", "duration_s"),
            of("plain_elevation_max_rad", "elevation_max_deg"),
            of("earth_shift_rad", "earth_turned_deg"),
            of("acquisition_s", "tracked_acquisition_s"),
            of("duration_s", "tracked_duration_s"),
            of("elevation_max_rad", "tracked_elevation_max_deg"),
            of("station_error_m"),
        ],
        notes,
    )
    if reference is None:
        return table
    rows = beside(table.rows, reference, on="pass")
    for row in rows:
        twin = reference.match("pass", row["pass"], 0.0) or {}
        row["note"] = twin.get("note")
    columns = with_paper([*table.columns, Column("note", "", "note")], rows)
    notes += difference_notes(rows, reference, label="pass")
    return Table("Passes", columns, rows, notes)


def _error_table(product: AssistedTracking, reference: ReferenceTable | None) -> Table:
    noise = product.measured_rad - product.true_rad - product.bias_rad
    noise[0] = np.arctan2(np.sin(noise[0]), np.cos(noise[0]))
    of = FieldColumns(product, "passes")
    filled = [of("passes", "pass"), of("stations", "station")]
    for what, word, angles in (
        ("bias", "bias", product.bias_rad),
        ("noise", "noise", noise),
        ("sigma", "σ", product.sigma_rad),
    ):
        for angle, values in zip(("azimuth", "elevation"), angles, strict=True):
            largest = [_largest(q) for q in values.T]
            filled.append(
                column(f"{what}_{angle}_deg", largest, f"largest {word}, {angle}", 3, is_si=False)
            )
    notes = ["Values of the largest magnitude over the pass, with sign. The noise is one draw."]
    table = tabulate("Errors of the antenna", filled, notes)
    if reference is None:
        return table
    rows = [_draws_apart(row) for row in beside(table.rows, reference, on="pass")]
    columns = with_paper(table.columns, rows)
    for name in _DRAWN:
        if any(f"{_PUBLISHED}{name}" in row for row in rows):
            at = next(k for k, column_ in enumerate(columns) if column_.name == name)
            label = f"{columns[at].label}, paper's draw"
            columns.insert(at + 1, Column(f"{_PUBLISHED}{name}", "deg", label, 3))
            notes[0] = (
                "Values of the largest magnitude over the pass, with sign. The noise is one "
                "random draw here and in the paper; their difference has no meaning."
            )
    notes.append(f"Paper: {reference.source}.")
    return Table("Errors of the antenna", columns, rows, notes)


def _draws_apart(row: Mapping[str, Cell]) -> dict[str, Cell]:
    """Rename published draws in a row, so that no difference to our draws is computed."""
    apart = {f"{name}{PAPER_SUFFIX}": f"{_PUBLISHED}{name}" for name in _DRAWN}
    return {apart.get(name, name): cell for name, cell in row.items()}


def _largest(angles: Array) -> float:
    """Return the angle (K,) of the largest magnitude, with its sign, deg; NaN if all are NaN."""
    known = angles[np.isfinite(angles)]
    return float(np.degrees(known[np.argmax(np.abs(known))])) if known.size else np.nan


def _case_table(product: AssistedTracking, values: dict[str, Array]) -> Table:
    of = FieldColumns(product, "outages", "trackers")
    passes = tuple(product.passes[p] for p in product.outage_pass)
    columns = [
        text_column("pass", of.spread(passes, "outages"), "pass"),
        of("outage_s"),
        of("trackers", "tracker"),
    ]
    for name in MEASURES:
        if np.isfinite(values[name]).any():
            cells = of.spread(values[name], "trackers", "outages")
            cells = np.where(np.isinf(cells), np.nan, cells)
            heading = _HEADINGS[name]
            columns.append(column(name + _SUFFIXES[MEASURES[name]], cells, heading, 4))
    notes = [
        f"One case. The half-width of the beam is {np.degrees(product.lock_angle_rad):g}°. Errors "
        "of the predictions, from the loss to the set, are relative to the true direction of the "
        "satellite, or to the angles that the antenna's encoders would show without noise.",
    ]
    return tabulate("Trackers after a loss of signal", columns, notes)


def _figures(product: AssistedTracking, suffix: str) -> dict[str, Chart]:
    shown = np.flatnonzero(np.bincount(product.outage_pass, minlength=len(product.passes)))
    shown = shown[:_MOST_PASSES]
    cases, passes = f"tracking{suffix}", f"tracked_passes{suffix}"
    figures: dict[str, Chart] = {}
    for page, first in enumerate(range(0, shown.size, ROWS_PER_FIGURE)):
        chosen = shown[first : first + ROWS_PER_FIGURE]
        figures["tracking_errors" + (f"_{page + 1}" if page else "")] = error_chart(
            product, chosen, _of(product, chosen, shown.size), cases
        )
    knowing = np.flatnonzero(np.isfinite(product.spread_rad).any(axis=(1, 2)))
    if knowing.size and shown.size:
        outage = int(np.flatnonzero(product.outage_pass == shown[0])[0])
        figures["tracking_spread"] = spread_chart(product, outage, knowing, cases)
    for page, first in enumerate(range(0, shown.size, SKIES_PER_FIGURE)):
        chosen = shown[first : first + SKIES_PER_FIGURE]
        figures["tracking_sky" + (f"_{page + 1}" if page else "")] = sky_chart(
            product, chosen, _of(product, chosen, shown.size), passes
        )
    return figures


def _of(product: AssistedTracking, chosen: Integers, count: int) -> str:
    """Return the names of a figure's passes for its title, ``""`` if it shows all passes."""
    if chosen.size == count:
        return ""
    return ": " + ", ".join(product.passes[int(p)] for p in chosen)


def _verdict(product: AssistedTracking, values: dict[str, Array]) -> list[str]:
    outages = product.outage_s.size
    inside = np.sum(values["encoder_error_max"] <= product.lock_angle_rad, axis=1)
    kept = ", ".join(f"{name} in {n}" for name, n in zip(product.trackers, inside, strict=True))
    said = [
        f"{product.satellite}: {len(product.passes)} passes with {outages} outages in one case. "
        "Outages in which the prediction stays within the beam "
        f"({np.degrees(product.lock_angle_rad):g}°, at the encoders) until the set: {kept}, of "
        f"{outages}."
    ]
    if len(product.passes) > _MOST_PASSES:
        said.append(f"The figures show {_MOST_PASSES} passes at most.")
    return [*said, *product.warnings]
