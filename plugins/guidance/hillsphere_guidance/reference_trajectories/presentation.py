"""Tables, figures and verdict of the stage ``reference_trajectories``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import (
    FieldColumns,
    FilledColumn,
    column,
    set_beside,
    tabulate,
    text_column,
)
from hillsphere_guidance.reference_trajectories.figures import (
    descent_chart,
    difference_chart,
    history_chart,
)
from hillsphere_guidance.reference_trajectories.products import ReferenceTrajectories
from hillsphere_guidance.reference_trajectories.specs import ReferenceTrajectoriesSpec

__all__ = ["present_references"]

_BELOW_M = 1e-3
"""Depth below the surface, m, from which a path counts as passing through it: a path
that begins or ends on the surface may be below it by rounding, far less than a millimetre."""
_SHARES = (0, 25, 50, 75, 100)
"""Times at which other plants are compared in the table, % of the duration."""
_METHOD = (
    "Replay errors: distance between the planned end and that of an open-loop flight by an "
    "independent propagator, DOP853 for the command as planned, Taylor series for the held command "
    "(or the step map, if the field is no expression)."
)


def present_references(
    product: ReferenceTrajectories,
    spec: ReferenceTrajectoriesSpec,
    published: ReferenceTable | None,
) -> Presentation:
    """Show costs, replays and paths.

    Parameters
    ----------
    product : ReferenceTrajectories
        The descents.
    spec : ReferenceTrajectoriesSpec
        Its note and label.
    published : ReferenceTable or None
        Published costs.

    Returns
    -------
    Presentation
        A table of costs, one of the ends, a view in space and histories.
    """
    notes = [*([spec.note] if spec.note else []), _METHOD]
    costs = tabulate("Reference trajectories", _cost_columns(product), notes)
    costs = set_beside(costs, published, on="descent", label="descent")
    tail = f"_{spec.label}" if spec.label else ""
    own = f"reference_trajectories{tail}"
    figures = {f"reference_histories{tail}": history_chart(product, own)}
    if len(product.command) == 3:
        figures[own] = descent_chart(product, own)
    tables = {
        own: costs,
        f"reference_ends{tail}": tabulate(
            "Ends of the reference trajectories", _end_columns(product)
        ),
    }
    if product.compared:
        tables[f"reference_differences{tail}"] = _differences(product)
        beside = f"reference_differences{tail}"
        figures[beside] = difference_chart(product, beside)
    worst = product.replay_m[0].max(), product.replay_held_m[0].max()
    return Presentation(
        metrics={
            own: Metric(len(product.flights.labels)),
            f"replay_error{tail}": Metric(float(worst[0]), "m"),
            f"replay_error_held{tail}": Metric(float(worst[1]), "m"),
        },
        tables=tables,
        figures=dict(reversed(figures.items())),
        verdict=_sentences(product),
    )


def _cost_columns(product: ReferenceTrajectories) -> list[FilledColumn]:
    """Return the columns of costs and replays, one row per descent."""
    of = FieldColumns(product, "descents")
    count = len(product.flights.labels)
    speeds = [float(np.linalg.norm(_end(product, i)[1])) for i in range(count)]
    lowest = [_before_end(product, i).min(initial=np.inf) for i in range(count)]
    return [
        text_column("descent", product.flights.labels),
        of("start_distance_m", "start_km"),
        of("latitude_rad"),
        of("longitude_rad"),
        of("duration_s"),
        of("dv_m_s"),
        of("dv_held_m_s"),
        column("peak_mm_s2", product.peak_m_s2, "largest command", 4, unit="mm/s2"),
        column("touchdown_m_s", speeds, "speed at the end", 4),
        column("lowest_m", [h if np.isfinite(h) else None for h in lowest],
               "lowest before the end", 4),
        column("replay_m", product.replay_m[0], "replay error", 2),
        column("replay_held_m", product.replay_held_m[0], "replay error, held", 2),
        of("account", "search", ""),
    ]  # fmt: skip


def _end_columns(product: ReferenceTrajectories) -> list[FilledColumn]:
    """Return the columns of positions and velocities at the end, one row per descent."""
    flights, d = product.flights, len(product.command)
    ends = [_end(product, i) for i in range(len(flights.labels))]
    return [
        text_column("descent", flights.labels),
        *(
            column(f"{name}_m", [r[i] for r, _ in ends], digits=11)
            for i, name in enumerate(flights.states[:d])
        ),
        *(
            column(f"{name}_m_s", [v[i] for _, v in ends])
            for i, name in enumerate(flights.states[d : 2 * d])
        ),
    ]


def _end(product: ReferenceTrajectories, i: int) -> tuple[Sequence[float], Sequence[float]]:
    """Return position and velocity at the end of a descent."""
    last = np.flatnonzero(np.isfinite(product.flights.t_s[:, i]))[-1]
    x = product.flights.x[:, last, i]
    d = len(product.command)
    return x[:d].tolist(), x[d : 2 * d].tolist()


def _differences(product: ReferenceTrajectories) -> Table:
    """Return the differences of other plants' accelerations, at some times and in the mean."""
    labels = product.flights.labels
    rows: list[list[float]] = []
    for c in range(len(product.compared)):
        for i in range(len(labels)):
            here = np.isfinite(product.flights.t_s[:, i])
            t, size = product.flights.t_s[here, i], 1e3 * product.difference_m_s2[c, here, i]
            times = [t[0] + 0.01 * share * (t[-1] - t[0]) for share in _SHARES]
            mean = np.trapezoid(size, t) / (t[-1] - t[0])
            rows.append([float(np.interp(at, t, size)) for at in times] + [float(mean)])
    names = [*(f"at_{share}_percent_mm_s2" for share in _SHARES), "mean_mm_s2"]
    texts = [*(f"at {share} % of the time" for share in _SHARES[:-1]), "at the end",
             "mean over time"]  # fmt: skip
    columns = [
        text_column("plant", [plant for plant in product.compared for _ in labels]),
        text_column("descent", [label for _ in product.compared for label in labels]),
        *(
            column(name, [row[j] for row in rows], text, 4, unit="mm/s2", is_si=False)
            for j, (name, text) in enumerate(zip(names, texts, strict=True))
        ),
    ]
    note = "Size of the difference of the accelerations, no command acting."
    return tabulate("Accelerations by other plants along the descents", columns, (note,))


