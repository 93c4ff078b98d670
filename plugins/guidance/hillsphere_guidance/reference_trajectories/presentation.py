"""Tables, figures and sentences of the reference trajectories."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Cell, Column, Figure, Metric, Presentation, Table
from hillsphere.show.reference import ReferenceTable, beside, difference_notes, with_paper
from hillsphere_guidance.reference_trajectories.figures import (
    draw_descents,
    draw_differences,
    draw_over_time,
)
from hillsphere_guidance.reference_trajectories.products import ReferenceTrajectories
from hillsphere_guidance.reference_trajectories.specs import ReferenceTrajectoriesSpec

__all__ = ["present_references"]

_COLUMNS = [
    Column("descent", ""),
    Column("start_km", "km", "start", 6),
    Column("latitude_deg", "deg", "latitude", 6),
    Column("longitude_deg", "deg", "longitude", 6),
    Column("duration_s", "s", "duration", 6),
    Column("dv_m_s", "m/s", "ΔV", 5),
    Column("dv_held_m_s", "m/s", "ΔV, held", 5),
    Column("peak_mm_s2", "mm/s2", "largest command", 4),
    Column("touchdown_m_s", "m/s", "speed at the end", 4),
    Column("lowest_m", "m", "lowest before the end", 4),
    Column("replay_m", "m", "replay error", 2),
    Column("replay_held_m", "m", "replay error, held", 2),
    Column("search", ""),
]
_BELOW_M = 1e-3
"""Depth below the surface, m, from which a path counts as passing through it: a path
that begins or ends on the surface may be below it by rounding, far less than a millimetre."""
_SHARES = (0, 25, 50, 75, 100)
"""Parts of the duration, %, at which other plants are compared in the table."""
_METHOD = (
    "Replay errors: distance from the planned end at which an open-loop flight with the command "
    "alone ends, by propagators that had no part in planning; as planned by DOP853, as held on the "
    "grid by Taylor series (by the step map where the field is no expression)."
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
        As declared.
    published : ReferenceTable or None
        Costs of others.

    Returns
    -------
    Presentation
        A table of costs, one of the ends, a view in space and histories.
    """
    rows = _rows(product)
    columns: list[Column] = list(_COLUMNS)
    notes = [*([spec.note] if spec.note else []), _METHOD]
    if published is not None:
        rows = beside(rows, published, on="descent")
        columns = with_paper(columns, rows)
        notes += difference_notes(rows, published, label="descent")
    tail = f"_{spec.label}" if spec.label else ""
    figures = {
        f"reference_histories{tail}": Figure(
            "Reference trajectories over time",
            lambda figure: draw_over_time(figure, product),
            "Height above the surface along the radius, and the size of the command as planned.",
            size_in=(8.0, 6.0),
        )
    }
    if len(product.command) == 3:
        figures[f"reference_trajectories{tail}"] = Figure(
            "Reference trajectories",
            lambda figure: draw_descents(figure, product),
            "In the frame of the motion, with ΔV; circles are starts, triangles are ends.",
            size_in=(8.0, 7.0),
        )
    tables = {
        f"reference_trajectories{tail}": Table("Reference trajectories", columns, rows, notes),
        f"reference_ends{tail}": Table("Ends of the reference trajectories", *_ends(product)),
    }
    if product.compared:
        tables[f"reference_differences{tail}"] = _differences(product)
        figures[f"reference_differences{tail}"] = Figure(
            "Accelerations by other plants",
            lambda figure: draw_differences(figure, product),
            "Size of the difference from the plant's own acceleration along each path, without a "
            "command.",
            size_in=(8.0, 1.0 + 2.6 * len(product.compared)),
        )
    worst = product.replay_m[0].max(), product.replay_held_m[0].max()
    return Presentation(
        metrics={
            f"reference_trajectories{tail}": Metric(len(rows)),
            f"replay_error{tail}": Metric(float(worst[0]), "m"),
            f"replay_error_held{tail}": Metric(float(worst[1]), "m"),
        },
        tables=tables,
        figures=dict(reversed(figures.items())),
        verdict=_sentences(product),
    )


