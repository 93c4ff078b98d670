"""Tables of the refinement of an asteroid's orbit: errors, gains, consistency."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hillsphere.base.constants import AU_M, DAY_S
from hillsphere.interfaces import Array
from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.orbit_refinement.figures import (
    draw_consistency,
    draw_optical,
    draw_tracked,
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
_NOTE = (
    "rms: root mean square over the random cases; σ: the same of what the filter says. Gains are "
    "ratios of rms errors before tracking and after; 5 % and 95 %: of the same ratio of cases "
    "drawn anew from these (bootstrap)."
)


def present_refinement(product: OrbitRefinement, spec: OrbitRefinementSpec) -> Presentation:
    """Show how well the orbit is known.

    Parameters
    ----------
    product : OrbitRefinement
        Of the stage.
    spec : OrbitRefinementSpec
        Says when it is reported.

    Returns
    -------
    Presentation
        Tables after the optical part and during tracking, a comparison of the arms, figures over
        time, and the paper's claims answered in the verdict.
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
        "refinement_optical": Figure(
            "The asteroid's orbit by angles from the Earth",
            lambda figure: draw_optical(figure, product),
            "Errors of position and velocity while it is observed: medians of the cases of each "
            "geometry (solid) and the standard deviation of the fit (dashed).",
            size_in=(8.0, 6.4),
        ),
        "refinement_tracking": Figure(
            "The asteroid's orbit with spacecraft near it",
            lambda figure: draw_tracked(figure, product),
            "For the geometries nearest to the Earth and farthest from it: rms error of the cases "
            "(thin) and standard deviation (thick). Dotted: the standard deviation of the velocity "
            "of the worst known spacecraft. Shaded: less than all of the first set's sensors "
            "measure.",
            size_in=(9.0, 6.6),
        ),
        "refinement_consistency": Figure(
            "Consistency of the asteroid's state",
            lambda figure: draw_consistency(figure, product),
            "Mean normalised error squared of the asteroid's six states over all cases, with the "
            "band that holds 99.9 % of such means of a consistent filter.",
            size_in=(8.0, 3.8),
        ),
    }
    return Presentation(metrics, tables, figures, verdict=refinement_verdict(product, spec))


def _state(known: Knowledge, k: int, g: int) -> dict[str, Cell]:
    """Return the columns that say what is known at one time in one geometry."""
    return {
        "position_rms_km": float(rms(known.position_m[k, g])) / 1e3,
        "position_sigma_km": float(rms(known.position_sigma_m[k, g])) / 1e3,
        "position_median_km": float(np.median(known.position_m[k, g])) / 1e3,
        "position_p95_km": float(np.percentile(known.position_m[k, g], 95)) / 1e3,
        "velocity_rms_m_s": float(rms(known.velocity_m_s[k, g])),
        "velocity_sigma_m_s": float(rms(known.velocity_sigma_m_s[k, g])),
        "mean_nees": float(np.mean(known.nees[k, g])),
    }


_STATE = [
    Column("position_rms_km", "km", "position, rms", 4),
    Column("position_sigma_km", "km", "σ", 4),
    Column("position_median_km", "km", "median", 4),
    Column("position_p95_km", "km", "95 %", 4),
    Column("velocity_rms_m_s", "m/s", "velocity, rms", 4),
    Column("velocity_sigma_m_s", "m/s", "σ", 4),
    Column("mean_nees", "-", "mean NEES (6)", 4),
]


def _optical_table(product: OrbitRefinement) -> Table:
    rows: list[Mapping[str, Cell]] = []
    for g, name in enumerate(product.geometries):
        cases = product.settled[g]
        rows.append(
            {
                "geometry": name,
                "state": _format_convergence(cases)
                if g in geometries_with_observations(product)
                else "not observed",
                "earth_au": float(product.earth_distance_m[g]) / AU_M,
                "observations": float(product.optical.rows[:, g].mean()),
                **_state(product.optical, -1, g),
                "settled": float(product.settled[g].mean()),
            }
        )
    columns = [
        Column("geometry", "", "geometry"),
        Column("state", "", "state"),
        Column("earth_au", "au", "least distance of the Earth", 3),
        Column("observations", "-", "values a time, mean", 3),
        *_STATE,
        Column("settled", "-", "converged", 3),
    ]
    return Table("What telescopes tell of the asteroid", columns, rows, [_NOTE, _band(product, 1)])


