"""Tables, figures and verdict of the stage ``navigation``."""

from __future__ import annotations

from collections import Counter

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import Metric, Presentation
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.divergence import (
    DIVERGED_WITH_ALARM,
    DIVERGED_WITHOUT_ALARM,
    detect_divergence,
)
from hillsphere_estimators.navigation.figures import control_chart, error_chart, nees_chart
from hillsphere_estimators.navigation.metrics import ratio_to_bound
from hillsphere_estimators.navigation.products import NavigationFlight
from hillsphere_estimators.navigation.specs import NavigationSpec

__all__ = ["judge_consistency", "present_navigation"]

MOST_OVER_BOUND = 1.2
"""Ratio of an rms error to its bound above which the verdict reports it: 64 flights determine the
ratio to about 0.05, and a filter near its bound stays below this."""


def judge_consistency(
    mean: float, states: int, flights: int, lost: int
) -> tuple[str, float, float]:
    """Return the verdict on a filter by its mean NEES, and the band of this mean.

    Parameters
    ----------
    mean : float
        Over the flights that were not lost.
    states, flights, lost : int
        Numbers of states, of all flights, and of those that were lost.

    Returns
    -------
    answer : str
        ``consistent``, ``overconfident`` (the mean is above the band), ``cautious`` (below), or
        ``lost`` if any flight was lost: a mean over the survivors proves nothing.
    low, high : float
        Band in which 99.9 % of such means lie for a consistent filter.
    """
    low, high = map(float, chi_square_band(states, max(flights - lost, 1)))
    if lost:
        return "lost", low, high
    answer = "overconfident" if mean > high else "cautious" if mean < low else "consistent"
    return answer, low, high


def present_navigation(product: NavigationFlight, spec: NavigationSpec) -> Presentation:
    """Show the flights.

    Parameters
    ----------
    product : NavigationFlight
        The flights.
    spec : NavigationSpec
        Its label and limits.

    Returns
    -------
    Presentation
        Tables ``navigation`` and ``navigation_sensors``, figures ``navigation_errors``,
        ``navigation_control``, ``navigation_nees``.
    """

    def named(name: str) -> str:
        return f"{name}_{spec.label}" if spec.label else name

    n, count = len(product.states), product.nees.shape[1]
    diverged = (
        product.endings.count(DIVERGED_WITH_ALARM),
        product.endings.count(DIVERGED_WITHOUT_ALARM),
    )
    alarms = detect_divergence(product.nis, product.used, product.sent, spec.diverged_beyond)
    mean = float(np.nanmean(product.nees[-1])) if product.lost < count else np.nan
    answer, low, high = judge_consistency(mean, n, count, product.lost)
    ratios = [
        ratio_to_bound(product.position_error_m[i, -1], product.bounds_m[i, -1])
        for i in range(len(product.spacecraft))
    ]
    hours = product.time_s[-1] / 3600.0
    called = f" ({spec.label.replace('_', ' ')})" if spec.label else ""
    dv = _median(product.values[product.metrics.index("dv")])
    unknown = _unknown_to_the_bound(product, spec)
    notes = [
        f"{count} flights with different random numbers, after {hours:g} h and "
        f"{len(product.time_s)} sets of measurements. Errors are lengths of vectors.",
        "The bound is the root mean square of the posterior Cramér-Rao bounds of the flights, each "
        "along its planned path"
        + (f"; it does not account for {unknown}." if unknown else "."),
    ]  # fmt: skip
    if spec.law is not None:
        notes.append(
            f"The law's commands have a median Δv of {dv:.4g} m/s ({dv / hours * 24.0:.4g} m/s per "
            "day), summed over the spacecraft. Random accelerations are not counted."
        )
    blind = np.sum(product.seen == 0.0, axis=1)
    return Presentation(
        metrics={
            named("navigation_nees"): Metric(mean),
            named("navigation_consistent"): Metric(answer == "consistent" and not sum(diverged)),
            named("navigation_lost"): Metric(product.lost),
            named("navigation_diverged"): Metric(sum(diverged)),
            named("navigation_alarms"): Metric(int(alarms.sum())),
            named("navigation_bound_ratio"): Metric(float(max(r for r, _ in ratios))),
            named("navigation_dv"): Metric(dv, "m/s"),
        },
        tables={
            named("navigation"): tabulate(
                f"Errors of the estimates{called}", _error_columns(product, ratios), notes
            ),
            named("navigation_sensors"): tabulate(
                f"Availability of the sensors{called}", _sensor_columns(product, blind)
            ),
        },
        figures={
            named("navigation_errors"): error_chart(product, called, named("navigation")),
            named("navigation_control"): control_chart(product, called, named("navigation")),
            named("navigation_nees"): nees_chart(product, called),
        },
        verdict=[
            *_verdict(product, called, (answer, mean, low, high), ratios, blind, unknown),
            *_describe_divergence(diverged, int(alarms.sum()), count, called),
        ],
    )


