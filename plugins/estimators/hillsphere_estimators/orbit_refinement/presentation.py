"""Tables, figures and metrics of the refinement of an asteroid's orbit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.orbit_refinement.figures import (
    consistency_chart,
    optical_chart,
    tracking_chart,
)
from hillsphere_estimators.orbit_refinement.gains import (
    gain_ranges,
    gains,
    geometries_with_observations,
    geometries_with_tracking,
    report_times,
    rms,
)
from hillsphere_estimators.orbit_refinement.products import Knowledge, OrbitRefinement
from hillsphere_estimators.orbit_refinement.specs import OrbitRefinementSpec
from hillsphere_estimators.orbit_refinement.verdict import judge_consistency, refinement_verdict

__all__ = ["present_refinement"]

_ASTEROID = 6
"""States of the asteroid, three positions and three velocities: degrees of freedom of its NEES."""
_GAIN_CONFIDENCE = 0.9
"""Confidence of an interval from the 5 % to the 95 % quantile of bootstrap samples."""
_NOTE = (
    "rms: root mean square error over the random cases; σ: root mean square of the filter's "
    "standard deviations. Gains are rms errors before tracking over those after it, with 5 % and "
    "95 % quantiles by bootstrap over the cases."
)


def present_refinement(product: OrbitRefinement, spec: OrbitRefinementSpec) -> Presentation:
    """Show how well the orbit is known.

    Parameters
    ----------
    product : OrbitRefinement
        Product of the stage.
    spec : OrbitRefinementSpec
        Reported times.

    Returns
    -------
    Presentation
        Tables after the optical part and during tracking, a comparison of the arms, figures over
        time, and sentences on gains and consistency.
    """
    tables = {
        "refinement_optical": _optical_table(product),
        "refinement_tracking": _tracking_table(product, spec),
        "refinement_arms": _arms_table(product),
    }
    first = geometries_with_tracking(product, 0)
    position, velocity = (gain[first] for gain in gains(product, 0))
    means = [
        _mean(nees[geometries_with_tracking(product, a)])
        for a, nees in enumerate(product.joint_nees)
    ]
    metrics = {
        "refinement_position_gain_median": Metric(_measure_or_nan(np.median, position)),
        "refinement_velocity_gain_median": Metric(_measure_or_nan(np.median, velocity)),
        "refinement_mean_nees": Metric(means[0]),
        "refinement_mean_nees_greatest": Metric(max(means)),
        "refinement_settled": Metric(float(np.mean(product.settled))),
        "refinement_tracking_settled": Metric(float(np.mean(product.tracked_settled))),
    }
    figures = {
        "refinement_optical": optical_chart(product),
        "refinement_tracking": tracking_chart(product),
        "refinement_consistency": consistency_chart(product),
    }
    return Presentation(metrics, tables, figures, verdict=refinement_verdict(product, spec))


def _error_columns(at: Sequence[tuple[Knowledge, int, int]]) -> list[FilledColumn]:
    """Return the columns of errors and standard deviations, a row per (part, time, geometry).

    All are statistics over the random cases of the geometry.
    """
    position = [known.position_m[k, g] for known, k, g in at]
    velocity = [known.velocity_m_s[k, g] for known, k, g in at]
    sigmas = [(known.position_sigma_m[k, g], known.velocity_sigma_m_s[k, g]) for known, k, g in at]
    return [
        column("position_rms_km", [float(rms(e)) for e in position], "position, rms", 4),
        column("position_sigma_km", [float(rms(s)) for s, _ in sigmas], "σ", 4),
        column("position_median_km", [float(np.median(e)) for e in position], "median", 4),
        column("position_p95_km", [float(np.percentile(e, 95)) for e in position], "95 %", 4),
        column("velocity_rms_m_s", [float(rms(e)) for e in velocity], "velocity, rms", 4),
        column("velocity_sigma_m_s", [float(rms(s)) for _, s in sigmas], "σ", 4),
        column("mean_nees", [float(np.mean(known.nees[k, g])) for known, k, g in at],
               "mean NEES (6)", 4),
    ]  # fmt: skip


def _optical_table(product: OrbitRefinement) -> Table:
    of = FieldColumns(product, "geometries")
    count = len(product.geometries)
    observed = geometries_with_observations(product)
    states = [
        _format_convergence(product.settled[g]) if g in observed else "not observed"
        for g in range(count)
    ]
    columns = [
        of("geometries", "geometry"),
        text_column("state", states, "state"),
        of("earth_distance_m", "earth_au"),
        column("observations", [rows.mean() for rows in product.optical.rows.T],
               "mean values per time", 3),
        *_error_columns([(product.optical, -1, g) for g in range(count)]),
        column("settled", [cases.mean() for cases in product.settled], "converged", 3),
    ]  # fmt: skip
    notes = [_NOTE, _band(product, 1)]
    return tabulate("Orbit of the asteroid by telescopes", columns, notes)


def _tracking_table(product: OrbitRefinement, spec: OrbitRefinementSpec) -> Table:
    # a row for each geometry, arm and reported time (since the beginning, s, and its index)
    rows = [
        (g, a, since, k)
        for g in range(len(product.geometries))
        for a, known in enumerate(product.tracked)
        for since, k in report_times(spec, known)
    ]
    arms = range(len(product.arms))
    tracked = [geometries_with_tracking(product, a) for a in arms]
    states = [
        _format_convergence(product.tracked_settled[a, g]) if g in tracked[a] else "diverged"
        for g, a, _, _ in rows
    ]
    parts = {(a, k) for _, a, _, k in rows}
    every = {(a, k): gains(product, a, k) for a, k in parts}
    ranges = {(a, k): gain_ranges(product, a, k) for a, k in parts}
    columns = [
        text_column("geometry", [product.geometries[g] for g, *_ in rows], "geometry"),
        text_column("arm", [product.arms[a] for _, a, *_ in rows], "sensors"),
        text_column("state", states, "state"),
        column("after_d", [since for _, _, since, _ in rows], "after", 3),
        *_error_columns([(product.tracked[a], k, g) for g, a, _, k in rows]),
    ]
    for i, of in enumerate(("position", "velocity")):
        gain = [every[a, k][i][g] for g, a, _, k in rows]
        ends = np.reshape([ranges[a, k][i][:, g] for g, a, _, k in rows], (-1, 2)).T
        columns += [
            column(f"{of}_gain", gain, f"gain of {of}", 3,
                   interval=(f"{of}_gain_p5", f"{of}_gain_p95"), confidence=_GAIN_CONFIDENCE),
            column(f"{of}_gain_p5", ends[0], f"gain of {of}, 5 %", 3),
            column(f"{of}_gain_p95", ends[1], f"gain of {of}, 95 %", 3),
        ]  # fmt: skip
    return tabulate(
        "Orbit of the asteroid with spacecraft near it", columns, [_NOTE, _band(product, 1)]
    )


def _arms_table(product: OrbitRefinement) -> Table:
    arms = range(len(product.arms))
    tracked = [geometries_with_tracking(product, a) for a in arms]
    columns = [FieldColumns(product, "arms")("arms", "arm")]
    for i, of in enumerate(("position", "velocity")):
        gain = [gains(product, a)[i][tracked[a]] for a in arms]
        for which, measure in (("median", np.median), ("least", np.min), ("greatest", np.max)):
            columns.append(
                column(f"{of}_gain_{which}", [_measure_or_nan(measure, one) for one in gain],
                       f"gain of {of}, {which}", 3)
            )  # fmt: skip
    for of in ("position", "velocity"):
        # standard deviations at the end over those of the first arm, geometry by geometry
        sigmas = [rms(known.position_sigma_m[-1] if of == "position"
                      else known.velocity_sigma_m_s[-1]) for known in product.tracked]  # fmt: skip
        both = [np.intersect1d(own, tracked[0]) for own in tracked]
        ratios = [sigma[own] / sigmas[0][own] for sigma, own in zip(sigmas, both, strict=True)]
        columns.append(
            column(f"{of}_of_first", [_measure_or_nan(np.median, one) for one in ratios],
                   f"σ of {of} over the first set's, median", 3)
        )  # fmt: skip
    columns += [
        column("joint_nees", [_mean(product.joint_nees[a][tracked[a]]) for a in arms],
               f"mean NEES ({product.states})", 4),
        text_column("judged", [judge_consistency(product, a) for a in arms], "errors against σ"),
        column("settled", [cases.mean() for cases in product.tracked_settled], "converged", 3),
    ]  # fmt: skip
    cases = product.joint_nees[0].size
    low, high = chi_square_band(product.states, cases)
    note = (
        "At the end of tracking, over geometries in which it did not diverge. The mean NEES of all "
        f"{product.states} states of a consistent filter lies within {low:.3g} … {high:.3g} "
        "(99.9 %)."
    )
    return tabulate("Sets of sensors compared", columns, [note])


def _format_convergence(cases: Array) -> str:
    """Return the number of converged cases of a geometry in words."""
    count = int((cases > 0.0).sum())
    return "converged" if count == cases.size else f"converged in {count} of {cases.size}"


def _measure_or_nan(measure: Callable[[Array], Any], values: Array) -> float:
    """Return a measure of values, NaN of none."""
    return float(measure(values)) if values.size else float("nan")


def _mean(values: Array) -> float:
    return _measure_or_nan(np.mean, values)


def _band(product: OrbitRefinement, geometries: int) -> str:
    """Return the note on the band of the mean NEES of the asteroid's states."""
    low, high = chi_square_band(_ASTEROID, product.settled.shape[1] * geometries)
    return (
        f"The mean NEES over the cases of a geometry lies within {low:.3g} to {high:.3g} (99.9 %) "
        "for a consistent filter."
    )
