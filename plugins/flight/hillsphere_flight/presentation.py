"""Tables, figures and sentences about the nominal flight."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.cases.case_classes import UNDECIDED, what_left_it_undecided
from hillsphere.engine.flight_metrics import limit_shown
from hillsphere.presentation import Metric, Presentation
from hillsphere.show.tables import FilledColumn, column, tabulate, text_column
from hillsphere_flight.figures import (
    acceleration_chart,
    command_chart,
    error_chart,
    has_accelerations,
    path_chart,
)
from hillsphere_flight.metrics import LANDING_METRICS, METRICS
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import ClosedLoopSpec

__all__ = ["present_flight", "warnings_of"]

_BEYOND_HILL = 0.01
"""Part of the distance to the primary beyond which the neglected terms of the Hill approximation,
of that relative order, are mentioned: from 1 % on they change the third digit of a table."""

_COARSE = 1e-3
"""Ratio of the step error at the end to the largest position error above which a warning stands:
below it the step error does not change the third digit of a metric."""


def present_flight(product: ClosedLoopFlight, spec: ClosedLoopSpec) -> Presentation:
    """Show the nominal flight.

    Parameters
    ----------
    product : ClosedLoopFlight
        The nominal flight.
    spec : ClosedLoopSpec
        The parameters of the stage, with limits and requirements.

    Returns
    -------
    Presentation
        Table ``closed_loop``, figures ``closed_loop_errors``, ``closed_loop_command``, for
        positions in space ``closed_loop_path``, and for a reference with a command about a body
        with a surface ``closed_loop_accelerations``.
    """

    def named(name: str) -> str:
        return f"{name}_{spec.label}" if spec.label else name

    figures = {
        "closed_loop_errors": error_chart(product, spec),
        "closed_loop_command": command_chart(product),
    }
    if len(product.position_rows) % 3 == 0:
        figures["closed_loop_path"] = path_chart(product)
    if has_accelerations(product):
        figures["closed_loop_accelerations"] = acceleration_chart(product)
    metrics = {
        f"closed_loop_{name}": Metric(float(value), unit)
        for name, unit, value in zip(product.metrics, product.units, product.values, strict=True)
        if np.isfinite(value)
    }
    metrics["closed_loop_step_error"] = Metric(product.step_error, "-")
    metrics["closed_loop_status"] = Metric(product.status, "")
    return Presentation(
        metrics={named(name): metric for name, metric in metrics.items()},
        tables={
            named("closed_loop"): tabulate(
                "Nominal flight", _metric_columns(product, spec), _notes(product, spec)
            )
        },
        figures={named(name): figure for name, figure in figures.items()},
        verdict=_verdict(product, spec),
    )


def _metric_columns(product: ClosedLoopFlight, spec: ClosedLoopSpec) -> list[FilledColumn]:
    """Return the columns of the table of metrics, each with the limit that is set on it."""
    declared = {metric.name: metric for metric in (*METRICS, *LANDING_METRICS)}
    metrics = [declared[name] for name in product.metrics]
    values = np.where(np.isfinite(product.values), product.values, np.nan)
    return [
        text_column("metric", [metric.label for metric in metrics], "metric"),
        column("value", values, "value", 6, unit=""),
        text_column("unit", product.units, "unit"),
        column("required", [limit_shown(m, spec.require) for m in metrics], "at most", 6, unit=""),
    ]


def _notes(product: ClosedLoopFlight, spec: ClosedLoopSpec) -> list[str]:
    seen = ", ".join(product.seen_states)
    return [
        f"The law acts every {product.period_s:g} s on {seen}. Navigation and actuator errors are "
        "those of case 0 of a campaign. Largest errors and commands are taken over the whole "
        "flight, between samples too. The largest command is that of the law, before the limits of "
        "the actuator. Firings count the samples with a non-zero command (of a continuous law all "
        "samples). Early is the time from the end of the flight to its planned end."
        + _overtime(spec)
        + _inputs(spec),
        "The estimated step error is in the plant's natural units of length and velocity.",
    ]


def _overtime(spec: ClosedLoopSpec) -> str:
    if not spec.overtime_s:
        return ""
    late = spec.require.limit("late_s")
    return (
        f" A flight that has not ended with its reference goes on for at most "
        f"{spec.overtime_s:g} s, rounded up to whole periods of the law. Its reference continues "
        f"at the last velocity, with the command {spec.overtime_command}. Early is then negative"
        f"{'' if late is None else f' and must be at least −{late:g} s'}. The errors at the end "
        "refer to that continuation; the largest errors are those until the end of the reference."
    )


def _inputs(spec: ClosedLoopSpec) -> str:
    changed = ", ".join(f"{name} = {value:g}" for name, value in spec.flight_inputs.items())
    return f" Inputs that differ from nominal: {changed}." if changed else ""


def _verdict(product: ClosedLoopFlight, spec: ClosedLoopSpec) -> list[str]:
    ended = product.end_s
    # A flight that ended where it began saw no sample.
    begun = float(np.fmin(product.time_s[0], ended))
    how = product.status + (f" ({product.cause.replace('_', ' ')})" if product.cause else "")
    counted = f" (from {spec.errors_from_s / 60.0:g} min on)" if spec.errors_from_s else ""
    values = dict(zip(product.metrics, product.values.tolist(), strict=True))
    sentences = [
        f"{'Flight' if spec.flight_inputs else 'Nominal flight'}"
        f"{f' ({spec.label})' if spec.label else ''}: {_judgement(product)}, {how} after "
        f"{(ended - begun) / HOUR_S:.3g} h; Δv {values['dv']:.3g} m/s, largest position error "
        f"{values['largest_position_error']:.3g} m{counted}."
    ]
    if meaning := what_left_it_undecided([product.status]):
        sentences.append(f"Meaning of {meaning}.")
    return [*sentences, *warnings_of(product)]


def _judgement(product: ClosedLoopFlight) -> str:
    reason = UNDECIDED.get(product.status)
    if reason is not None:
        return f"undecided ({reason})"
    return "failure" if product.failed else "success"


def warnings_of(product: ClosedLoopFlight) -> list[str]:
    """Return warnings of the accuracy of the flight, which hold for campaigns that repeat it."""
    values = dict(zip(product.metrics, product.values.tolist(), strict=True))
    sentences: list[str] = []
    if product.step_error_m is not None and not product.step_error_m <= _COARSE * max(
        values["largest_position_error"], 1.0
    ):
        sentences.append(
            f"The integration is coarse: with twice as many sub-steps the end of the flight moves "
            f"by {product.step_error_m:.2g} m. Raise substeps, or give a tolerance."
        )
    if product.series_radius_m is not None and product.nearest_m < product.series_radius_m:
        sentences.append(
            f"The smallest distance from the centre is {product.nearest_m / 1e3:.4g} km. Inside "
            f"{product.series_radius_m / 1e3:.4g} km the harmonic series of the gravity field may "
            "diverge."
        )
    if product.hill_distance_m is not None:
        share = product.farthest_m / product.hill_distance_m
        if share > _BEYOND_HILL:
            sentences.append(
                f"The flight reaches {100 * share:.2g} % of the distance to the primary. The Hill "
                "approximation neglects terms of that relative order."
            )
    return sentences
