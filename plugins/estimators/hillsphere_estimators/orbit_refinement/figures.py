"""Figures of the refinement of an asteroid's orbit."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import AU_M, DAY_S
from hillsphere.interfaces import Array
from hillsphere.presentation import LINE_COLOURS, Axis, Chart, Curve, Mark, Panel, Span
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.orbit_refinement.gains import geometries_with_tracking, rms
from hillsphere_estimators.orbit_refinement.products import OrbitRefinement
from hillsphere_estimators.orbit_refinement.verdict import silences

__all__ = ["consistency_chart", "optical_chart", "tracking_chart"]

_COLOURS = (*LINE_COLOURS, "grey")
_TRACKED = Axis("since tracking began", "h")


def optical_chart(product: OrbitRefinement) -> Chart:
    """Return the errors during the optical part, one line per geometry."""
    known = product.optical
    t = known.t_s / DAY_S
    panels = []
    for name, unit, scale, error, sigma in (
        ("position", "km", 1e-3, known.position_m, known.position_sigma_m),
        ("velocity", "m/s", 1.0, known.velocity_m_s, known.velocity_sigma_m_s),
    ):
        marks = []
        for g in np.argsort(product.earth_distance_m).tolist():
            colour = _COLOURS[g % len(_COLOURS)]
            label = f"{product.geometries[g]} ({product.earth_distance_m[g] / AU_M:.2f} au)"
            median = np.median(error[:, g], axis=1)
            marks += [
                Curve(t, scale * median, label, colour, rows=g),
                Curve(t, scale * rms(sigma[:, g]), "", colour, "dashed", 0.9, rows=g),
            ]
        y_axis = Axis(f"error of {name}", unit, "log")
        panels.append(Panel(Axis("since the first observation", "d"), y_axis, marks))
    return Chart(
        "The asteroid's orbit by angles from the Earth", panels,
        "Errors of position and velocity while it is observed: medians of the cases of each "
        "geometry (solid) and the standard deviation of the fit (dashed). In brackets: least "
        "distance of the Earth.",
        share_x=True, shared_legend=True, size_in=(8.0, 6.4), table="refinement_optical",
    )  # fmt: skip


def tracking_chart(product: OrbitRefinement) -> Chart:
    """Return the errors during tracking, for the nearest and the farthest geometry."""
    ends = [int(np.argmin(product.earth_distance_m)), int(np.argmax(product.earth_distance_m))]
    shown = list(dict.fromkeys(ends))
    panels = []
    for name, unit, scale in (("position", "km", 1e-3), ("velocity", "m/s", 1.0)):
        for g in shown:
            away = product.earth_distance_m[g] / AU_M
            title = f"{product.geometries[g]} ({away:.2f} au from the Earth)"
            panels.append(
                Panel(_TRACKED, Axis(name, unit, "log"), _tracking(product, g, name, scale),
                      title if name == "position" else "")
            )  # fmt: skip
    return Chart(
        "The asteroid's orbit with spacecraft near it", panels,
        "For the geometries nearest to the Earth and farthest from it: rms error of the cases "
        "(thin) and standard deviation (thick). Dotted: the standard deviation of the velocity of "
        "the worst known spacecraft. Shaded: less than all of the first set's sensors measure.",
        columns=len(shown), share_x=True, share_y=True, shared_legend=True, size_in=(9.0, 6.6),
        table="refinement_arms",
    )  # fmt: skip


def _tracking(product: OrbitRefinement, g: int, name: str, scale: float) -> list[Mark]:
    """Return errors and standard deviations of position or velocity in a geometry."""
    first = product.tracked[0]
    t = (first.t_s - first.t_s[0]) / 3600.0
    marks: list[Mark] = [
        Span("x", t[before + 1], t[last], opacity=0.35)
        for before, last in silences(first.rows[:, g])
    ]
    for a, (arm, known) in enumerate(zip(product.arms, product.tracked, strict=True)):
        colour = _COLOURS[a % len(_COLOURS)]
        error, sigma = known.position_m, known.position_sigma_m
        if name == "velocity":
            error, sigma = known.velocity_m_s, known.velocity_sigma_m_s
        marks += [
            Curve(t, scale * rms(sigma[:, g]), arm, colour, width=2.0, rows=a),
            Curve(t, scale * rms(error[:, g]), "", colour, width=0.7, rows=a),
        ]
        craft = product.craft_velocity_sigma_m_s[a][:, g]
        if name == "velocity" and craft.any():
            marks.append(Curve(t, rms(craft), "", colour, "dotted", 1.3, rows=a))
    return marks


def consistency_chart(product: OrbitRefinement) -> Chart:
    """Return the mean NEES of the asteroid's six states over time, one line per arm."""
    low, high = map(float, chi_square_band(6, product.settled.size))
    marks: list[Mark] = [Span("y", low, high, "99.9 % band", "body", 0.3)]
    worst = 0.0
    for a, (arm, known) in enumerate(zip(product.arms, product.tracked, strict=True)):
        some = geometries_with_tracking(product, a)
        if not some.size:
            continue
        t = (known.t_s - known.t_s[0]) / 3600.0
        mean: Array = known.nees[:, some].reshape(len(t), -1).mean(axis=1)
        worst = max(worst, float(mean.max()))
        marks.append(Curve(t, mean, arm, _COLOURS[a % len(_COLOURS)], rows=a))
    y_axis = Axis("mean NEES of six states", scale="log" if worst > 3.0 * high else "linear")
    return Chart(
        "Consistency of the asteroid's state", [Panel(_TRACKED, y_axis, marks)],
        "Mean normalised error squared of the asteroid's six states over all cases, with the band "
        "that holds 99.9 % of such means of a consistent filter.",
        size_in=(8.0, 3.8), table="refinement_arms",
    )  # fmt: skip
