"""Presentation of sampled loops: margins at each period, and the spectral radius."""

from __future__ import annotations

from functools import partial

import numpy as np

from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_controllers.stages.sampled_loops.figures import draw_radius
from hillsphere_controllers.stages.sampled_loops.products import SampledLoops

__all__ = ["present_sampled_loops"]

_COLUMNS = (
    Column("controller", "", "controller"),
    Column("period_s", "s", "period", 5),
    Column("spectral_radius", "-", "spectral radius", 5),
    Column("peak", "-", "Ms", 4),
    Column("peak_single", "-", "Ms of one control", 4),
    Column("gain_lower", "-", "gain from", 4),
    Column("gain_upper", "-", "to", 4),
    Column("gain_lower_all", "-", "of all from", 4),
    Column("gain_upper_all", "-", "to", 4),
    Column("lost_s", "s", "lost at", 5),
    Column("model", "", "model with the largest Ms"),
)


def present_sampled_loops(product: SampledLoops) -> Presentation:
    """Return tables, figures and sentences of sampled loops."""
    rows: list[dict[str, Cell]] = []
    for c, name in enumerate(product.controllers):
        for k, period in enumerate(product.period_s.tolist()):
            here = c, k
            lower, upper = (one[:, c, k] for one in (product.gain_lower, product.gain_upper))
            ranked = np.where(np.isfinite(product.peak[here]), product.peak[here], np.inf)
            rows.append(
                {
                    "controller": name,
                    "period_s": period,
                    "spectral_radius": float(product.spectral_radius[here].max()),
                    "peak": _finite(product.peak[here].max()),
                    "peak_single": _finite(product.peaks[:, c, k].max()),
                    "gain_lower": float(lower[:-1].max()),
                    "gain_upper": _finite(upper[:-1].min()),
                    "gain_lower_all": float(lower[-1].max()),
                    "gain_upper_all": _finite(upper[-1].min()),
                    "lost_s": _finite(product.lost_s[c]),
                    "model": product.models[int(np.argmax(ranked))],
                }
            )
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
        tables={"sampled_loops": Table("Loops as they are sampled", _COLUMNS, rows, notes)},
        figures={}
        if np.isnan(product.radius).all()
        else {
            "sampled_loops": Figure(
                "Spectral radius over the sampling period",
                partial(draw_radius, product=product),
                "Of the monodromy over one period, the largest of all models; a loop is stable "
                "below one.",
            )
        },
        verdict=_verdict(product),
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


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
