"""Tables and figures of the fidelity ladder."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.presentation import (
    PALETTE,
    Cell,
    Column,
    Figure,
    Metric,
    Presentation,
    Table,
)
from hillsphere_orbits.fidelity_ladder.products import FidelityLadder
from hillsphere_orbits.qso.presentation import counted, named

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["present_ladder"]

_DAY = 86400.0
_PARTS = 60
_DRAWN = 6  # members in a figure: as many as colours that tell apart
_COLOURS = [PALETTE[c] for c in ("blue", "vermillion", "green", "purple", "orange", "sky")]
_FLIGHTS = (
    Column("rung", "", "rung"),
    Column("member", "", "orbit"),
    Column("status", "", "status"),
    Column("converged", "", "converged"),
    Column("iterations", "-", "steps"),
    Column("gap", "-", "largest gap", 2),
    Column("departure_max_km", "km", "largest departure", 4),
    Column("departure_rms_km", "km", "rms departure", 4),
    Column("slip_h", "h", "ahead of the orbit at the end", 4),
    Column("altitude_min_km", "km", "least height", 5),
    Column("survival_d", "d", "survival without correction", 4),
    Column("fate", "", "lost by"),
)
_RUNGS = (
    Column("rung", "", "rung"),
    Column("plant", "", "equations"),
    Column("frame", "", "frame"),
    Column("orbits", "-", "orbits"),
    Column("converged", "-", "converged"),
    Column("gap_max", "-", "largest gap", 2),
    Column("departure_max_km", "km", "largest departure", 4),
    Column("departure_rms_km", "km", "largest rms departure", 4),
    Column("surviving", "-", "survive without correction"),
    Column("survival_min_d", "d", "least survival", 4),
)
_PERIODIC = (
    Column("rung", "", "rung"),
    Column("member", "", "orbit"),
    Column("status", "", "status"),
    Column("x0_km", "km", "x at the start", 12),
    Column("z0_km", "km", "z at the start", 12),
    Column("vy0_m_s", "m/s", "ẏ at the start", 12),
    Column("period_h", "h", "period", 12),
    Column("period_change_s", "s", "longer than the orbit's by", 5),
    Column("closure", "-", "closure", 2),
)


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
    days = product.times_s[-1] / _DAY
    flights = _flight_rows(product)
    rungs = _rung_rows(product, flights)
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
        "ladder_flights": Metric(len(flights)),
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
        metrics={named(name, label): metric for name, metric in metrics.items()},
        tables={
            named("fidelity_ladder", label): Table(
                f"Orbits on every rung, {days:g} days", _FLIGHTS, flights, notes
            ),
            named("fidelity_rungs", label): Table("Rungs of the ladder", _RUNGS, rungs),
            named("fidelity_periodic", label): Table(
                "Periodic orbits of the rungs themselves",
                _PERIODIC,
                _periodic_rows(product),
                [
                    "With the same amplitude: z at the start of orbits in space that begin off the "
                    "plane, else x. Equations with a clock have no such orbits."
                ],
            ),
        },
        figures={named(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product, flights),
    )


def _number(value: float, unit: float = 1.0) -> float | None:
    return float(value) / unit if isfinite(value) else None


def _flight_rows(product: FidelityLadder) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for r, rung in enumerate(product.rungs):
        for m, member in enumerate(product.members):
            k = r * len(product.members) + m
            rows.append(
                {
                    "rung": rung,
                    "member": member,
                    "status": product.status[k],
                    "converged": bool(product.converged[m, r]),
                    "iterations": int(product.iterations[m, r]),
                    "gap": _number(product.gap[m, r]),
                    "departure_max_km": _number(product.departure_max_m[m, r], 1e3),
                    "departure_rms_km": _number(product.departure_rms_m[m, r], 1e3),
                    "slip_h": _number(product.slip_s[m, r], 3600.0),
                    "altitude_min_km": _number(product.altitude_min_m[m, r], 1e3),
                    "survival_d": _number(product.survival_s[m, r], _DAY),
                    "fate": product.fate[k] or None,
                }
            )
    return rows


def _periodic_rows(product: FidelityLadder) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for r, rung in enumerate(product.rungs):
        for m, member in enumerate(product.members):
            x0, period = product.periodic_x0_m[:, m, r], product.periodic_s[m, r]
            rows.append(
                {
                    "rung": rung,
                    "member": member,
                    "status": product.periodic_status[r * len(product.members) + m],
                    "x0_km": _number(x0[0], 1e3),
                    "z0_km": _number(x0[2], 1e3),
                    "vy0_m_s": _number(x0[4]),
                    "period_h": _number(period, 3600.0),
                    "period_change_s": _number(period - product.period_s[m]),
                    "closure": _number(product.periodic_closure[m, r]),
                }
            )
    return rows


def _rung_rows(product: FidelityLadder, flights: list[dict[str, Cell]]) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for r, rung in enumerate(product.rungs):
        good = product.converged[:, r]
        row: dict[str, Cell] = {
            "rung": rung,
            "plant": product.plants[r],
            "frame": product.frames[r],
            "orbits": len(product.members),
            "converged": int(np.count_nonzero(good)),
        }
        if good.any():
            own = [flight for flight in flights if flight["rung"] == rung and flight["converged"]]
            row |= {
                "gap_max": float(np.max(product.gap[good, r])),
                "departure_max_km": float(np.max(product.departure_max_m[good, r]) / 1e3),
                "departure_rms_km": float(np.max(product.departure_rms_m[good, r]) / 1e3),
                "surviving": sum(flight["fate"] is None for flight in own),
                "survival_min_d": float(np.min(product.survival_s[good, r]) / _DAY),
            }
        rows.append(row)
    return rows


def _verdict(product: FidelityLadder, flights: list[dict[str, Cell]]) -> list[str]:
    days = product.times_s[-1] / _DAY
    found = []
    for r, rung in enumerate(product.rungs):
        good = product.converged[:, r]
        text = (
            f"{rung} ({product.plants[r]}): "
            f"{counted(int(np.count_nonzero(good)), 'orbit', of=good.size)} "
            f"{'has' if np.count_nonzero(good) == 1 else 'have'} a continuous flight of {days:g} "
            "days"
        )
        if good.any():
            largest = product.departure_max_m[good, r]
            alone = sum(
                bool(flight["converged"]) and flight["fate"] is None
                for flight in flights
                if flight["rung"] == rung
            )
            text += (
                f", at most {np.min(largest) / 1e3:.3g} to {np.max(largest) / 1e3:.3g} km from the "
                f"orbit; {alone} {'survives' if alone == 1 else 'survive'} without correction"
            )
        found.append(text + ".")
    if failed := [
        f"{flight['member']} on {flight['rung']}" for flight in flights if not flight["converged"]
    ]:
        found.append(f"Not converged: {', '.join(failed)}.")
    return found


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
    days = product.times_s[np.minimum((ends[:-1] + ends[1:]) // 2, len(product.times_s) - 1)] / _DAY
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
