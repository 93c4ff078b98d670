"""Presentation of robustness: bounds, certificates, worst cases, shares of the blocks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere.show.reference import ReferenceTable, beside, difference_notes, with_paper
from hillsphere_controllers.stages.mu_analysis.figures import (
    draw_bounds,
    draw_share_curves,
    draw_shares,
    with_share_curves,
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
_SAME_FREQUENCY = 0.05
"""Ends of curves that differ by less, relative, look the same in a figure."""


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
            metrics[f"{one.analysis}_upper"] = Metric(one.upper)
            metrics[f"{one.analysis}_lower"] = Metric(one.lower)
    metrics["mu_loops"] = Metric(len(product.nominal))
    tables = {
        "mu_summary": _summary(product, reference),
        "mu_certificates": _certificates(product),
        "mu_worst_cases": _worst_cases(product),
    }
    if len(set(product.model.tolist())) > 1:
        tables |= {f"mu_models_{name}": _by_model(product, name) for name in _analyses(product)}
    figures = {}
    if any(one.omega_rad_s.size for one in product.worst):
        shown = {one.analysis for one in product.worst if one.omega_rad_s.size}
        figures["mu_bounds"] = Figure(
            "Bounds of µ over frequency",
            partial(draw_bounds, product=product),
            "Upper bounds (solid) and lower bounds (dots) at single frequencies; the bars above "
            "are intervals on each of which one pair of scalings proves the bound at its height: "
            "together they cover all frequencies.",
            size_in=(7.4, 0.8 + 3.2 * len(shown)),
        )
    shown_columns = columns or [(product, one) for one in product.worst]
    if drawn := with_share_curves(shown_columns):
        figures["mu_sensitivity_curves"] = Figure(
            "µ and shares of the blocks over frequency",
            partial(draw_share_curves, columns=drawn),
            "Above: bounds of µ, the gain of the nominal loop, and as bars the intervals on each "
            "of which one pair of scalings proves the bound; below: relative change of the upper "
            "bound with the size of each block. Blocks that never reach 5 % are together."
            + _frequencies_differ(drawn),
            size_in=(1.6 + 3.2 * len(drawn), 7.0),
        )
    if any(one.shares.size for one in product.worst):
        tables["mu_sensitivities"] = _shares(product)
        figures["mu_sensitivities"] = Figure(
            "Shares of the blocks in µ",
            partial(draw_shares, product=product),
            "Relative change of the upper bound at its peak with the size of each block.",
        )
    return Presentation(metrics, tables, figures, _verdict(product))


def _frequencies_differ(columns: Sequence[tuple[MuAnalysis, Analysed]]) -> str:
    """Return a sentence on the columns' frequency ranges, empty if they are the same."""
    spans = [(float(one.omega_rad_s[0]), float(one.omega_rad_s[-1])) for _, one in columns]
    if all(max(ends) <= (1.0 + _SAME_FREQUENCY) * min(ends) for ends in zip(*spans, strict=True)):
        return ""
    told = "; ".join(
        f"{product.label(one.loop)}: {low:.2g} to {high:.2g} rad/s"
        for (product, one), (low, high) in zip(columns, spans, strict=True)
    )
    return f" The columns span different frequencies: {told}."


def _summary(product: MuAnalysis, path: str | None) -> Table:
    rows: list[dict[str, Cell]] = []
    # compare like with like: the published values are maxima over these frequencies only
    on_grid = bool(np.isfinite(product.nominal_grid).any())
    for loop, nominal in enumerate(product.nominal):
        row: dict[str, Cell] = {
            "controller": product.controllers[int(product.controller[loop])],
            "model": product.models[int(product.model[loop])],
            "nominal_performance": _finite(product.nominal_grid[loop] if on_grid else nominal),
        }
        if on_grid:
            row["nominal_performance_peak"] = _finite(nominal)
        for one in product.worst:
            if one.loop == loop:
                at_published = on_grid and one.analysis != "worst_case_gain"
                row[one.analysis] = _finite(one.grid_peak if at_published else one.peak)
                if at_published:
                    row[f"{one.analysis}_peak"] = _finite(one.peak)
                row[f"{one.analysis}_certified"] = one.upper if np.isfinite(one.upper) else None
                row[f"{one.analysis}_lower"] = one.lower if np.isfinite(one.lower) else None
        rows.append(row)
    columns = [
        Column("controller", "", "controller"),
        Column("model", "", "uncertain model"),
        *_columns("nominal_performance", "nominal performance", on_grid),
    ]
    for name, title in _TITLES.items():
        if any(one.analysis == name for one in product.worst):
            columns += [
                *_columns(name, title, on_grid and name != "worst_case_gain"),
                Column(f"{name}_certified", "-", f"{title}, certified", 5),
                Column(f"{name}_lower", "-", f"{title}, from below", 5),
            ]
    notes = [
        "For each analysis: the largest bound at one frequency (the lower bound where that is "
        "larger), the bound certified for all frequencies (at most "
        f"{100.0 * product.gap:.3g} % above, or as proved in parts), and the lower bound that a "
        "perturbation reaches. The bounds hold for the uncertain models as given; errors of these "
        "models, such as the truncation of an LFT, are not included."
    ]
    notes += [_division(product, one) for one in product.results if one.parts or one.parts_left]
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
    if path is None:
        return Table("Robustness", columns, rows, notes)
    reference = ReferenceTable.read(path)
    rows = beside(rows, reference, on="controller")
    notes += difference_notes(rows, reference, label="controller")
    if remark := reference.about.get("note"):
        notes.append(f"Published: {remark}.")
    return Table("Robustness", with_paper(columns, rows), rows, notes)


