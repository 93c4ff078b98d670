"""Tables and figures of transfers flown again."""

from __future__ import annotations

import numpy as np

from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Metric,
    Panel,
    Path,
    Points,
    Presentation,
)
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.qso.presentation import label_identifier
from hillsphere_orbits.scenes import MARKERS, name_axis, scene_chart
from hillsphere_orbits.transfers_reflown.products import TransfersReflown
from hillsphere_orbits.transfers_reflown.rungs import REFLOWN

__all__ = ["present_reflown"]

_RUNG_COLOURS = ("black", *LINE_COLOURS)


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
    flown = np.isfinite(product.dv_m_s)
    changes = (product.dv_m_s - product.plan_dv_m_s[:, None])[flown]
    metrics = {
        "reflown_transfers": Metric(int(flown.size)),
        "reflown_found": Metric(sum(status == REFLOWN for status in product.status)),
    }
    figures = {}
    if changes.size:
        metrics["reflown_change_max"] = Metric(float(np.max(np.abs(changes))), "m/s")
        metrics["reflown_closure_max"] = Metric(float(np.nanmax(product.closure_m)), "m")
        own = label_identifier("transfers_reflown", label)
        figures = {
            "transfers_reflown": _cost_chart(product, own),
            "transfers_reflown_paths": _path_chart(product, own),
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
        "transfers_reflown": tabulate("Transfers flown again", _plans(product), notes),
        "transfers_reflown_patches": tabulate("Patch points", _patches(product)),
        "transfers_reflown_rungs": tabulate("Rungs", _rungs(product)),
    }
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={label_identifier(name, label): table for name, table in tables.items()},
        figures={label_identifier(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _plans(product: TransfersReflown) -> list[FilledColumn]:
    of = FieldColumns(product, "rungs", "plans")
    change = product.dv_m_s - product.plan_dv_m_s[:, None]
    return [
        of("rungs", "rung"),
        of("plans", "plan"),
        text_column("status", product.status, "status"),
        of("plan_dv_m_s", "dv_plan_m_s"),
        of("dv_m_s"),
        column("change_m_s", change.T.ravel(), "change", 4),
        *map(of, ("tof_s", "stay_s", "displacement_m", "closure_m", "closure_m_s")),
        *map(of, ("min_altitude_m", "gap", "iterations")),
    ]


def _patches(product: TransfersReflown) -> list[FilledColumn]:
    of = FieldColumns(product, "rungs", "patches")
    plans = tuple(product.plans[q] for q in product.patch_plan)
    change = product.patch_dv_m_s - product.patch_plan_dv_m_s[:, None]
    return [
        of("rungs", "rung"),
        text_column("plan", of.spread(plans, "patches"), "plan"),
        of("patches", "patch"),
        of("patch_held", "held"),
        of("patch_plan_dv_m_s", "dv_plan_m_s"),
        of("patch_dv_m_s", "dv_m_s"),
        column("change_m_s", change.T.ravel(), "change", 4),
    ]


def _rungs(product: TransfersReflown) -> list[FilledColumn]:
    of, count = FieldColumns(product, "rungs"), len(product.plans)
    reflown = np.array([status == REFLOWN for status in product.status], dtype=bool)
    reflown = reflown.reshape(len(product.rungs), count)
    least, mean, largest = np.full((3, len(reflown)), np.nan)
    cheapest: list[str | None] = [None] * len(reflown)
    for r, good in enumerate(map(np.flatnonzero, reflown)):
        if good.size:
            dv = product.dv_m_s[good, r]
            change = dv - product.plan_dv_m_s[good]
            least[r], mean[r] = np.min(dv), np.mean(change)
            largest[r] = change[np.argmax(np.abs(change))]
            cheapest[r] = product.plans[good[np.argmin(dv)]]
    return [
        of("rungs", "rung"),
        of("rung_plants", "plant"),
        column("plans", [count] * len(reflown), "plans"),
        column("reflown", np.count_nonzero(reflown, axis=1), "reflown"),
        column("dv_least_m_s", least, "least Δv", 6),
        text_column("cheapest", cheapest, "of the plan"),
        column("change_mean_m_s", mean, "mean change", 4),
        column("change_max_m_s", largest, "largest change", 4),
    ]


def _verdict(product: TransfersReflown) -> list[str]:
    said = []
    for row in tabulate("Rungs", _rungs(product)).rows:
        text = f"{row['rung']} ({row['plant']}): {row['reflown']} of {row['plans']} transfers"
        text += " are flown again"
        if row["dv_least_m_s"] is not None:
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


def _cost_chart(product: TransfersReflown, table: str) -> Chart:
    rows, count = np.arange(len(product.plans)), len(product.plans)
    marks = [Points(product.plan_dv_m_s, rows, "as planned", "grey", "bar", 14.0)]
    marks += [
        Points(product.dv_m_s[:, r], rows, rung, _RUNG_COLOURS[r % len(_RUNG_COLOURS)],
               MARKERS[r % len(MARKERS)], 6.0, is_filled=False, rows=(r * count + rows).tolist())
        for r, rung in enumerate(product.rungs)
    ]  # fmt: skip
    return Chart(
        "Impulses of the transfers on every rung",
        [Panel(Axis("sum of impulses", "m/s"), name_axis(product.plans), marks, legend="above")],
        "Sum of all impulses of each plan as planned and on every rung; plans that were not found "
        "on a rung have no mark there.",
        size_in=(8.0, 1.6 + 0.32 * count),
        table=table,
    )


def _path_chart(product: TransfersReflown, table: str) -> Chart:
    last_rung = np.flatnonzero(np.isfinite(product.dv_m_s).any(axis=0))[-1]
    plan = int(np.nanargmin(product.dv_m_s[:, last_rung]))
    first, last = np.flatnonzero(np.isfinite(product.dv_m_s[plan]))[[0, -1]].tolist()
    coasts = np.flatnonzero(product.coast_plan == plan).tolist()

    def paths(rung: int, label: str, *colours: str, width: float) -> list[Path]:
        return [
            Path(product.coast_m[:, :, c, rung] / 1e3, label.format(number + 1),
                 colours[number % len(colours)], width=width, rows=rung * len(product.plans) + plan)
            for number, c in enumerate(coasts)
        ]  # fmt: skip

    solids = paths(first, f"on {product.rungs[first]}", "light", width=1.8)
    if last > first:
        solids += paths(last, f"coast {{}} on {product.rungs[last]}", *LINE_COLOURS, width=0.9)
    return scene_chart(
        "Coasts of the cheapest plan", solids, None,
        f"The coasts of {product.plans[plan]} on the first and the last rung on which the plan was "
        "found, in the frame that turns with the line to the primary.",
        table=table,
    )  # fmt: skip
