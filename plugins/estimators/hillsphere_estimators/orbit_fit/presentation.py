"""Tables, figures, verdict and files of a fitted orbit."""

from __future__ import annotations

import numpy as np

from hillsphere.formats.oem import OemCovariance, OemSegment, write_oem
from hillsphere.formats.opm import Opm, write_opm
from hillsphere.interfaces import Array
from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.tables import column, tabulate, text_column
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_fit.figures import filter_chart, residual_chart
from hillsphere_estimators.orbit_fit.judgement import LEVEL
from hillsphere_estimators.orbit_fit.products import OrbitFit

__all__ = ["present_fit"]


def present_fit(product: OrbitFit) -> Presentation:
    """Show a fitted orbit.

    Parameters
    ----------
    product : OrbitFit
        State, covariance and residuals.

    Returns
    -------
    Presentation
        Tables, figures, verdict, and the orbit as OPM and OEM.
    """
    rows, run = product.rows, product.filter
    sigma = np.sqrt(np.diag(product.covariance))
    used = int(rows.used.sum())
    scale = _scale(product)
    metrics = {
        "fit_consistent": Metric(product.answer == "consistent"),
        "fit_squares_per_dof": Metric(product.squares),
        "fit_position_sigma": Metric(float(np.linalg.norm(sigma[:3])), "m"),
        "fit_velocity_sigma": Metric(float(np.linalg.norm(sigma[3:6])), "m/s"),
        "fit_values_used": Metric(used),
        "fit_values_edited": Metric(len(rows.used) - used),
    }
    scaled = []
    if scale is not None:
        metrics["fit_position_sigma_scaled"] = Metric(scale * float(np.linalg.norm(sigma[:3])),
                                                      "m")  # fmt: skip
        scaled = [column("sigma_scaled", scale * sigma[:6] / 1e3, "scaled by the residuals", 3,
                         unit="-")]  # fmt: skip
    names = [f"{name} ({unit})" for name, unit in zip(
        product.states[:6], ["km"] * 3 + ["km/s"] * 3, strict=True)]  # fmt: skip
    tables: dict[str, Table] = {
        "fit_state": tabulate(
            f"State of {product.spacecraft} at {product.epoch} {product.time_scale}, frame "
            f"{product.frame}",
            [
                text_column("state", names),
                column("value", product.mean[:6] / 1e3, "value", 12, unit="-"),
                column("sigma", sigma[:6] / 1e3, "standard deviation", 3, unit="-"),
                *scaled,
                column("change", (product.mean - product.start)[:6] / 1e3, "less the start", 4,
                       unit="-"),
            ],
            (
                "Values and standard deviations are in the units beside the names.",
                *([] if scale is None else [
                    "Standard deviations are those of the stated noise, which the residuals "
                    f"contradict; scaled: times {scale:.3g}, the root of the squared residuals a "
                    "degree of freedom.",
                ]),
            ),
        ),
        "fit_residuals": _residual_table(product),
    }  # fmt: skip
    if len(product.states) > 6:
        tables["fit_biases"] = tabulate(
            "Constant errors",
            [
                text_column("error", product.states[6:], "error of"),
                text_column("unit", product.bias_units, "unit"),
                column("value", product.mean[6:], "value", 4, unit="-"),
                column("sigma", sigma[6:], "standard deviation", 3, unit="-"),
                text_column("treatment", ["considered" if c else "estimated"
                                          for c in product.considered[6:]], "treatment"),
            ],
        )  # fmt: skip
    if product.left_out:
        tables["fit_left_out"] = tabulate(
            "Data that were not fitted",
            [
                text_column("keyword", product.left_out, "keyword"),
                text_column("reason", product.left_out_why, "reason"),
                column("values", product.left_out_count.astype(int), "values"),
            ],
        )
    figures = {"fit_residuals": residual_chart(product)}
    if run.answer:
        metrics["fit_filter_distance"] = Metric(run.distance)
        figures["fit_filter"] = filter_chart(product)
    return Presentation(
        metrics=metrics, tables=tables, figures=figures, verdict=_sentences(product),
        files={"orbit-fit.oem": _ephemeris(product), "orbit-fit.opm": _state(product)},
    )  # fmt: skip