def _division(product: MuAnalysis, one: Analysed) -> str:
    """Return a sentence on the bound that branch and bound was to prove."""
    what = f"{product.label(one.loop)}: the bound asked for{_of(one.channel)}"
    total = one.parts + one.parts_left
    if one.parts_left:
        return f"{what} is not proved on {one.parts_left} of {total} parts of the ranges."
    return (
        f"{what}, {one.upper:.4g}, is proved in {total} parts of the ranges; "
        "undivided it is larger."
    )


def _columns(name: str, title: str, on_grid: bool) -> list[Column]:
    if not on_grid:
        return [Column(name, "-", title, 5)]
    return [
        Column(name, "-", f"{title}, at the frequencies published", 5),
        Column(f"{name}_peak", "-", f"{title}, peak", 5),
    ]


def _certificates(product: MuAnalysis) -> Table:
    rows: list[dict[str, Cell]] = []
    for one in product.results:
        row: dict[str, Cell] = {
            "loop": product.label(one.loop),
            "analysis": _TITLES[one.analysis],
            **({"channel": one.channel} if one.channel else {}),
            "upper": _finite(one.upper),
            "peak_rad_s": _frequency(one.peak_rad_s),
            "intervals": int(one.interval_bound.size),
            **({"parts": one.parts} if one.parts and not one.parts_left else {}),
            "lower": _finite(one.lower),
            "frequency_rad_s": _frequency(one.frequency_rad_s),
            "singular": _finite(one.singular),
        }
        for part, upper, lower in zip(
            one.complex_parts, one.complex_upper, one.complex_lower, strict=True
        ):
            row["complexified"] = (
                f"{row.get('complexified', '')}{'; ' if 'complexified' in row else ''}"
                f"{100.0 * part:.3g} %: {lower:.4g} to {upper:.4g}"
            )
        rows.append(row)
    columns = (
        Column("loop", "", "loop"),
        Column("analysis", "", "analysis"),
        *([Column("channel", "", "outputs")] if any(o.channel for o in product.results) else []),
        Column("upper", "-", "certified", 6),
        Column("peak_rad_s", "rad/s", "largest at", 4),
        Column("intervals", "-", "intervals that cover all frequencies"),
        *([Column("parts", "-", "parts")] if any(o.parts for o in product.results) else []),
        Column("lower", "-", "from below", 6),
        Column("frequency_rad_s", "rad/s", "reached at", 4),
        Column("singular", "-", "least singular value of I − MΔ", 2),
        Column("complexified", "", "with complex parts: from, to"),
    )
    return Table("Certificates", columns, rows)


def _worst_cases(product: MuAnalysis) -> Table:
    rows: list[dict[str, Cell]] = []
    for one in product.results:
        where = {
            "loop": product.label(one.loop),
            "analysis": _TITLES[one.analysis],
            **({"channel": one.channel} if one.channel else {}),
            "frequency_rad_s": _frequency(one.frequency_rad_s),
            "order": None if one.delta is None else one.delta.order,
            "pole_re": _finite(one.pole_re),
            "pole_im": _finite(one.pole_im),
        }
        for k, name in enumerate(one.names):
            rows.append(
                {
                    **where,
                    "parameter": name,
                    "value": _finite(one.values[k]),
                    "unit": one.units[k],
                    "normalised": float(one.normalised[k]),
                }
            )
        if not one.names:
            rows.append(dict(where))
    columns = (
        Column("loop", "", "loop"),
        Column("analysis", "", "analysis"),
        *([Column("channel", "", "outputs")] if any(o.channel for o in product.results) else []),
        Column("parameter", "", "parameter"),
        Column("value", "-", "worst value", 6),
        Column("unit", "", "unit"),
        Column("normalised", "-", "normalised", 5),
        Column("frequency_rad_s", "rad/s", "frequency", 4),
        Column("order", "-", "order of Δ(s)"),
        Column("pole_re", "1/s", "pole there, real part", 2),
        Column("pole_im", "rad/s", "imaginary part", 5),
    )
    notes = (
        "The smallest perturbation found that makes the loop unstable or violates its performance; "
        "for the worst-case gain, the perturbation of the declared size with the largest gain. A "
        "normalised value beyond −1 and 1 is outside the bounds.",
    )
    return Table("Worst cases", columns, rows, notes)