def _error_columns(
    product: NavigationFlight, ratios: list[tuple[float, float]]
) -> list[FilledColumn]:
    """Return the columns of the errors at the end, one row per spacecraft."""
    of = FieldColumns(product, "spacecraft")
    errors = product.position_error_m[:, -1]
    low, median, high = np.transpose([_quantiles(error) for error in errors])
    return [
        of("spacecraft"),
        column("median_m", median, "median error", 4),
        column("low_m", low, "5 %", 4),
        column("high_m", high, "95 %", 4),
        column("rms_m", [_rms(error) for error in errors], "rms", 4),
        column("believed_m", [_rms(s) for s in product.position_sigma_m[:, -1]], "rms believed", 4),
        column("bound_m", product.bound_m[:, -1], "bound", 4),
        column("ratio", [ratio for ratio, _ in ratios], "rms over bound", 4),
        column("ratio_se", [error for _, error in ratios], "its standard error", 2),
        column("velocity_mm_s", [_median(error) for error in product.velocity_error_m_s[:, -1]],
               "median velocity error", 4),
        column("control_m", [_median(error) for error in product.control_error_m[:, -1]],
               "median distance from the reference", 4),
    ]  # fmt: skip


def _sensor_columns(product: NavigationFlight, blind: Integers) -> list[FilledColumn]:
    """Return the columns of the sensors' availability, one row per sensor."""
    of = FieldColumns(product, "sensors")
    shares = [float(np.nanmean(s)) if np.isfinite(s).any() else np.nan for s in product.seen]
    return [
        of("sensors", "sensor"),
        column("seen", shares, "share of the times at which it measures", 4),
        column("blind", blind, "flights in which it never does"),
    ]


def _quantiles(error: Array) -> list[float]:
    """Return the 5 %, 50 % and 95 % quantiles over the flights that were not lost; NaN of none."""
    if not np.isfinite(error).any():
        return [np.nan] * 3
    low, median, high = np.nanquantile(error, [0.05, 0.5, 0.95]).tolist()
    return [low, median, high]


def _unknown_to_the_bound(product: NavigationFlight, spec: NavigationSpec) -> str:
    """Return what the bound does not account for, "" if nothing.

    With any of these it is not a bound of this filter.
    """
    left = {
        "the differences between the true and the believed world": not product.matched,
        "dropouts": spec.dropouts > 0.0,
        "outliers": spec.outliers > 0.0,
        "biases": bool(spec.biases),
        "the law's use of uncorrected estimates while all sensors are silent": any(
            not out.sensors or set(out.sensors) >= set(product.sensors) for out in spec.outages
        ),
        "the information that covariance intersection loses": bool(spec.members),
    }
    return ", ".join(name for name, there in left.items() if there)


def _verdict(
    product: NavigationFlight, called: str, judgement: tuple[str, float, float, float],
    ratios: list[tuple[float, float]], blind: Integers, unknown: str,
) -> list[str]:  # fmt: skip
    """Return the sentences on losses, consistency, sensors and the bound; none if all is well."""
    answer, mean, low, high = judgement
    n, count = len(product.states), product.nees.shape[1]
    said = []
    if product.lost:
        said.append(
            f"Navigation{called}: {product.lost} of {count} flights were lost before their end: "
            f"{_causes(product)}."
        )
    if answer in ("overconfident", "cautious"):
        meaning = "greater" if answer == "overconfident" else "smaller"
        said.append(
            f"Navigation{called}: mean NEES {mean:.4g} over {count} flights, outside its 99.9 % "
            f"band {low:.3g} to {high:.3g} for {n} states. The filter is {answer}: its errors are "
            f"{meaning} than its covariance states."
        )
    never = [f"{name} in {n}" for name, n in zip(product.sensors, blind, strict=True) if n]
    if never:
        said.append(
            f"Navigation{called}: some sensors never measure in a whole flight, of {count}: "
            f"{', '.join(never)}."
        )
    for name, (ratio, error) in zip(product.spacecraft, ratios, strict=True):
        if not unknown and ratio > MOST_OVER_BOUND:
            said.append(
                f"Navigation{called}: the rms position error of {name} is {ratio:.3g} ± "
                f"{error:.2g} times its bound (limit {MOST_OVER_BOUND:g})."
            )
    return said


def _describe_divergence(
    diverged: tuple[int, int], alarms: int, count: int, called: str
) -> list[str]:
    """Return sentences on diverged filters and on false alarms."""
    said = []
    seen, silent = diverged
    if seen + silent:
        said.append(
            f"Navigation{called}: the filters of {seen + silent} of {count} flights have diverged; "
            f"the innovations show it in {seen} of them."
        )
    if alarms > seen:
        said.append(
            f"Navigation{called}: the innovations of {alarms - seen} of {count} flights raise an "
            "alarm although the filter has not diverged: the sensors differ from their model."
        )
    return said


def _causes(product: NavigationFlight) -> str:
    """Return the numbers of flights by cause of their loss."""
    others = ("completed", DIVERGED_WITH_ALARM, DIVERGED_WITHOUT_ALARM)
    causes = Counter(ending for ending in product.endings if ending not in others)
    return ", ".join(f"{count} {cause}" for cause, count in causes.most_common())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else float("nan")


def _median(values: Array) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
