"""Presentation of sampled loops: margins at each period, and the spectral radius."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Metric, Presentation
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    finite_or_blank,
    tabulate,
    text_column,
)
from hillsphere_controllers.stages.sampled_loops.figures import radius_chart
from hillsphere_controllers.stages.sampled_loops.products import SampledLoops

__all__ = ["present_sampled_loops"]


def present_sampled_loops(product: SampledLoops) -> Presentation:
    """Return tables, figures and sentences of sampled loops."""
    late = f" {product.delay_s:g} s after the sample" if product.delay_s else " at the sample"
    notes = [
        f"Each number is the worst of {len(product.models)} models. The commands act{late}, and "
        "the plant moves in continuous time. Ms is the largest gain from disturbances of the "
        "controls, held over each period, to the mean of the total command. The gains are factors"
        " on one control, and on all at once, between which the loop stays stable. An unstable "
        "loop has no margins."
    ]
    metrics = {
        f"sampled_lost_{name}": Metric(float(lost), "s")
        for name, lost in zip(product.controllers, product.lost_s, strict=True)
        if np.isfinite(lost)
    }
    return Presentation(
        metrics=metrics,
        tables={
            "sampled_loops": tabulate("Loops as they are sampled", _margin_columns(product), notes)
        },
        figures={}
        if np.isnan(product.radius).all()
        else {"sampled_loops": radius_chart(product, "sampled_loops")},
        verdict=_verdict(product),
    )


def _margin_columns(product: SampledLoops) -> list[FilledColumn]:
    of = FieldColumns(product, "controllers", "periods")

    def worst(name: str, values: Array, label: str, digits: int = 4) -> FilledColumn:
        return column(name, of.spread(values, "controllers", "periods"), label, digits)

    lower, upper = product.gain_lower, product.gain_upper
    # A loop that is not stable has no peak, and is worse than any other.
    ranked = np.where(np.isfinite(product.peak), product.peak, np.inf)
    models = [product.models[k] for k in ranked.argmax(axis=2).ravel()]
    lost = of.spread(finite_or_blank(product.lost_s), "controllers")
    return [
        of("controllers", "controller"),
        of("period_s"),
        worst("spectral_radius", product.spectral_radius.max(axis=2), "spectral radius", 5),
        worst("peak", finite_or_blank(product.peak.max(axis=2)), "Ms"),
        worst("peak_single", finite_or_blank(product.peaks.max(axis=(0, 3))), "Ms of one control"),
        worst("gain_lower", lower[:-1].max(axis=(0, 3)), "gain from"),
        worst("gain_upper", finite_or_blank(upper[:-1].min(axis=(0, 3))), "to"),
        worst("gain_lower_all", lower[-1].max(axis=2), "of all from"),
        worst("gain_upper_all", finite_or_blank(upper[-1].min(axis=2)), "to"),
        column("lost_s", lost, "lost at", 5),
        text_column("model", models, "model with the largest Ms"),
    ]


def _verdict(product: SampledLoops) -> list[str]:
    sentences = []
    for c, name in enumerate(product.controllers):
        lost, longest = float(product.lost_s[c]), float(product.looked_s[-1])
        if np.isnan(product.radius[c]).all():  # made for one period
            periods = ", ".join(f"{period:.4g}" for period in product.period_s)
            stable = bool((product.spectral_radius[c] < 1.0).all())
            sentences.append(
                f"{name} is {'' if stable else 'not '}stable, sampled every {periods} s."
            )
            continue
        where = (
            f"loses stability at periods of {lost:.4g} s and more"
            if np.isfinite(lost)
            else f"is stable for all periods up to {longest:.4g} s"
        )
        sentences.append(f"{name} {where}.")
    return sentences