def _shares(product: MuAnalysis) -> Table:
    rows: list[dict[str, Cell]] = [
        {
            "loop": product.label(one.loop),
            "analysis": _TITLES[one.analysis],
            "block": name,
            "share": float(share),
        }
        for one in product.worst
        for name, share in zip(one.blocks, one.shares, strict=False)
    ]
    columns = (
        Column("loop", "", "loop"),
        Column("analysis", "", "analysis"),
        Column("block", "", "block"),
        Column("share", "-", "share", 4),
    )
    return Table(
        "Shares of the blocks",
        columns,
        rows,
        ("The shares sum to one. For purely real blocks they are computed with complex parts.",),
    )


def _analyses(product: MuAnalysis) -> list[str]:
    return [name for name in _TITLES if any(one.analysis == name for one in product.worst)]


def _by_model(product: MuAnalysis, analysis: str) -> Table:
    """Return one row a model and one column a controller."""
    rows: dict[int, dict[str, Cell]] = {
        int(m): {"model": product.models[int(m)]} for m in dict.fromkeys(product.model.tolist())
    }
    for loop, nominal in enumerate(product.nominal):
        cell = "not stable"
        if np.isfinite(nominal):
            one = next(o for o in product.worst if (o.loop, o.analysis) == (loop, analysis))
            cell = f"{nominal:.4f}; {one.lower:.4f} to {one.upper:.4f}"
        rows[int(product.model[loop])][f"controller_{int(product.controller[loop])}"] = cell
    columns = [
        Column("model", "", "uncertain model"),
        *(Column(f"controller_{k}", "", name) for k, name in enumerate(product.controllers)),
    ]
    note = (
        "Nominal performance; lower bound, reached by a perturbation, to upper bound, certified "
        "for all frequencies."
    )
    title = _TITLES[analysis]
    of = f"{title[0].upper()}{title[1:]} by model, {product.uncertain}"
    return Table(of, columns, list(rows.values()), [note])


def _verdict(product: MuAnalysis) -> list[str]:
    said = []
    for number, controller in enumerate(product.controllers):
        loops = np.flatnonzero(product.controller == number)
        if len(loops) > 1:
            said += _summarise_models(product, controller, loops.tolist())
        else:
            said += [_said(product, int(loop)) for loop in loops]
    wrong = [one for one in product.results if one.singular > _SINGULAR]
    if wrong:
        said.append(
            f"{len(wrong)} worst cases fail their check in the closed loop: see Certificates."
        )
    return said


def _said(product: MuAnalysis, loop: int) -> str:
    name = product.label(loop)
    if not np.isfinite(product.nominal[loop]):
        return f"{name}: the nominal loop is unstable and was not analysed."
    parts = [_sentence(one) for one in product.worst if one.loop == loop]
    return f"{name}: {'; '.join(parts)}."


def _summarise_models(product: MuAnalysis, controller: str, loops: list[int]) -> list[str]:
    """Return a sentence an analysis of a controller with several models."""
    said = []
    name = f"{controller}, {product.uncertain}"
    unstable = [loop for loop in loops if not np.isfinite(product.nominal[loop])]
    if unstable:
        said.append(f"{name}: the nominal loop is unstable for {_names(product, unstable)}.")
    for analysis in _analyses(product):
        found = [o for o in product.worst if o.loop in loops and o.analysis == analysis]
        if not found:
            continue
        highest = max(found, key=lambda one: one.upper)
        if analysis == "worst_case_gain":
            said.append(
                f"{name}: worst-case gain at most {highest.upper:.4g} "
                f"({product.models[int(product.model[highest.loop])]})."
            )
            continue
        sure = [one for one in found if one.upper < 1.0]
        broken = [one.loop for one in found if one.lower > 1.0]
        open_ = [one.loop for one in found if one.lower <= 1.0 <= one.upper]
        parts = [f"{_TITLES[analysis]} proved for {len(sure)} of {len(found)} uncertain models"]
        if sure:
            parts[0] += f" (µ ≤ {max(one.upper for one in sure):.4g}, certified)"
        if broken:
            parts.append(f"disproved for {_names(product, broken)}")
        if open_:
            parts.append(f"undecided for {_names(product, open_)}")
        said.append(f"{name}: {'; '.join(parts)}.")
    return said


def _names(product: MuAnalysis, loops: list[int]) -> str:
    return ", ".join(product.models[int(product.model[loop])] for loop in loops)


def _sentence(one: Analysed) -> str:
    if one.analysis == "worst_case_gain":
        return f"worst-case gain from {one.lower:.4g} to {one.upper:.4g}"
    title = _TITLES[one.analysis]
    if one.upper < 1.0:
        return f"{title} proved (µ ≤ {one.upper:.4g}{_of(one.channel)}, certified)"
    if one.lower > 1.0:
        return f"{title} disproved (µ ≥ {one.lower:.4g}{_of(one.lower_channel)})"
    return (
        f"{title} undecided (µ from {one.lower:.4g}{_of(one.lower_channel)} to "
        f"{one.upper:.4g}{_of(one.channel)})"
    )


def _of(channel: str) -> str:
    return f" of {channel}" if channel else ""


def _frequency(value: float) -> float | None:
    return None if np.isnan(value) else float(value)  # a peak may lie at infinite frequency


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
