"""Tables and figures of transfers flown again."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.presentation import PALETTE, Cell, Column, Figure, Metric, Presentation, Table
from hillsphere_orbits.qso.presentation import named
from hillsphere_orbits.survey import NEARLY_PLANAR
from hillsphere_orbits.transfers_reflown.products import TransfersReflown
from hillsphere_orbits.transfers_reflown.rungs import REFLOWN

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["present_reflown"]

_HOUR, _DAY = 3600.0, 86400.0
_COLOURS = [PALETTE[c] for c in ("black", "blue", "vermillion", "green", "purple", "orange", "sky")]
_MARKS = "osD^vP*"
_PLANS = (
    Column("rung", "", "rung"),
    Column("plan", "", "plan"),
    Column("status", "", "status"),
    Column("dv_plan_m_s", "m/s", "Δv as planned", 6),
    Column("dv_m_s", "m/s", "Δv", 6),
    Column("change_m_s", "m/s", "change", 4),
    Column("tof_h", "h", "time of flight", 5),
    Column("stay_h", "h", "of it on orbits between", 5),
    Column("displacement_km", "km", "patch points moved by", 4),
    Column("closure_m", "m", "closure", 2),
    Column("closure_m_s", "m/s", "closure, velocity", 2),
    Column("altitude_min_km", "km", "least height", 5),
    Column("gap", "-", "largest gap", 2),
    Column("iterations", "-", "steps"),
)
_PATCHES = (
    Column("rung", "", "rung"),
    Column("plan", "", "plan"),
    Column("patch", "", "from, to"),
    Column("held", "", "stays on"),
    Column("dv_plan_m_s", "m/s", "Δv as planned", 6),
    Column("dv_m_s", "m/s", "Δv", 6),
    Column("change_m_s", "m/s", "change", 4),
)
_RUNGS = (
    Column("rung", "", "rung"),
    Column("plant", "", "equations"),
    Column("plans", "-", "plans"),
    Column("reflown", "-", "reflown"),
    Column("dv_least_m_s", "m/s", "least Δv", 6),
    Column("cheapest", "", "of the plan"),
    Column("change_mean_m_s", "m/s", "mean change", 4),
    Column("change_max_m_s", "m/s", "largest change", 4),
)


def present_reflown(product: TransfersReflown, label: str) -> Presentation:
    """Show transfers flown again.

    Parameters
    ----------
    product : TransfersReflown
        What is shown.
    label : str
        Appended to identifiers.

    Returns
    -------
    Presentation
        Tables ``transfers_reflown`` (a row per plan and rung), ``transfers_reflown_patches`` and
        ``transfers_reflown_rungs``, figures ``transfers_reflown`` and
        ``transfers_reflown_paths``.
    """
    found = np.isfinite(product.dv_m_s)
    changes = (product.dv_m_s - product.plan_dv_m_s[:, None])[found]
    metrics = {
        "reflown_transfers": Metric(int(found.size)),
        "reflown_found": Metric(sum(status == REFLOWN for status in product.status)),
    }
    figures = {}
    if changes.size:
        metrics["reflown_change_max"] = Metric(float(np.max(np.abs(changes))), "m/s")
        metrics["reflown_closure_max"] = Metric(float(np.nanmax(product.closure_m)), "m")
        figures = {
            "transfers_reflown": Figure(
                "Impulses of the transfers on every rung",
                lambda figure: _draw_costs(figure, product),
                "Sum of all impulses of each plan as planned and on every rung; plans that were "
                "not found on a rung have no mark there.",
                size_in=(8.0, 1.6 + 0.32 * len(product.plans)),
            ),
            "transfers_reflown_paths": Figure(
                "Coasts of the cheapest plan",
                lambda figure: _draw_paths(figure, product),
                "The coasts on the first and the last rung on which the plan was found, in the "
                "frame that turns with the line to the primary.",
                size_in=(8.0, 6.5),
            ),
        }
    notes = [
        "Orbits named in the patch points are re-converged on every rung about that time; a coast "
        "leads from where its orbit then is to where the next one is, in the time of the plan. "
        "Other patch points keep the place of the plan.",
        "A plan that begins or ends on no orbit that was given has no impulse there.",
        "Nothing is optimised anew: places and times stay, and the impulses follow. Where a coast "
        "arrives on an orbit along its manifold, what it misses there counts as an impulse.",
        "Closure: miss of a coast's end when Taylor series fly it from its first state alone.",
        "The true anomaly of the moon is "
        f"{np.degrees(product.start_true_anomaly_rad):g}° when a plan's first coast begins, where "
        "its orbit is an ellipse.",
    ]
    tables = {
        "transfers_reflown": Table("Transfers flown again", _PLANS, _plan_rows(product), notes),
        "transfers_reflown_patches": Table("Patch points", _PATCHES, _patch_rows(product)),
        "transfers_reflown_rungs": Table("Rungs", _RUNGS, _rung_rows(product)),
    }
    return Presentation(
        metrics={named(name, label): metric for name, metric in metrics.items()},
        tables={named(name, label): table for name, table in tables.items()},
        figures={named(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _number(value: float, unit: float = 1.0) -> float | None:
    return float(value) / unit if isfinite(value) else None


def _plan_rows(product: TransfersReflown) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for r, rung in enumerate(product.rungs):
        for q, plan in enumerate(product.plans):
            dv, planned = product.dv_m_s[q, r], product.plan_dv_m_s[q]
            rows.append(
                {
                    "rung": rung,
                    "plan": plan,
                    "status": product.status[r * len(product.plans) + q],
                    "dv_plan_m_s": _number(planned),
                    "dv_m_s": _number(dv),
                    "change_m_s": _number(dv - planned),
                    "tof_h": _number(product.tof_s[q], _HOUR),
                    "stay_h": _number(product.stay_s[q], _HOUR),
                    "displacement_km": _number(product.displacement_m[q, r], 1e3),
                    "closure_m": _number(product.closure_m[q, r]),
                    "closure_m_s": _number(product.closure_m_s[q, r]),
                    "altitude_min_km": _number(product.altitude_min_m[q, r], 1e3),
                    "gap": _number(product.gap[q, r]),
                    "iterations": int(product.iterations[q, r]),
                }
            )
    return rows


def _patch_rows(product: TransfersReflown) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for r, rung in enumerate(product.rungs):
        for p, patch in enumerate(product.patches):
            dv, planned = product.patch_dv_m_s[p, r], product.patch_plan_dv_m_s[p]
            rows.append(
                {
                    "rung": rung,
                    "plan": product.plans[product.patch_plan[p]],
                    "patch": patch,
                    "held": product.patch_held[p],
                    "dv_plan_m_s": _number(planned),
                    "dv_m_s": _number(dv),
                    "change_m_s": _number(dv - planned),
                }
            )
    return rows


def _rung_rows(product: TransfersReflown) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    count = len(product.plans)
    for r, rung in enumerate(product.rungs):
        own = product.status[r * count : (r + 1) * count]
        row: dict[str, Cell] = {
            "rung": rung,
            "plant": product.rung_plants[r],
            "plans": count,
            "reflown": sum(status == REFLOWN for status in own),
        }
        good = np.flatnonzero([status == REFLOWN for status in own])
        if good.size:
            dv = product.dv_m_s[good, r]
            change = dv - product.plan_dv_m_s[good]
            row |= {
                "dv_least_m_s": float(np.min(dv)),
                "cheapest": product.plans[int(good[np.argmin(dv)])],
                "change_mean_m_s": float(np.mean(change)),
                "change_max_m_s": float(change[np.argmax(np.abs(change))]),
            }
        rows.append(row)
    return rows


def _verdict(product: TransfersReflown) -> list[str]:
    said = []
    for row in _rung_rows(product):
        text = f"{row['rung']} ({row['plant']}): {row['reflown']} of {row['plans']} transfers"
        text += " are flown again"
        if "dv_least_m_s" in row:
            text += (
                f", Δv changes by {row['change_mean_m_s']:+.3g} m/s on average and "
                f"{row['change_max_m_s']:+.3g} m/s at most; the cheapest is {row['cheapest']} with "
                f"{row['dv_least_m_s']:.4f} m/s"
            )
        said.append(text + ".")
    if failed := [
        f"{product.plans[k % len(product.plans)]} on {product.rungs[k // len(product.plans)]} "
        f"({status})"
        for k, status in enumerate(product.status)
        if status != REFLOWN
    ]:
        said.append(f"Not reflown: {'; '.join(failed)}.")
    return said


def _draw_costs(figure: Canvas, product: TransfersReflown) -> None:
    axes = figure.subplots()
    rows = np.arange(len(product.plans))
    axes.plot(product.plan_dv_m_s, rows, "|", color="#777777", markersize=16, markeredgewidth=2,
              label="as planned")  # fmt: skip
    for r, rung in enumerate(product.rungs):
        axes.plot(product.dv_m_s[:, r], rows, _MARKS[r % len(_MARKS)], markersize=6,
                  color=_COLOURS[r % len(_COLOURS)], fillstyle="none", label=rung)  # fmt: skip
    axes.set_yticks(rows, product.plans, fontsize="small")
    axes.invert_yaxis()
    axes.set_xlabel("sum of impulses (m/s)")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=4, fontsize="small")


def _draw_paths(figure: Canvas, product: TransfersReflown) -> None:
    rungs = np.flatnonzero(np.isfinite(product.dv_m_s).any(axis=0))
    plan = int(np.nanargmin(product.dv_m_s[:, rungs[-1]]))
    rungs = np.flatnonzero(np.isfinite(product.dv_m_s[plan]))
    coasts = np.flatnonzero(product.coast_plan == plan)
    away = np.nanmax(np.abs(product.coast_m[:, :, coasts]), axis=(1, 2, 3))
    # truer gravity lifts planar coasts by metres, which nobody would see
    views = ((1, 0),) if away[2] < NEARLY_PLANAR * np.max(away) else ((1, 0), (1, 2))
    for axes, (right, up) in zip(
        figure.subplots(len(views), 1, squeeze=False)[:, 0], views, strict=True
    ):
        first, last = int(rungs[0]), int(rungs[-1])
        for number, c in enumerate(coasts):
            place = product.coast_m[:, :, c, first] / 1e3
            what = None if number else f"on {product.rungs[first]}"
            axes.plot(place[right], place[up], color="#aaaaaa", linewidth=1.8, label=what)
        for number, c in enumerate(coasts if last > first else ()):
            place = product.coast_m[:, :, c, last] / 1e3
            colour = _COLOURS[1 + number % (len(_COLOURS) - 1)]
            what = f"coast {number + 1} on {product.rungs[last]}"
            axes.plot(place[right], place[up], color=colour, linewidth=0.9, label=what)
        axes.plot(0.0, 0.0, "+", color=PALETTE["black"])
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[right]} (km)")
        axes.set_ylabel(f"{'xyz'[up]} (km)")
        axes.grid(alpha=0.3)
    figure.suptitle(product.plans[plan], fontsize="medium")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize="small")
