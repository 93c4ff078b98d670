"""Tables and figures of the fidelity ladder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array, Integers
from hillsphere.presentation import PALETTE, Figure, Metric, Presentation
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.fidelity_ladder.products import FidelityLadder
from hillsphere_orbits.qso.presentation import format_count, label_identifier

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["present_ladder"]

_PARTS = 60
"""Parts of the time in the figure of departures: fewer hide the growth, more show every swing."""
_DRAWN = 6  # members in a figure: one per distinguishable colour
_COLOURS = [PALETTE[c] for c in ("blue", "vermillion", "green", "purple", "orange", "sky")]


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
        figures = {
            "fidelity_departures": Figure(
                "Departure from the orbits",
                lambda figure: _draw_departures(figure, product),
                "Distance of the flights from the nearest points of the orbits of the first rung: "
                f"the largest in each of {_PARTS} parts of the time. Rungs on which it is less "
                f"than a metre are left out, and members beyond {_DRAWN}.",
                size_in=(8.0, 1.2 + 2.4 * len(_apart(product))),
            ),
            "fidelity_flights": Figure(
                f"Flights on {product.rungs[-1]}",
                lambda figure: _draw_flights(figure, product),
                "Nodes of the flights (dots) over the orbits of the first rung (lines), seen from "
                "the orbit normal and from the direction of flight, in the frame that turns with "
                "the line to the primary; the body to scale, as it stands in the mean.",
                size_in=(9.0, 4.2),
            ),
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
    places = np.linspace(0, members.size - 1, min(members.size, _DRAWN)).round().astype(int)
    return [int(m) for m in members[places]]


def _draw_departures(figure: Canvas, product: FidelityLadder) -> None:
    rungs = _apart(product)
    axes = figure.subplots(len(rungs), 1, sharex=True, squeeze=False)[:, 0]
    drawn = _spread(np.arange(len(product.members)))
    # the largest of each part of the time: the departure swings with every revolution
    ends = np.unique(np.linspace(0, len(product.times_s), _PARTS + 1).astype(int))
    days = (
        product.times_s[np.minimum((ends[:-1] + ends[1:]) // 2, len(product.times_s) - 1)] / DAY_S
    )
    for r, ax in zip(rungs, axes, strict=True):
        for colour, m in zip(_COLOURS, drawn, strict=False):
            if product.converged[m, r]:
                largest = np.maximum.reduceat(product.departure_m[:, m, r], ends[:-1])
                ax.plot(days, largest / 1e3, color=colour, label=product.members[m], linewidth=1.1)
        if not product.converged[:, r].any():
            ax.text(0.5, 0.5, "none converged", transform=ax.transAxes, ha="center")
        ax.set_title(product.rungs[r], fontsize="medium")
        ax.set_ylabel("departure (km)")
        ax.set_ylim(bottom=0.0)
        ax.grid(alpha=0.3)
    axes[-1].set_xlabel("time (d)")
    handles, labels = [], []
    for ax in axes:
        for handle, text in zip(*ax.get_legend_handles_labels(), strict=True):
            if text not in labels:
                handles.append(handle)
                labels.append(text)
    figure.legend(
        handles, labels, loc="outside upper center", ncols=3, fontsize="small", markerscale=4
    )


def _draw_flights(figure: Canvas, product: FidelityLadder) -> None:
    planar = np.ptp(product.track_m[2]) < 1e-6 * np.ptp(product.track_m[1])
    views = ((1, 0),) if planar else ((1, 0), (1, 2))
    names = ("x, away from the primary", "y, along the moon's motion", "z, orbit normal")
    body = product.body.capitalize() if product.body not in ("", "body") else "body"
    drawn = _spread(np.flatnonzero(product.converged[:, -1]))
    for ax, (right, up) in zip(
        figure.subplots(1, len(views), squeeze=False)[0], views, strict=True
    ):
        for colour, m in zip(_COLOURS, drawn, strict=False):
            track, nodes = product.track_m[:, :, m] / 1e3, product.hill[:3, :, m, -1] / 1e3
            ax.plot(track[right], track[up], color=colour, linewidth=0.9)
            ax.plot(
                nodes[right], nodes[up], ".", color=colour, markersize=2.5,
                label=product.members[m],
            )  # fmt: skip
        if product.semi_axes_m:
            outline = _outline_m(product, right, up) / 1e3
            ax.fill(*outline, color="#777777", zorder=3, label=body)
        else:
            ax.plot(0.0, 0.0, "+", color=PALETTE["black"], label=f"centre of the {body}")
        ax.set_aspect("equal")
        ax.set_xlabel(f"{names[right]} (km)")
        ax.set_ylabel(f"{names[up]} (km)")
        ax.grid(alpha=0.3)
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=3, fontsize="small", markerscale=4
    )


def _outline_m(product: FidelityLadder, right: int, up: int) -> NDArray[np.float64]:
    """Return the outline (2, P) of the body's ellipsoid, seen along the third axis."""
    c, s = np.cos(product.prime_meridian_rad), np.sin(product.prime_meridian_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    # the shadow of the unit sphere's image under (turn · semi-axes) is the ellipse of its rows
    rows = (turn * np.array(product.semi_axes_m))[[right, up]]
    t = np.linspace(0.0, 2.0 * np.pi, 181)
    shape: NDArray[np.float64] = np.linalg.cholesky(rows @ rows.T) @ np.array(
        [np.cos(t), np.sin(t)]
    )
    return shape
