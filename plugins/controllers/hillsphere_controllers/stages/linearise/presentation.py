"""Presentation of linear models along a trajectory: poles, disturbances, parameters."""

from __future__ import annotations

from functools import partial

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.stages.linearise.figures import (
    draw_influence,
    draw_poles,
    unstable_poles,
)
from hillsphere_controllers.stages.linearise.products import LinearisedFlight

__all__ = ["nominal_models", "present_linearisation", "ranks"]


def present_linearisation(product: LinearisedFlight) -> Presentation:
    """Return tables, figures and sentences of linear models along a trajectory."""
    nominal = nominal_models(product)
    tables = {"linearised_points": _points(product, nominal)}
    figures = {
        "linearised_poles": Figure(
            f"Poles along {product.flight}",
            partial(draw_poles, product=product, nominal=nominal),
            "Real and imaginary parts of the eigenvalues of A at the points, all parameters "
            "nominal; below, the standard deviation of the unknown acceleration.",
        )
    }
    abscissa = max(spectral_abscissa(product.systems[k]) for k in nominal)
    metrics = {
        "linearised_models": Metric(len(product.systems)),
        "linearised_abscissa": Metric(abscissa, "1/s"),
    }
    said: list[str] = []
    if product.dispersed:
        tables["linearised_influence"] = _influence(product)
        figures["linearised_influence"] = Figure(
            f"What one standard deviation of each parameter does to {product.flight}",
            partial(draw_influence, product=product, order=_order(product)),
            "Change of A relative to A, of the acceleration at most along the trajectory, of the "
            "place where the flight ends under its own command; share in the changes of A.",
        )
        metrics["linearised_disturbance"] = Metric(1e3 * float(_deviation(product).max()), "mm/s²")
        bent = [name for name, ok in zip(product.dispersed, product.affine, strict=True) if not ok]
        said.append(
            f"The derivatives are affine in all {len(product.dispersed)} dispersed parameters."
            if not bent
            else f"The derivatives are not affine in {', '.join(bent)}: "
            "fit polynomials in the stage lft."
        )
    return Presentation(metrics, tables, figures, said)


def nominal_models(product: LinearisedFlight) -> Integers:
    """Return which models (N,) have all parameters nominal."""
    away = product.values[1:] != product.nominal[1:, None]
    return np.flatnonzero(~away.any(axis=0))


def ranks(values: Array) -> Integers:
    """Return ranks (q,), 1 for the largest."""
    made = np.empty(values.size, dtype=np.int64)
    made[np.argsort(-np.nan_to_num(values, nan=np.inf), kind="stable")] = np.arange(
        1, values.size + 1
    )
    return made


def _order(product: LinearisedFlight) -> Integers:
    """Return the parameters from the most to the least influential by all criteria together."""
    together = sum(ranks(values) for values in _criteria(product))
    return np.argsort(together, kind="stable")


def _criteria(product: LinearisedFlight) -> tuple[Array, ...]:
    return (
        product.jacobian_share.max(axis=1),
        product.largest_acceleration,
        product.end_deviation_m,
        product.fit_weight,
    )


def _deviation(product: LinearisedFlight) -> Array:
    """Return the standard deviation of the unknown acceleration (N,), root of the trace."""
    return np.asarray(np.sqrt(np.trace(product.acceleration_covariance)))


def _points(product: LinearisedFlight, nominal: Integers) -> Table:
    unknown, rows = _deviation(product), list[dict[str, Cell]]()
    for i, k in enumerate(nominal):
        poles = product.systems[int(k)].poles
        largest = float(poles.real.max())
        rows.append(
            {
                "point": i + 1,
                "time_s": float(product.t_s[i]),
                "abscissa_1_s": largest,
                "growth_s": 1.0 / largest if largest > 0.0 else None,
                "unstable_poles": int(unstable_poles(product.systems[int(k)]).sum()),
                "fastest_pole_rad_s": float(np.abs(poles).max()),
                "command_mm_s2": 1e3 * float(np.linalg.norm(product.u[:, i])),
                "unknown_mm_s2": 1e3 * float(unknown[i]),
            }
        )
    columns = (
        Column("point", "-", "point"),
        Column("time_s", "s", "time", 6),
        Column("abscissa_1_s", "1/s", "largest real part of the poles", 6),
        Column("growth_s", "s", "time in which a deviation grows by e", 6),
        Column("unstable_poles", "-", "unstable poles"),
        Column("fastest_pole_rad_s", "rad/s", "largest pole", 6),
        Column("command_mm_s2", "mm/s²", "command", 5),
        Column("unknown_mm_s2", "mm/s²", "unknown acceleration, one σ", 4),
    )
    notes = ["All parameters nominal; the unknown acceleration is the root of the trace of its "
             "covariance."]  # fmt: skip
    return Table(f"Points along {product.flight}", columns, rows, notes)


def _influence(product: LinearisedFlight) -> Table:
    criteria = _criteria(product)
    places = [ranks(values) for values in criteria]
    rows: list[dict[str, Cell]] = []
    for k in _order(product):
        share, acceleration, end, weight = (float(values[k]) for values in criteria)
        rows.append(
            {
                "parameter": product.dispersed[k],
                "sigma": float(product.sigma[k]),
                "affine": bool(product.affine[k]),
                "jacobian": share,
                "jacobian_rank": int(places[0][k]),
                "acceleration_mm_s2": 1e3 * acceleration,
                "acceleration_rank": int(places[1][k]),
                "end_m": end if np.isfinite(end) else None,
                "end_rank": int(places[2][k]),
                "weight": weight,
                "weight_rank": int(places[3][k]),
            }
        )
    columns = (
        Column("parameter", "", "parameter"),
        Column("sigma", "-", "standard deviation, SI", 4),
        Column("affine", "", "affine"),
        Column("jacobian", "-", "largest change of A, relative", 3),
        Column("jacobian_rank", "-", "rank"),
        Column("acceleration_mm_s2", "mm/s²", "largest change of the acceleration", 3),
        Column("acceleration_rank", "-", "rank"),
        Column("end_m", "m", "change of the end of the flight", 4),
        Column("end_rank", "-", "rank"),
        Column("weight", "-", "share in the changes of A", 3),
        Column("weight_rank", "-", "rank"),
    )
    notes = [
        "Effects of one standard deviation of each parameter, sorted by the sum of the ranks. The "
        "end of the flight is the one under the trajectory's own command."
    ]
    return Table("Influence of the parameters", columns, rows, notes)
