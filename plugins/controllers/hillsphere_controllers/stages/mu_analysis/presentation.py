"""Presentation of robustness: bounds, certificates, worst cases, shares of the blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import (
    FilledColumn,
    column,
    finite_or_blank,
    set_beside,
    tabulate,
    text_column,
)
from hillsphere_controllers.stages.mu_analysis.figures import (
    bound_chart,
    select_share_curves,
    share_chart,
    share_curve_chart,
)
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis

__all__ = ["present_analyses"]

_TITLES = {
    "robust_stability": "robust stability",
    "robust_performance": "robust performance",
    "worst_case_gain": "worst-case gain",
}
_SINGULAR = 1e-6
"""Smallest singular value of I − M Δ up to which Δ counts as checked in the closed loop; it is the
limit of `mu.worst_case`."""
_PROVED = 1.0
"""Confidence of the bounds: a perturbation reaches the lower, a certificate proves the upper."""


_COVERED = (
    "They hold for the whole family of models: a block covers what the truncation or reduction of "
    "the uncertain models left out. 'Without the cover' is the bound certified for the truncated "
    "models alone; it does not hold for what was left out. The lower bounds are those of the "
    "truncated models."
)


def present_analyses(
    product: MuAnalysis,
    reference: str | None,
    columns: Sequence[tuple[MuAnalysis, Analysed]] = (),
) -> Presentation:
    """Return tables, figures and sentences of analyses.

    Parameters
    ----------
    product : MuAnalysis
        The analyses.
    reference : str or None
        Path of a cited table of published peaks.
    columns : sequence of (MuAnalysis, Analysed)
        Analyses that may stand in the figure of shares over frequency, and of which product each
        is; none: those of the product.
    """
    metrics = {}
    for one in product.worst:
        if len(product.nominal) == 1:
            bounds = (one.lower, one.upper)
            metrics[f"{one.analysis}_upper"] = Metric(one.upper, "-", bounds, _PROVED)
            metrics[f"{one.analysis}_lower"] = Metric(one.lower, "-", bounds, _PROVED)
    for one in product.worst_without_cover:
        if len(product.nominal) == 1:
            bounds = (one.lower, one.upper)
            metrics[f"{one.analysis}_without_cover"] = Metric(one.upper, "-", bounds, _PROVED)
    metrics["mu_loops"] = Metric(len(product.nominal))
    tables = {
        "mu_summary": _summary(product, reference),
        "mu_certificates": _certificates(product),
        "mu_worst_cases": _worst_cases(product),
    }
    if len(set(product.model.tolist())) > 1:
        tables |= {f"mu_models_{name}": _model_table(product, name) for name in _analyses(product)}
    figures = {}
    if any(one.omega_rad_s.size for one in product.worst):
        figures["mu_bounds"] = bound_chart(product, "mu_summary")
    if drawn := select_share_curves(columns or [(product, one) for one in product.worst]):
        figures["mu_sensitivity_curves"] = share_curve_chart(drawn)
    if any(one.shares.size for one in product.worst):
        tables["mu_sensitivities"] = _shares(product)
        figures["mu_sensitivities"] = share_chart(product, "mu_sensitivities")
    return Presentation(metrics, tables, figures, _verdict(product))


def _summary(product: MuAnalysis, path: str | None) -> Table:
    # compare like with like: the published values are maxima over these frequencies only
    on_grid = bool(np.isfinite(product.nominal_grid).any())
    columns = [
        text_column(
            "controller", [product.controllers[k] for k in product.controller.tolist()],
            "controller",
        ),
        text_column(
            "model", [product.models[k] for k in product.model.tolist()], "uncertain model"
        ),
        *_peak_columns(
            "nominal_performance", "nominal performance", product.nominal,
            product.nominal_grid if on_grid else None,
        ),
    ]  # fmt: skip
    for name, title in _TITLES.items():
        of_loop = {one.loop: one for one in product.worst if one.analysis == name}
        if not of_loop:
            continue
        peak, grid, upper, lower = (
            np.array(
                [getattr(of_loop.get(loop), field, np.nan) for loop in range(product.nominal.size)]
            )
            for field in ("peak", "grid_peak", "upper", "lower")
        )
        bounds: dict[str, Any] = {
            "interval": (f"{name}_lower", f"{name}_certified"), "confidence": _PROVED,
        }  # fmt: skip
        columns += [
            *_peak_columns(
                name, title, peak, grid if on_grid and name != "worst_case_gain" else None, **bounds
            ),
            column(f"{name}_certified", finite_or_blank(upper), f"{title}, certified", 5, **bounds),
            column(f"{name}_lower", finite_or_blank(lower), f"{title}, from below", 5, **bounds),
        ]
        if bare := {one.loop: one for one in product.worst_without_cover if one.analysis == name}:
            found = np.array(
                [getattr(bare.get(k), "upper", np.nan) for k in range(product.nominal.size)]
            )
            columns.append(
                column(
                    f"{name}_without_cover", finite_or_blank(found), f"{title}, without the cover",
                    5, interval=(f"{name}_lower", f"{name}_without_cover"), confidence=_PROVED,
                )
            )  # fmt: skip
    notes = [
        "For each analysis: the largest bound at one frequency (the lower bound where that is "
        "larger), the bound certified for all frequencies (at most "
        f"{100.0 * product.gap:.3g} % above, or as proved in parts), and the lower bound that a "
        "perturbation reaches. "
        + (
            _COVERED
            if product.without_cover
            else "The bounds hold for the uncertain models as given."
        )
    ]
    notes += [_division(product, one) for one in product.results if one.parts or one.parts_left]
    notes += [
        _division(product, one, " without the cover")
        for one in product.without_cover
        if one.parts or one.parts_left
    ]
    if any(one.channel for one in product.results):
        notes.append(
            "Each group of outputs is a channel of its own, and each number is the largest over "
            "the channels. Upper and lower bound may belong to different channels; the "
            "certificates list each."
        )
    if on_grid:
        notes.append(
            "Values 'at the frequencies published' are maxima over those frequencies, for the "
            "comparison. The peaks beside them are over all frequencies."
        )
    table = tabulate("Robustness", columns, notes)
    if path is None:
        return table
    reference = ReferenceTable.read(path)
    table = set_beside(table, reference, on="controller", label="controller")
    if remark := reference.about.get("note"):
        return replace(table, notes=[*table.notes, f"Published: {remark}."])
    return table


def _division(product: MuAnalysis, one: Analysed, of: str = "") -> str:
    """Return a sentence on the bound that branch and bound was to prove."""
    what = f"{product.label(one.loop)}: the bound asked for{_of_channel(one.channel)}{of}"
    total = one.parts + one.parts_left
    if one.parts_left:
        return f"{what} is not proved on {one.parts_left} of {total} parts of the ranges."
    return (
        f"{what}, {one.upper:.4g}, is proved in {total} parts of the ranges; "
        "undivided it is larger."
    )


def _peak_columns(
    name: str, title: str, peak: Array, grid: Array | None, **bounds: Any
) -> list[FilledColumn]:
    """Return the column of peaks, beside that of the maxima over published frequencies if any.

    The bounds are those of the peaks.
    """
    if grid is None:
        return [column(name, finite_or_blank(peak), title, 5, **bounds)]
    return [
        column(name, finite_or_blank(grid), f"{title}, at the frequencies published", 5),
        column(f"{name}_peak", finite_or_blank(peak), f"{title}, peak", 5, **bounds),
    ]


def _analysis_columns(product: MuAnalysis, shown: Sequence[Analysed]) -> list[FilledColumn]:
    """Return columns that say which analysis a row is of; its channel only if any has one."""
    columns = [
        text_column("loop", [product.label(one.loop) for one in shown], "loop"),
        text_column("analysis", [_TITLES[one.analysis] for one in shown], "analysis"),
    ]
    if any(one.channel for one in product.results):
        columns.append(text_column("channel", [one.channel or None for one in shown], "outputs"))
    return columns


def _certificates(product: MuAnalysis) -> Table:
    shown = product.results

    def numbers(name: str, field: str, label: str, digits: int) -> FilledColumn:
        found = np.array([getattr(one, field) for one in shown])
        # A peak may lie at infinite frequency: that is no blank.
        cells = found if name.endswith("_rad_s") else finite_or_blank(found)
        return column(name, cells, label, digits)

    intervals = [one.interval_bound.size for one in shown]
    parts = [one.parts if one.parts and not one.parts_left else None for one in shown]
    columns = [
        *_analysis_columns(product, shown),
        numbers("upper", "upper", "certified", 6),
        numbers("peak_rad_s", "peak_rad_s", "largest at", 4),
        column("intervals", intervals, "intervals that cover all frequencies"),
        *([column("parts", parts, "parts")] if any(one.parts for one in shown) else []),
        numbers("lower", "lower", "from below", 6),
        numbers("frequency_rad_s", "frequency_rad_s", "reached at", 4),
        numbers("singular", "singular", "least singular value of I − MΔ", 2),
        text_column(
            "complexified",
            [_describe_complex_parts(one) for one in shown],
            "with complex parts: from, to",
        ),
    ]
    most = (1.0 + product.gap) * (1.0 + 1e-9)  # beyond rounding of the gap that was asked for
    notes = [
        f"{product.label(one.loop)}{_of_channel(one.channel)}, {_TITLES[one.analysis]}: undecided "
        f"gap, the certified bound is {100.0 * (one.upper / one.peak - 1.0):.3g} % above the "
        "largest found at a frequency; a smaller gap needs too many intervals."
        for one in shown
        if most * one.peak < one.upper < np.inf and one.analysis != "worst_case_gain"
    ]
    return tabulate("Certificates", columns, notes)


def _describe_complex_parts(one: Analysed) -> str | None:
    bounds = zip(one.complex_parts, one.complex_upper, one.complex_lower, strict=True)
    said = [f"{100.0 * part:.3g} %: {lower:.4g} to {upper:.4g}" for part, upper, lower in bounds]
    return "; ".join(said) or None


def _worst_cases(product: MuAnalysis) -> Table:
    # One row for each parameter, and one for an analysis without parameters.
    rows = [(one, k) for one in product.results for k in range(len(one.names)) or (None,)]
    shown = [one for one, _ in rows]

    def of_parameter(field: str) -> list[Any]:
        return [None if k is None else getattr(one, field)[k] for one, k in rows]

    orders = [None if one.delta is None else one.delta.order for one in shown]
    values = [None if value is None else _finite(value) for value in of_parameter("values")]
    columns = [
        *_analysis_columns(product, shown),
        text_column("parameter", of_parameter("names"), "parameter"),
        column("value", values, "worst value", 6),
        text_column("unit", of_parameter("units"), "unit"),
        column("normalised", of_parameter("normalised"), "normalised", 5),
        column("frequency_rad_s", [one.frequency_rad_s for one in shown], "frequency", 4),
        column("order", orders, "order of Δ(s)"),
        column(
            "pole_re", [_finite(one.pole_re) for one in shown], "pole there, real part", 2,
            unit="1/s",
        ),
        column(
            "pole_im", [_finite(one.pole_im) for one in shown], "imaginary part", 5, unit="rad/s"
        ),
    ]  # fmt: skip
    notes = (
        "The smallest perturbation found that makes the loop unstable or violates its performance; "
        "for the worst-case gain, the perturbation of the declared size with the largest gain. A "
        "normalised value beyond −1 and 1 is outside the bounds.",
    )
    return tabulate("Worst cases", columns, notes)


def _shares(product: MuAnalysis) -> Table:
    rows = [
        (one, name, share)
        for one in product.worst
        for name, share in zip(one.blocks, one.shares, strict=False)  # no shares: not computed
    ]
    columns = [
        text_column("loop", [product.label(one.loop) for one, _, _ in rows], "loop"),
        text_column("analysis", [_TITLES[one.analysis] for one, _, _ in rows], "analysis"),
        text_column("block", [name for _, name, _ in rows], "block"),
        column("share", [share for _, _, share in rows], "share", 4),
    ]
    note = "The shares sum to one. For purely real blocks they are computed with complex parts."
    return tabulate("Shares of the blocks", columns, (note,))


def _analyses(product: MuAnalysis) -> list[str]:
    return [name for name in _TITLES if any(one.analysis == name for one in product.worst)]


def _model_table(product: MuAnalysis, analysis: str) -> Table:
    """Return one row a model and one column a controller."""
    worst = {one.loop: one for one in product.worst if one.analysis == analysis}
    bare = {one.loop: one for one in product.worst_without_cover if one.analysis == analysis}
    cells: dict[tuple[int, int], str] = {}
    for loop, nominal in enumerate(product.nominal):
        cell = "not stable"
        if np.isfinite(nominal):
            one = worst[loop]
            cell = f"{nominal:.4f}; {one.lower:.4f} to {one.upper:.4f}"
            if loop in bare:
                cell += f" ({bare[loop].upper:.4f} without the cover)"
        cells[int(product.model[loop]), int(product.controller[loop])] = cell
    models = list(dict.fromkeys(product.model.tolist()))
    columns = [
        text_column("model", [product.models[m] for m in models], "uncertain model"),
        *(
            text_column(f"controller_{k}", [cells.get((m, k)) for m in models], name)
            for k, name in enumerate(product.controllers)
        ),
    ]
    note = (
        "Nominal performance; lower bound, reached by a perturbation, to upper bound, certified "
        "for all frequencies."
    )
    if bare:
        note += f" {_COVERED}"
    title = _TITLES[analysis]
    of = f"{title[0].upper()}{title[1:]} by model, {product.uncertain}"
    return tabulate(of, columns, [note])


def _verdict(product: MuAnalysis) -> list[str]:
    said = []
    for number, controller in enumerate(product.controllers):
        loops = np.flatnonzero(product.controller == number)
        if len(loops) > 1:
            said += _summarise_models(product, controller, loops.tolist())
        else:
            said += [_describe_loop(product, int(loop)) for loop in loops]
    wrong = [one for one in product.results if one.singular > _SINGULAR]
    if wrong:
        said.append(
            f"{len(wrong)} worst cases fail their check in the closed loop: see Certificates."
        )
    return said


def _describe_loop(product: MuAnalysis, loop: int) -> str:
    name = product.label(loop)
    if not np.isfinite(product.nominal[loop]):
        return f"{name}: the nominal loop is unstable and was not analysed."
    bare = {one.analysis: one for one in product.worst_without_cover if one.loop == loop}
    parts = [
        _describe_result(one, bare.get(one.analysis)) for one in product.worst if one.loop == loop
    ]
    return f"{name}: {'; '.join(parts)}."


def _summarise_models(product: MuAnalysis, controller: str, loops: list[int]) -> list[str]:
    """Return a sentence an analysis of a controller with several models."""
    said = []
    name = f"{controller}, {product.uncertain}"
    unstable = [loop for loop in loops if not np.isfinite(product.nominal[loop])]
    if unstable:
        said.append(f"{name}: the nominal loop is unstable for {_model_names(product, unstable)}.")
    bare = [one for one in product.worst_without_cover if one.loop in loops]
    for analysis in _analyses(product):
        found = [o for o in product.worst if o.loop in loops and o.analysis == analysis]
        if not found:
            continue
        highest = max(found, key=lambda one: one.upper)
        if analysis == "worst_case_gain":
            without = f"; {_largest(bare, analysis):.4g} without the cover" if bare else ""
            said.append(
                f"{name}: worst-case gain at most {highest.upper:.4g} "
                f"({product.models[int(product.model[highest.loop])]}){without}."
            )
            continue
        sure = [one for one in found if one.upper < 1.0]
        broken = [one.loop for one in found if one.lower > 1.0]
        open_ = [one.loop for one in found if one.lower <= 1.0 <= one.upper]
        parts = [f"{_TITLES[analysis]} proved for {len(sure)} of {len(found)} uncertain models"]
        if sure:
            parts[0] += f" (µ ≤ {max(one.upper for one in sure):.4g}, certified)"
        if broken:
            of = "the truncated models of " if bare else ""
            parts.append(f"disproved for {of}{_model_names(product, broken)}")
        if open_:
            parts.append(f"undecided for {_model_names(product, open_)}")
        if bare:
            parts.append(
                f"without the cover of what was left out, all µ ≤ {_largest(bare, analysis):.4g}"
            )
        said.append(f"{name}: {'; '.join(parts)}.")
    return said


def _model_names(product: MuAnalysis, loops: list[int]) -> str:
    return ", ".join(product.models[int(product.model[loop])] for loop in loops)


def _largest(results: Sequence[Analysed], analysis: str) -> float:
    return max(one.upper for one in results if one.analysis == analysis)


def _describe_result(one: Analysed, bare: Analysed | None) -> str:
    beside = "" if bare is None else f"; {bare.upper:.4g} without the cover of what was left out"
    if one.analysis == "worst_case_gain":
        return f"worst-case gain from {one.lower:.4g} to {one.upper:.4g}{beside}"
    title = _TITLES[one.analysis]
    if one.upper < 1.0:
        return f"{title} proved (µ ≤ {one.upper:.4g}{_of_channel(one.channel)}, certified{beside})"
    if one.lower > 1.0:
        of = "" if bare is None else " for the truncated model"
        return f"{title} disproved{of} (µ ≥ {one.lower:.4g}{_of_channel(one.lower_channel)})"
    return (
        f"{title} undecided (µ from {one.lower:.4g}{_of_channel(one.lower_channel)} to "
        f"{one.upper:.4g}{_of_channel(one.channel)}{beside})"
    )


def _of_channel(channel: str) -> str:
    return f" of {channel}" if channel else ""


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
