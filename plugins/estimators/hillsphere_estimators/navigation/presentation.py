"""Tables, figures and sentences of the stage ``navigation``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.figures import draw_control, draw_errors, draw_nees
from hillsphere_estimators.navigation.products import NavigationFlight
from hillsphere_estimators.navigation.specs import NavigationSpec

__all__ = ["present_navigation"]

_COLUMNS = [
    Column("spacecraft", "", "spacecraft"),
    Column("median_m", "m", "median error", 4),
    Column("low_m", "m", "5 %", 4),
    Column("high_m", "m", "95 %", 4),
    Column("rms_m", "m", "rms", 4),
    Column("believed_m", "m", "rms believed", 4),
    Column("bound_m", "m", "bound", 4),
    Column("velocity_mm_s", "mm/s", "median velocity error", 4),
    Column("control_m", "m", "median distance from the reference", 4),
]


def present_navigation(product: NavigationFlight, spec: NavigationSpec) -> Presentation:
    """Show the flights.

    Parameters
    ----------
    product : NavigationFlight
        What is shown.
    spec : NavigationSpec
        What was asked for.

    Returns
    -------
    Presentation
        Table ``navigation``, figures ``navigation_errors``, ``navigation_control``,
        ``navigation_nees``.
    """

    def named(name: str) -> str:
        return f"{name}_{spec.label}" if spec.label else name

    n, count = len(product.states), product.nees.shape[1]
    low, high = chi_square_band(n, count)
    mean = float(np.nanmean(product.nees[-1])) if product.lost < count else np.nan
    inside = bool(low <= mean <= high)
    rows: list[Mapping[str, Cell]] = []
    for i, name in enumerate(product.spacecraft):
        error = product.position_error_m[i, -1]
        speed = product.velocity_error_m_s[i, -1]
        shares = np.nanquantile(error, [0.05, 0.5, 0.95]) if product.lost < count else [np.nan] * 3
        rows.append(
            {
                "spacecraft": name,
                "median_m": float(shares[1]),
                "low_m": float(shares[0]),
                "high_m": float(shares[2]),
                "rms_m": _rms(error),
                "believed_m": _rms(product.position_sigma_m[i, -1]),
                "bound_m": float(product.bound_m[i, -1]),
                "velocity_mm_s": 1e3 * _median(speed),
                "control_m": _median(product.control_error_m[i, -1]),
            }
        )
    hours = product.time_s[-1] / 3600.0
    called = f" ({spec.label.replace('_', ' ')})" if spec.label else ""
    notes = [
        f"{count} flights of different draws, after {hours:g} h and {len(product.time_s)} sets of "
        "measurements; errors are lengths of vectors.",
        "The bound is the posterior Cramér-Rao bound along the planned flight"
        + ("." if product.matched else ", for the world as the filter believes it to be."),
    ]
    verdict = []
    if product.lost:
        verdict.append(
            f"Navigation{called}: {product.lost} of {count} flights did not come to their end."
        )
    if not inside:
        verdict.append(
            f"Navigation{called}: the filter is not consistent; its mean NEES over {count} flights "
            f"is {mean:.4g}, the 99.9 % band for {n} states {low:.3g} to {high:.3g}."
        )
    return Presentation(
        metrics={
            named("navigation_nees"): Metric(mean),
            named("navigation_consistent"): Metric(inside),
            named("navigation_lost"): Metric(product.lost),
        },
        tables={
            named("navigation"): Table(f"Errors of the estimates{called}", _COLUMNS, rows, notes)
        },
        figures={
            named("navigation_errors"): Figure(
                f"Errors of the estimated positions{called}",
                lambda figure: draw_errors(figure, product),
                "Thick: the first flight; dashed: three standard deviations as its filter believes "
                "them; band: 5 to 95 % of all flights; dotted: the Cramér-Rao bound of the rms.",
                (7.5, 2.4 + 2.0 * len(product.spacecraft)),
            ),
            named("navigation_control"): Figure(
                f"Distance from the reference{called}",
                lambda figure: draw_control(figure, product),
                "Of the first flight, at its measurements: as it is, and as the filter believes.",
            ),
            named("navigation_nees"): Figure(
                f"Normalised errors squared{called}",
                lambda figure: draw_nees(figure, product),
                f"Mean over {count} flights; grey: where 99.9 % of such means of a consistent "
                "filter lie.",
            ),
        },
        verdict=verdict,
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else float("nan")


def _median(values: np.ndarray) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