def _residual_table(product: OrbitFit) -> Table:
    rows = product.rows
    return tabulate(
        "Residuals",
        [
            text_column("row", rows.labels, "path and value"),
            column("values", rows.count.astype(int), "values"),
            column("edited", rows.edited.astype(int), "left out"),
            column(
                "share", 100.0 * rows.edited / np.maximum(rows.count, 1.0), "left out", 2, unit="%"
            ),
            column("mean", rows.mean, "mean of all / σ", 3, unit="-"),
            column("rms", rows.rms, "rms / σ", 4, unit="-"),
            column("constant_error", rows.bias, "constant error / σ", 3, unit="-"),
            column("correlation", rows.correlation, "correlation / σ", 3, unit="-"),
        ],
        (
            "Mean of all: of the residuals of a fit of all values, before editing, in the stated "
            "standard deviations. rms of the used residuals over what it should be. Constant error "
            "and correlation of neighbours in their standard deviations, blank where the states "
            "take the error up or values are too few.",
        ),
    )


def _sentences(product: OrbitFit) -> list[str]:
    """Return the verdict in sentences."""
    rows, run = product.rows, product.filter
    sigma = np.sqrt(np.diag(product.covariance))
    first, *others = product.reasons
    scale = _scale(product)
    lines = [
        f"{_ANSWERS[product.answer]}: {first}.",
        *product.hints,
        *(f"{reason[0].upper()}{reason[1:]}." for reason in others),
    ]
    if scale is not None:
        lines.append(
            f"Standard deviations and covariance are not scaled: those of the stated noise. "
            f"Scaled by the residuals of the used values they are {scale:.3g} times as large."
        )
    lines += [
        f"{int(rows.used.sum())} values were used and {int((rows.used == 0.0).sum())} left out in "
        f"{product.rounds} fits.",
        f"The squared residuals are {product.squares:.4g} a degree of freedom ({product.dof}), "
        f"their band is {product.low:.4g} … {product.high:.4g} (all tests at {LEVEL:g}).",
        f"Standard deviations, roots of the traces: {np.linalg.norm(sigma[:3]):.4g} m and "
        f"{np.linalg.norm(sigma[3:6]):.4g} m/s.",
    ]
    if run.answer:
        lines.append(
            f"The filter is {run.answer} ({run.reason}); its last state is {run.distance:.2g} "
            "standard deviations from that of the fit."
        )
    if product.left_out:
        count = int(product.left_out_count.sum())
        lines.append(f"{count} values were not fitted: {', '.join(product.left_out)}.")
    return [*lines, *product.notes]


_ANSWERS = {
    "consistent": "The data are consistent with the fit",
    "inconsistent": "The data are inconsistent with the fit",
    "noise overstated": "The stated noise is too large for the data",
    "undecided": "Undecided whether the data are consistent with the fit",
}


def _scale(product: OrbitFit) -> float | None:
    """Return the factor by which residuals exceed the stated noise; None where they do not."""
    if product.answer != "inconsistent" or not product.squares > 1.0:
        return None
    return float(np.sqrt(product.squares))


def _comments(product: OrbitFit) -> tuple[str, ...]:
    """Return what a reader of the messages must know."""
    told = (f"Fit of tracking data: {product.answer}, {product.reasons[0]}",)
    scale = _scale(product)
    if scale is None:
        return told
    return (
        *told,
        "The covariance is that of the stated noise, not scaled by the residuals; scaled standard "
        f"deviations are {scale:.3g} times as large",
    )


def _segment_epoch(product: OrbitFit) -> Epoch:
    return Epoch.parse(product.zero, product.time_scale)


def _ephemeris(product: OrbitFit) -> str:
    first = float(product.ephemeris_t_s[0])
    segment = OemSegment(
        product.spacecraft, product.object_id, product.centre, product.ephemeris_frame,
        _segment_epoch(product), product.ephemeris_t_s, product.ephemeris,
        covariances=(OemCovariance(first, _symmetric(product.ephemeris_covariance)),),
        time_digits=9, comment="; ".join(_comments(product)),
    )  # fmt: skip
    return write_oem([segment])


def _state(product: OrbitFit) -> str:
    date = _segment_epoch(product).isot(product.ephemeris_t_s[:1], 9)[0]
    opm = Opm(
        product.spacecraft, product.object_id, product.centre, product.ephemeris_frame,
        Epoch.parse(date, product.time_scale), product.ephemeris[:, 0],
        covariance=_symmetric(product.ephemeris_covariance),
        comments=_comments(product),
    )  # fmt: skip
    return write_opm(opm)


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.T)