def _rows(product: ReferenceTrajectories) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for i, name in enumerate(product.flights.labels):
        lowest = _before_end(product, i)
        rows.append(
            {
                "descent": name,
                "start_km": float(product.start_distance_m[i] / 1e3),
                "latitude_deg": _number(np.degrees(product.latitude_rad[i])),
                "longitude_deg": _number(np.degrees(product.longitude_rad[i])),
                "duration_s": float(product.duration_s[i]),
                "dv_m_s": float(product.dv_m_s[i]),
                "dv_held_m_s": float(product.dv_held_m_s[i]),
                "peak_mm_s2": float(1e3 * product.peak_m_s2[i]),
                "touchdown_m_s": float(np.linalg.norm(_end(product, i)[1])),
                "lowest_m": _number(lowest.min(initial=np.inf)),
                "replay_m": float(product.replay_m[0, i]),
                "replay_held_m": float(product.replay_held_m[0, i]),
                "search": product.account[i],
            }
        )
    return rows


def _ends(product: ReferenceTrajectories) -> tuple[list[Column], list[dict[str, Cell]]]:
    """Return where the descents end."""
    flights = product.flights
    d = len(product.command)
    places = [f"{name}_m" for name in flights.states[:d]]
    speeds = [f"{name}_m_s" for name in flights.states[d : 2 * d]]
    columns = [
        Column("descent", ""),
        *(Column(name, "m", digits=11) for name in places),
        *(Column(name, "m/s", digits=8) for name in speeds),
    ]
    rows: list[dict[str, Cell]] = []
    for i, label in enumerate(flights.labels):
        r, v = _end(product, i)
        numbers = zip([*places, *speeds], [*r, *v], strict=True)
        rows.append({"descent": label} | {name: float(value) for name, value in numbers})
    return columns, rows


def _end(product: ReferenceTrajectories, i: int) -> tuple[Sequence[float], Sequence[float]]:
    """Return position and velocity at the end of a descent."""
    last = np.flatnonzero(np.isfinite(product.flights.t_s[:, i]))[-1]
    x = product.flights.x[:, last, i]
    d = len(product.command)
    return x[:d].tolist(), x[d : 2 * d].tolist()


def _differences(product: ReferenceTrajectories) -> Table:
    """Return how much other plants accelerate otherwise, at some times and at the end."""
    columns = [
        Column("plant", ""),
        Column("descent", ""),
        *(
            Column(f"at_{share}_percent_mm_s2", "mm/s2", f"at {share} % of the time", 4)
            for share in _SHARES[:-1]
        ),
        Column("at_100_percent_mm_s2", "mm/s2", "at the end", 4),
        Column("mean_mm_s2", "mm/s2", "mean over time", 4),
    ]
    rows: list[dict[str, Cell]] = []
    for c, name in enumerate(product.compared):
        for i, label in enumerate(product.flights.labels):
            here = np.isfinite(product.flights.t_s[:, i])
            t, size = product.flights.t_s[here, i], 1e3 * product.difference_m_s2[c, here, i]
            row: dict[str, Cell] = {"plant": name, "descent": label}
            for share in _SHARES:
                at = t[0] + 0.01 * share * (t[-1] - t[0])
                row[f"at_{share}_percent_mm_s2"] = float(np.interp(at, t, size))
            row["mean_mm_s2"] = float(np.trapezoid(size, t) / (t[-1] - t[0]))
            rows.append(row)
    note = "Size of the difference of the accelerations, no command acting."
    return Table("Accelerations by other plants along the descents", columns, rows, (note,))


def _before_end(product: ReferenceTrajectories, i: int) -> Array:
    heights = product.height_m[:, i]
    return heights[np.isfinite(heights)][:-1]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _sentences(product: ReferenceTrajectories) -> list[str]:
    labels = product.flights.labels
    buried = [
        label for i, label in enumerate(labels)
        if _before_end(product, i).min(initial=np.inf) < -_BELOW_M
    ]  # fmt: skip
    least, most = product.dv_m_s.min(), product.dv_m_s.max()
    count = f"{len(labels)} reference trajectories" if len(labels) > 1 else "A reference trajectory"
    spread = f"{least:.4g}" if len(labels) == 1 else f"{least:.4g} to {most:.4g}"
    sentences = [
        f"{count} by guidance {product.guidance!r}, ΔV {spread} m/s; flown open loop with the "
        f"command held, the end is met to {product.replay_held_m[0].max():.1e} m."
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
                "the series of the gravity field is not sure to converge."
            )
    return sentences
