"""Presentation of linear models: a table of orders and poles, a figure of gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere.presentation import Axis, Chart, Curve, Metric, Panel, Presentation
from hillsphere.show.tables import column, tabulate, text_column
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["present_linear_models"]

_LISTED = 50
"""Rows of the table of models at most; all models are in the product."""
_BORDER = 1e-7
"""Distance from the stability boundary, relative to the largest pole, up to which a pole counts as
on it: rounding displaces a double pole by its square root, 1e-8."""
_DRAWN = 40
"""Gains drawn at most, evenly spaced among the models; more make a grey area only."""
_NAMED = 8
"""Models in a legend at most: it would cover the curves."""


def present_linear_models(product: LinearModels) -> Presentation:
    """Return the table and the figure of linear models.

    Parameters
    ----------
    product : LinearModels
        The models.

    Returns
    -------
    Presentation
        With the first models, if there are many.
    """
    count = len(product.systems)
    listed = product.systems[:_LISTED]
    counts = [_not_stable(system) for system in listed]
    columns = [
        text_column("model", product.labels[:_LISTED], "model"),
        column("order", [system.order for system in listed], "order"),
        column("outputs", [system.shape[0] for system in listed], "outputs"),
        column("inputs", [system.shape[1] for system in listed], "inputs"),
        column(
            "abscissa_1_s", [spectral_abscissa(one) if one.order else None for one in listed],
            "largest real part of the poles", 5,
        ),
        column("unstable_poles", [unstable for unstable, _ in counts], "unstable poles"),
        column("border_poles", [border for _, border in counts], "poles on the stability border"),
        column(
            "fastest_pole_rad_s",
            [float(np.abs(one.poles).max()) if one.order else None for one in listed],
            "largest pole", 5,
        ),
    ]  # fmt: skip
    notes = [
        f"Parameters: {', '.join(_parameter(product, k) for k in range(len(product.parameters)))}."
        if product.parameters
        else "Without parameters.",
        f"The last {product.controls} inputs are controls, the last {product.measurements} outputs "
        "measurements.",
    ]
    if count > _LISTED:
        notes.append(f"The first {_LISTED} of {count} models.")
    return Presentation(
        metrics={"linear_models": Metric(count)},
        tables={"linear_models": replace(tabulate("Linear models", columns, notes), total=count)},
        figures={"linear_models": _gain_chart(product, "linear_models")},
    )


def _not_stable(system: LtiSystem) -> tuple[int, int]:
    """Return the numbers of unstable poles and of poles on the stability boundary."""
    if not system.order:
        return 0, 0
    poles = np.linalg.eigvals(balance_states(system)[0].a)
    away = poles.real if system.dt_s is None else np.abs(poles) - 1.0
    largest = max(float(np.abs(poles).max()), 1e-300) if system.dt_s is None else 1.0
    # of a pole that is listed twice, rounding leaves its square root
    border = np.abs(away) <= _BORDER * largest
    return int(np.count_nonzero((away > 0.0) & ~border)), int(np.count_nonzero(border))


def _parameter(product: LinearModels, k: int) -> str:
    unit = f" {product.units[k]}" if product.units[k] not in ("", "-") else ""
    values = product.values[k]
    across = f"{values.min():.6g} to {values.max():.6g}{unit}, " if np.ptp(values) > 0.0 else ""
    return f"{product.parameters[k]} ({across}nominal {product.nominal[k]:.6g}{unit})"


def _inner(product: LinearModels, system: LtiSystem) -> LtiSystem:
    """Return the part from the controls to the measurements."""
    if not product.controls:
        return system
    p, m = system.shape
    rows, columns = slice(p - product.measurements, p), slice(m - product.controls, m)
    return LtiSystem(
        system.a, system.b[:, columns], system.c[rows], system.d[rows, columns], system.dt_s
    )


def _gain_chart(product: LinearModels, table: str) -> Chart:
    count = len(product.systems)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _DRAWN)).astype(int)).tolist()
    inner = [_inner(product, product.systems[k]) for k in chosen]
    # Each at frequencies of its own: those around the poles of all models would be thousands.
    grids = [frequencies([system]) for system in inner]
    return Chart(
        "Gains of the models",
        [Panel(
            Axis("frequency", "rad/s", scale="log"), Axis("largest singular value", scale="log"),
            [
                Curve(omega, largest_gains(system.response(omega)), product.labels[k],
                      width=1.6 if count <= _NAMED else 0.8, rows=k)
                for system, omega, k in zip(inner, grids, chosen, strict=True)
            ],
            legend="best" if 1 < count <= _NAMED else "none",
        )],
        "Largest singular value from the controls to the measurements (from all inputs to all "
        "outputs if there are none), one line a model.",
        table=table,
    )  # fmt: skip