def _before_end(product: ReferenceTrajectories, i: int) -> Array:
    """Return the heights (K,) of a descent without that at its end."""
    heights = product.height_m[:, i]
    return heights[np.isfinite(heights)][:-1]


def _sentences(product: ReferenceTrajectories) -> list[str]:
    """Return the verdict: cost and replay, paths below the surface or inside the series' radius."""
    labels = product.flights.labels
    buried = [
        label for i, label in enumerate(labels)
        if _before_end(product, i).min(initial=np.inf) < -_BELOW_M
    ]  # fmt: skip
    least, most = product.dv_m_s.min(), product.dv_m_s.max()
    count = f"{len(labels)} reference trajectories" if len(labels) > 1 else "A reference trajectory"
    spread = f"{least:.4g}" if len(labels) == 1 else f"{least:.4g} to {most:.4g}"
    sentences = [
        f"{count} by guidance {product.guidance!r}: ΔV {spread} m/s. Flown open loop under the "
        "held command, the flights end "
        f"within {product.replay_held_m[0].max():.1e} m of their targets."
    ]
    if buried:
        sentences.append(
            f"{', '.join(buried)}: the path runs below the surface before its end; take another "
            "duration, start or guidance."
        )
    radius = product.series_radius_m
    if radius is not None:
        r = np.linalg.norm(product.flights.x[: len(product.command)], axis=0)
        inside = int(np.sum(np.nanmin(r, axis=0) < radius))
        if inside:
            sentences.append(
                f"{inside} of {len(labels)} descents come closer than {radius / 1e3:.5g} km, where "
                "the series of the gravity field may diverge."
            )
    return sentences
