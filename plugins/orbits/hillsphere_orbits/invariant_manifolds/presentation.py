"""Table and figures of invariant manifolds."""

from __future__ import annotations

from itertools import product as pairs
from typing import Any

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.presentation import Chart, Metric, Path, Presentation, Solid, Space
from hillsphere.show.spaces import with_room
from hillsphere.show.tables import FilledColumn, column, tabulate, text_column
from hillsphere_orbits.invariant_manifolds.products import Manifolds
from hillsphere_orbits.invariant_manifolds.specs import InvariantManifoldsSpec
from hillsphere_orbits.qso.presentation import format_count, label_identifier
from hillsphere_orbits.scenes import (
    DIRECTIONS,
    SPACE_AXES,
    about_moon,
    cylinder_solids,
    moon_solid,
)

__all__ = ["present_manifolds"]

_STRIDE = 2
"""Of the positions of a trajectory every second one is drawn: about 240, which show a loop each of
some weeks as a curve."""


def present_manifolds(product: Manifolds, spec: InvariantManifoldsSpec) -> Presentation:
    """Show manifolds.

    Parameters
    ----------
    product : Manifolds
        What is shown.
    spec : InvariantManifoldsSpec
        Duration, cylinders, label.

    Returns
    -------
    Presentation
        Table ``manifolds``, one figure ``manifold_tubes_…`` per orbit, counts as metrics.
    """
    label = spec.label
    days = spec.duration_s / DAY_S
    impacts = sum(name == "impact" for name in product.ended_by)
    metrics = {
        "trajectories": Metric(len(product.ended_by)),
        "impacts": Metric(impacts),
        "unstable_orbits": Metric(sum(kind == "unstable" for kind in product.kinds)),
    }
    notes = [
        f"Times count from the last moment at which a trajectory is {product.distance:g} away from "
        "its orbit (Euclidean norm of the normalised state, both at the same time), backwards on "
        f"stable manifolds, and go on for {days:g} d; only what is met after it is listed.",
        f"Trajectories start at distances of at most {product.start_distance:g} from the linear "
        "motion, equally spaced in the logarithm of the distance: each of them once.",
    ]
    about = about_moon(product.body)
    title, own = f"Invariant manifolds{about}", label_identifier("manifolds", label)
    table = tabulate(title, _manifolds(product), notes)
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={own: table},
        figures={
            label_identifier(f"manifold_tubes_{i + 1}", label): _tube_chart(
                product, spec, i, [row["orbit"] for row in table.rows].index(name), own
            )
            for i, name in enumerate(product.orbits.labels)
            if np.any(product.orbit[product.track_trajectory] == i)
        },
        verdict=_verdict(product, days),
    )


def _manifolds(product: Manifolds) -> list[FilledColumn]:
    cells: list[tuple[Any, ...]] = []
    ended = np.array(product.ended_by, dtype=object)
    for i, (name, kind) in enumerate(zip(product.orbits.labels, product.kinds, strict=True)):
        if kind != "unstable":
            cells.append((name, kind, *[None] * 10))
            continue
        for stable, side in pairs((False, True), (1, -1)):
            own = (product.orbit == i) & (product.stable == stable) & (product.side == side)
            if not own.any():
                continue
            after = product.met_time_s * (-1.0 if stable else 1.0) > 0.0
            for e, event in enumerate(product.events):
                met = own[product.met_trajectory] & (product.met_event == e) & after
                reached = np.unique(product.met_trajectory[met]).size
                first = np.min(np.abs(product.met_time_s[met])) if reached else None
                cells.append(
                    (name, kind, product.multiplier[i], "stable" if stable else "unstable",
                     "+" if side > 0 else "−", np.count_nonzero(own),
                     np.count_nonzero(ended[own] == "impact"),
                     np.count_nonzero(ended[own] == "escape"),
                     event, reached, np.count_nonzero(met), first)
                )  # fmt: skip
    (orbits, kinds, multipliers, manifolds, sides, trajectories, impacts, escapes, events, reach,
     crossings, firsts) = np.array(cells, dtype=object).reshape(-1, 12).T  # fmt: skip
    return [
        text_column("orbit", orbits, "orbit"),
        text_column("kind", kinds, "orbit is"),
        column("multiplier", multipliers, "λ", 9),
        text_column("manifold", manifolds, "manifold"),
        text_column("side", sides, "side"),
        column("trajectories", trajectories, "trajectories"),
        column("impacts", impacts, "impacts"),
        column("escapes", escapes, "escapes"),
        text_column("event", events, "event"),
        column("reach_it", reach, "reach it"),
        column("crossings", crossings, "crossings"),
        column("first_d", firsts, "first after", 6),
    ]


