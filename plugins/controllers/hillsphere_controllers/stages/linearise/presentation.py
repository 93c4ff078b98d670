"""Presentation of linear models along a trajectory: poles, disturbances, parameters."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.tables import FieldColumns, column, finite_or_blank, tabulate, text_column
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.stages.linearise.figures import (
    influence_chart,
    pole_chart,
    unstable_poles,
)
from hillsphere_controllers.stages.linearise.products import LinearisedFlight

__all__ = ["nominal_models", "present_linearisation", "ranks"]


def present_linearisation(product: LinearisedFlight) -> Presentation:
    """Return tables, figures and sentences of linear models along a trajectory."""
    nominal = nominal_models(product)
    tables = {"linearised_points": _points(product, nominal)}
    figures = {"linearised_poles": pole_chart(product, nominal, "linearised_points")}
    abscissa = max(spectral_abscissa(product.systems[k]) for k in nominal)
    metrics = {
        "linearised_models": Metric(len(product.systems)),
        "linearised_abscissa": Metric(abscissa, "1/s"),
    }
    said: list[str] = []
    if product.dispersed:
        tables["linearised_influence"] = _influence(product)
        figures["linearised_influence"] = influence_chart(
            product, _order(product), "linearised_influence"
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
    of = FieldColumns(product, "points")
    systems = [product.systems[k] for k in nominal.tolist()]
    poles = [system.poles for system in systems]
    abscissa = np.array([one.real.max() for one in poles])
    growth = np.full(abscissa.size, np.nan)
    growing = abscissa > 0.0
    growth[growing] = 1.0 / abscissa[growing]
    unstable = [int(unstable_poles(system).sum()) for system in systems]
    columns = [
        column("point", np.arange(1, len(systems) + 1), "point"),
        of("t_s", "time_s"),
        column("abscissa_1_s", abscissa, "largest real part of the poles", 6),
        column("growth_s", growth, "time in which a deviation grows by e", 6),
        column("unstable_poles", unstable, "unstable poles"),
        column("fastest_pole_rad_s", [np.abs(one).max() for one in poles], "largest pole", 6),
        column("command_mm_s2", [np.linalg.norm(u) for u in product.u.T], "command", 5),
        column("unknown_mm_s2", _deviation(product), "unknown acceleration, one σ", 4),
    ]
    notes = ["All parameters nominal; the unknown acceleration is the root of the trace of its "
             "covariance."]  # fmt: skip
    return tabulate(f"Points along {product.flight}", columns, notes)


def _influence(product: LinearisedFlight) -> Table:
    order = _order(product)
    jacobian, acceleration, end, weight = (values[order] for values in _criteria(product))
    ranked = [ranks(values)[order] for values in _criteria(product)]
    columns = [
        text_column("parameter", [product.dispersed[k] for k in order], "parameter"),
        column("sigma", product.sigma[order], "standard deviation, SI", 4),
        text_column("affine", product.affine[order], "affine"),
        column("jacobian", jacobian, "largest change of A, relative", 3),
        column("jacobian_rank", ranked[0], "rank"),
        column("acceleration_mm_s2", acceleration, "largest change of the acceleration", 3),
        column("acceleration_rank", ranked[1], "rank"),
        column("end_m", finite_or_blank(end), "change of the end of the flight", 4),
        column("end_rank", ranked[2], "rank"),
        column("weight", weight, "share in the changes of A", 3),
        column("weight_rank", ranked[3], "rank"),
    ]
    notes = [
        "Effects of one standard deviation of each parameter, sorted by the sum of the ranks. The "
        "end of the flight is the one under the trajectory's own command."
    ]
    return tabulate("Influence of the parameters", columns, notes)
