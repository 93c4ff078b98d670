"""Tables and figures of the fidelity ladder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Cloud,
    Curve,
    Mark,
    Metric,
    Note,
    Panel,
    Presentation,
)
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.fidelity_ladder.products import FidelityLadder
from hillsphere_orbits.qso.presentation import format_count, label_identifier
from hillsphere_orbits.scenes import orbit_paths, scene_chart

__all__ = ["present_ladder"]

_PARTS = 60
"""Parts of the time in the figure of departures: fewer hide the growth, more show every swing."""
_NODES = 1500
"""Nodes of a flight in a figure: as many as still show the spread about its orbit."""


def present_ladder(product: FidelityLadder, label: str) -> Presentation:
    """Show a ladder.

    Parameters
    ----------
    product : FidelityLadder
        What is shown.
    label : str
        Appended to identifiers.

    Returns
    -------
    Presentation
        Tables ``fidelity_ladder`` (a row per rung and member), ``fidelity_rungs`` and
        ``fidelity_periodic``, figures ``fidelity_departures`` and ``fidelity_flights``.
    """
    days = product.times_s[-1] / DAY_S
    notes = [
        f"Departure: distance from the nearest point of the orbit of the first rung, over {days:g} "
        "days; along the orbit the flight may slip, by the time given.",
        "Gaps are in natural units, measured by another propagator than the one that closed them.",
        "Survival: the flight from the first node, never corrected, is lost beyond "
        f"{product.limit:g} times the orbit's largest |x|, |y| or, in space, |z|, or at the "
        "surface. On an unstable orbit rounding alone ends it.",
    ]
    if any(count > 6 for count in product.state_counts):
        notes.append(
            "Where the moon moves on an ellipse its true anomaly is "
            f"{np.degrees(product.start_true_anomaly_rad):g}° at the start."
        )
    metrics = {
        "ladder_flights": Metric(product.converged.size),
        "ladder_converged": Metric(int(np.count_nonzero(product.converged))),
    }
    closed = product.gap[product.converged]
    if closed.size:
        metrics["ladder_gap_max"] = Metric(float(np.max(closed)))
        metrics["ladder_departure_max"] = Metric(float(np.nanmax(product.departure_max_m)), "m")
    figures = {}
    if closed.size:
        own = label_identifier("fidelity_ladder", label)
        figures = {
            "fidelity_departures": _departure_chart(product, own),
            "fidelity_flights": _flight_chart(product, own),
        }
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={
            label_identifier("fidelity_ladder", label): tabulate(
                f"Orbits on every rung, {days:g} days", _flights(product), notes
            ),
            label_identifier("fidelity_rungs", label): tabulate(
                "Rungs of the ladder", _rungs(product)
            ),
            label_identifier("fidelity_periodic", label): tabulate(
                "Periodic orbits of the rungs themselves",
                _periodic(product),
                [
                    "With the same amplitude: z at the start of orbits in space that begin off the "
                    "plane, else x. Equations with a clock have no such orbits."
                ],
            ),
        },
        figures={label_identifier(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _flights(product: FidelityLadder) -> list[FilledColumn]:
    of = FieldColumns(product, "rungs", "members")
    return [
        of("rungs", "rung"),
        of("members", "member"),
        text_column("status", product.status, "status"),
        *map(of, ("converged", "iterations", "gap", "departure_max_m", "departure_rms_m")),
        *map(of, ("slip_s", "min_altitude_m", "survival_s")),
        text_column("fate", [fate or None for fate in product.fate], "lost by"),
    ]


def _periodic(product: FidelityLadder) -> list[FilledColumn]:
    of = FieldColumns(product, "rungs", "members")
    x, _, z, _, vy, _ = (of.spread(row, "members", "rungs") for row in product.periodic_x0_m)
    change = product.periodic_s - product.period_s[:, None]
    return [
        of("rungs", "rung"),
        of("members", "member"),
        text_column("status", product.periodic_status, "status"),
        column("x0_km", x, "x at the start", 12),
        column("z0_km", z, "z at the start", 12),
        column("vy0_m_s", vy, "ẏ at the start", 12),
        of("periodic_s", "period_h"),
        column("period_change_s", change.T.ravel(), "longer than the orbit's by", 5),
        of("periodic_closure", "closure"),
    ]


def _surviving(product: FidelityLadder) -> Integers:
    """Return how many continuous flights on each rung (R,) survive without correction."""
    fates = np.array(product.fate).reshape(len(product.rungs), len(product.members)).T
    return np.asarray(np.count_nonzero(product.converged & (fates == ""), axis=0))


def _rungs(product: FidelityLadder) -> list[FilledColumn]:
    of, good = FieldColumns(product, "rungs"), product.converged
    some = np.asarray(good.any(axis=0))

    def largest(values: Array) -> Array:
        """Return the largest over the continuous flights on each rung (R,), NaN without any."""
        return np.where(some, np.max(values, axis=0, where=good, initial=-np.inf), np.nan)

    surviving = zip(_surviving(product).tolist(), some, strict=True)
    return [
        of("rungs", "rung"),
        of("plants", "plant"),
        of("frames", "frame"),
        column("orbits", [len(product.members)] * some.size, "orbits"),
        column("converged", np.count_nonzero(good, axis=0), "converged"),
        column("gap_max", largest(product.gap), "largest gap", 2),
        column("departure_max_km", largest(product.departure_max_m), "largest departure", 4),
        column("departure_rms_km", largest(product.departure_rms_m), "largest rms departure", 4),
        column(
            "surviving", [count if there else None for count, there in surviving],
            "survive without correction",
        ),
        column("min_survival_d", -largest(-product.survival_s), "least survival", 4),
    ]  # fmt: skip


def _verdict(product: FidelityLadder) -> list[str]:
    days = product.times_s[-1] / DAY_S
    sentences = []
    for r, rung in enumerate(product.rungs):
        good = product.converged[:, r]
        text = (
            f"{rung} ({product.plants[r]}): "
            f"{format_count(int(np.count_nonzero(good)), 'orbit', of=good.size)} "
            f"{'has' if np.count_nonzero(good) == 1 else 'have'} a continuous flight of {days:g} "
            "days"
        )
        if good.any():
            largest = product.departure_max_m[good, r]
            alone = int(_surviving(product)[r])
            text += (
                f", at most {np.min(largest) / 1e3:.3g} to {np.max(largest) / 1e3:.3g} km from the "
                f"orbit; {alone} {'survives' if alone == 1 else 'survive'} without correction"
            )
        sentences.append(text + ".")
    if failed := [
        f"{member} on {rung}"
        for r, rung in enumerate(product.rungs)
        for m, member in enumerate(product.members)
        if not product.converged[m, r]
    ]:
        sentences.append(f"Not converged: {', '.join(failed)}.")
    return sentences


def _apart(product: FidelityLadder) -> list[int]:
    """Return the rungs on which some flight departs from its orbit; the last in any case."""
    far = np.max(np.nan_to_num(product.departure_max_m), axis=0) > 1.0
    return [r for r in range(len(far)) if far[r] or r == len(far) - 1]


def _spread(members: NDArray[np.intp]) -> list[int]:
    """Return as many members as are drawn, spread over all."""
    places = (
        np.linspace(0, members.size - 1, min(members.size, len(LINE_COLOURS))).round().astype(int)
    )
    return [int(m) for m in members[places]]


def _departure_chart(product: FidelityLadder, table: str) -> Chart:
    times_d, members = product.times_s / DAY_S, _spread(np.arange(len(product.members)))
    # The largest of each part of the time: the departure swings with every revolution.
    ends = np.unique(np.linspace(0, times_d.size, _PARTS + 1).astype(int))
    middle_d = times_d[np.minimum((ends[:-1] + ends[1:]) // 2, times_d.size - 1)]
    panels = []
    for r in _apart(product):
        largest = np.maximum.reduceat(product.departure_m[:, :, r], ends[:-1]) / 1e3
        marks: list[Mark] = [
            Curve(middle_d, largest[:, m], product.members[m], colour,
                  rows=r * len(product.members) + m)
            for colour, m in zip(LINE_COLOURS, members, strict=False)
            if product.converged[m, r]
        ]  # fmt: skip
        panels.append(Panel(
            Axis("time", "d"), Axis("departure", "km", low=0.0),
            marks or [Note("none converged", corner="centre")], product.rungs[r],
        ))  # fmt: skip
    return Chart(
        "Departure from the orbits", panels,
        "Distance of the flights from the nearest points of the orbits of the first rung: the "
        f"largest in each of {_PARTS} parts of the time. Rungs on which it is less than a metre "
        f"are left out, and members beyond {len(LINE_COLOURS)}.",
        share_x=True, shared_legend=True, size_in=(8.0, 1.2 + 2.4 * len(panels)), table=table,
    )  # fmt: skip


def _flight_chart(product: FidelityLadder, table: str) -> Chart:
    members = _spread(np.flatnonzero(product.converged[:, -1]))
    own = (len(product.rungs) - 1) * len(product.members)  # first row of the last rung
    stride = -(-product.times_s.size // _NODES)
    orbits = orbit_paths(product.track_m, product.members, members)
    nodes = [
        Cloud(product.hill[:3, ::stride, m, -1] / 1e3, "", colour, "dot", 5.0, rows=own + m)
        for colour, m in zip(LINE_COLOURS, members, strict=False)
    ]
    return scene_chart(
        f"Flights on {product.rungs[-1]}",
        [
            *(
                replace(orbit, rows=own + m, width=0.7)
                for orbit, m in zip(orbits, members, strict=True)
            ),
            *nodes,
        ],
        product,
        "Nodes of the flights (dots) over the orbits of the first rung (lines), in the frame that "
        "turns with the line to the primary; the body to scale, as it is oriented in the mean.",
        table=table,
    )