def _verdict(product: Manifolds, days: float) -> list[str]:
    unstable = sum(kind == "unstable" for kind in product.kinds)
    impacts = sum(name == "impact" for name in product.ended_by)
    sentences = [
        f"{format_count(unstable, 'orbit', of=len(product.kinds))} "
        f"{'has' if unstable == 1 else 'have'} manifolds; of their "
        f"{len(product.ended_by)} trajectories {impacts} meet the surface within {days:g} d."
    ]
    for kind, text in (("stable", "stable, without manifolds"), ("complex", "complex unstable")):
        names = [
            name for name, k in zip(product.orbits.labels, product.kinds, strict=True) if k == kind
        ]
        if names:
            sentences.append(f"{text.capitalize()}: {'; '.join(names)}.")
    return sentences


def _tube_chart(
    product: Manifolds, spec: InvariantManifoldsSpec, i: int, row: int, table: str
) -> Chart:
    """Return both manifolds of an orbit beside each other; `row` is its first one in the table."""
    name, orbit = product.orbits.labels[i], product.orbit_tracks_m[:, :, i] / 1e3
    # Trajectories far beyond the cylinders would shrink all else.
    reach = 1.3 * max(float(np.max(np.abs(orbit))), *(r / 1e3 for r in spec.cylinders_m), 0.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 97)
    shared: list[Solid] = [Path(orbit, name, "black", width=0.8, rows=row), moon_solid(product)]
    for k, radius in enumerate(spec.cylinders_m):
        ring = radius / 1e3 * np.array([np.cos(angle), np.sin(angle)])
        colour = ("green", "purple", "orange", "sky")[k % 4]
        shared += cylinder_solids(ring, np.ptp(orbit[2]) / 2.0, colour,
                                  f"cylinder {radius / 1e3:.4g} km")  # fmt: skip
    panels = []
    for stable, colour, word in ((False, "vermillion", "unstable"), (True, "blue", "stable")):
        trajectory = product.track_trajectory
        own = (product.orbit[trajectory] == i) & (product.stable[trajectory] == stable)
        if not own.any():
            continue
        ways = product.tracks_m[:, ::_STRIDE, own] / 1e3
        ways = np.where(np.max(np.abs(ways), axis=0) <= reach, ways, np.nan)
        # One path for all of them, with a gap after each.
        joined = np.pad(ways, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
        tube = Path(joined.transpose(0, 2, 1).reshape(3, -1), f"{word} manifold", colour,
                    width=0.5, opacity=0.6)  # fmt: skip
        panels.append(with_room(Space([tube, *shared], *SPACE_AXES, title=f"{word} manifold")))
    return Chart(
        f"Manifolds of {name}{about_moon(product.body)}", panels,
        "Unstable and stable manifold, the orbit, the body to scale and the cylinders (equal "
        f"axes); {spec.duration_s / DAY_S:g} d from where a trajectory leaves its orbit. "
        f"{DIRECTIONS}",
        columns=len(panels), shared_legend=True, size_in=(6.0 * len(panels), 6.0), table=table,
    )  # fmt: skip