def _tracking_table(product: OrbitRefinement, spec: OrbitRefinementSpec) -> Table:
    rows: list[Mapping[str, Cell]] = []
    for g, name in enumerate(product.geometries):
        for a, arm in enumerate(product.arms):
            known = product.tracked[a]
            cases = product.tracked_settled[a, g]
            state = (
                _format_convergence(cases)
                if g in geometries_with_tracking(product, a)
                else "diverged"
            )
            for since, k in report_times(spec, known):
                position, velocity = gains(product, a, k)
                ranges = gain_ranges(product, a, k)
                rows.append(
                    {
                        "geometry": name,
                        "arm": arm,
                        "state": state,
                        "after_d": since / DAY_S,
                        **_state(known, k, g),
                        "position_gain": float(position[g]),
                        "position_gain_p5": float(ranges[0][0][g]),
                        "position_gain_p95": float(ranges[0][1][g]),
                        "velocity_gain": float(velocity[g]),
                        "velocity_gain_p5": float(ranges[1][0][g]),
                        "velocity_gain_p95": float(ranges[1][1][g]),
                    }
                )
    columns = [
        Column("geometry", "", "geometry"),
        Column("arm", "", "sensors"),
        Column("state", "", "state"),
        Column("after_d", "d", "after", 3),
        *_STATE,
        *(
            Column(f"{what}_gain{end}", "-", f"gain of {what}{text}", 3)
            for what in ("position", "velocity")
            for end, text in (("", ""), ("_p5", ", 5 %"), ("_p95", ", 95 %"))
        ),
    ]
    return Table("With spacecraft near it", columns, rows, [_NOTE, _band(product, 1)])


def _arms_table(product: OrbitRefinement) -> Table:
    rows: list[Mapping[str, Cell]] = []
    first = product.tracked[0]
    for a, arm in enumerate(product.arms):
        some = geometries_with_tracking(product, a)
        both = np.intersect1d(some, geometries_with_tracking(product, 0))
        position, velocity = (gain[some] for gain in gains(product, a))
        ratios = [
            rms(own[-1])[both] / rms(of_first[-1])[both]
            for own, of_first in (
                (product.tracked[a].position_sigma_m, first.position_sigma_m),
                (product.tracked[a].velocity_sigma_m_s, first.velocity_sigma_m_s),
            )
        ]
        rows.append(
            {
                "arm": arm,
                "position_gain_median": _measure_or_nan(np.median, position),
                "position_gain_least": _measure_or_nan(np.min, position),
                "position_gain_greatest": _measure_or_nan(np.max, position),
                "velocity_gain_median": _measure_or_nan(np.median, velocity),
                "velocity_gain_least": _measure_or_nan(np.min, velocity),
                "velocity_gain_greatest": _measure_or_nan(np.max, velocity),
                "position_of_first": _measure_or_nan(np.median, ratios[0]),
                "velocity_of_first": _measure_or_nan(np.median, ratios[1]),
                "joint_nees": _mean(product.joint_nees[a][some]),
                "judged": judge_consistency(product, a),
                "settled": float(product.tracked_settled[a].mean()),
            }
        )
    columns = [
        Column("arm", "", "sensors"),
        *(
            Column(f"{what}_gain_{which}", "-", f"gain of {what}, {which}", 3)
            for what in ("position", "velocity")
            for which in ("median", "least", "greatest")
        ),
        Column("position_of_first", "-", "σ of position over the first set's, median", 3),
        Column("velocity_of_first", "-", "σ of velocity over the first set's, median", 3),
        Column("joint_nees", "-", f"mean NEES ({product.states})", 4),
        Column("judged", "", "errors against σ"),
        Column("settled", "-", "converged", 3),
    ]
    cases = product.joint_nees[0].size
    low, high = chi_square_band(product.states, cases)
    note = (
        "At the end of tracking, over geometries in which it did not diverge. The mean NEES of all "
        f"{product.states} states of a consistent filter lies within {low:.3g} … {high:.3g} "
        "(99.9 %)."
    )
    return Table("Sets of sensors compared", columns, rows, [note])


def _format_convergence(cases: Array) -> str:
    """Return in how many cases of a geometry a fit has converged, in words."""
    count = int((cases > 0.0).sum())
    return "converged" if count == cases.size else f"converged in {count} of {cases.size}"


def _measure_or_nan(measure: Callable[[Array], Any], values: Array) -> float:
    """Return a measure of some values, NaN of none."""
    return float(measure(values)) if values.size else float("nan")


def _mean(values: Array) -> float:
    return _measure_or_nan(np.mean, values)


def _band(product: OrbitRefinement, geometries: int) -> str:
    low, high = chi_square_band(_ASTEROID, product.settled.shape[1] * geometries)
    return (
        f"The mean NEES over the cases of a geometry lies within {low:.3g} … {high:.3g} (99.9 %) "
        "if errors are as large as is said."
    )
