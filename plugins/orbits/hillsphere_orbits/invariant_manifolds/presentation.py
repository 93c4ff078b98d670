"""Table and figures of invariant manifolds."""

from __future__ import annotations

from itertools import product as pairs
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE, Figure, Metric, Presentation
from hillsphere.show.tables import FilledColumn, column, tabulate, text_column
from hillsphere_orbits.invariant_manifolds.products import Manifolds
from hillsphere_orbits.invariant_manifolds.specs import InvariantManifoldsSpec
from hillsphere_orbits.qso.presentation import format_count, label_identifier

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["draw_body", "draw_cylinder", "finish_space", "present_manifolds"]


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
    figures: dict[str, Figure] = {}
    about = f" around {product.body.capitalize()}" if product.body not in ("", "body") else ""
    for i, name in enumerate(product.orbits.labels):
        if np.any(product.orbit[product.track_trajectory] == i):
            figures[label_identifier(f"manifold_tubes_{i + 1}", label)] = Figure(
                f"Manifolds of {name}{about}",
                lambda figure, i=i: _draw(figure, product, spec, i),  # type: ignore[misc]
                "Unstable and stable manifold, the orbit, the body to scale and the cylinders "
                f"(equal axes); {days:g} d from where a trajectory leaves its orbit.",
                size_in=(12.0, 6.0),
            )
    return Presentation(
        metrics={label_identifier(name, label): metric for name, metric in metrics.items()},
        tables={
            label_identifier("manifolds", label): tabulate(
                f"Invariant manifolds{about}", _manifolds(product), notes
            )
        },
        figures=figures,
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


def draw_body(axes: Any, semi_axes_m: tuple[float, ...], prime_meridian_rad: float) -> None:
    """Draw an ellipsoidal body to scale, km."""
    if not semi_axes_m:
        return
    a, b, c = np.array(semi_axes_m) / 1e3
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 33), np.linspace(0.0, np.pi, 17))
    p, q = a * np.cos(u) * np.sin(v), b * np.sin(u) * np.sin(v)
    cos, sin = np.cos(prime_meridian_rad), np.sin(prime_meridian_rad)
    axes.plot_surface(cos * p - sin * q, sin * p + cos * q, c * np.cos(v), color="#777777")


def draw_cylinder(axes: Any, ring_km: Array, height_km: float, colour: str, label: str) -> None:
    """Draw a cylinder over a closed curve (2, K), km, by its rims and some of its lines."""
    for z in (-height_km, height_km):
        axes.plot(*ring_km, z, color=colour, lw=0.7, alpha=0.8)
    axes.plot(*ring_km, 0.0, color=colour, lw=1.6, label=label)
    for x, y in ring_km[:, :: max(1, ring_km.shape[1] // 16)].T:
        axes.plot([x, x], [y, y], [-height_km, height_km], color=colour, lw=0.4, alpha=0.6)


def finish_space(axes: Any) -> None:
    """Give a figure in space equal axes, their names and a legend."""
    # a little smaller than the panel, so that no axis is cut off
    axes.set_box_aspect(np.ptp(np.array(axes.get_w_lims()).reshape(3, 2), axis=1), zoom=0.85)
    axes.set_xlabel("x, away from the primary (km)")
    axes.set_ylabel("y, along the orbital velocity (km)")
    axes.set_zlabel("z, north (km)")
    axes.legend(loc="upper right", fontsize=8)


def _draw(figure: Canvas, product: Manifolds, spec: InvariantManifoldsSpec, i: int) -> None:
    trajectory = product.track_trajectory
    orbit = product.orbit_tracks_m[:, :, i] / 1e3
    # trajectories far beyond the cylinders would shrink all else
    reach = 1.3 * max(float(np.max(np.abs(orbit))), *(r / 1e3 for r in spec.cylinders_m), 0.0)
    height = float(np.max(np.abs(orbit[2])))
    angle = np.linspace(0.0, 2.0 * np.pi, 97)
    shown = [
        (stable, colour, name)
        for stable, colour, name in (
            (False, PALETTE["vermillion"], "unstable manifold"),
            (True, PALETTE["blue"], "stable manifold"),
        )
        if np.any((product.orbit[trajectory] == i) & (product.stable[trajectory] == stable))
    ]
    for panel, (stable, colour, name) in enumerate(shown, 1):
        axes = figure.add_subplot(1, len(shown), panel, projection="3d")
        for j in np.flatnonzero(
            (product.orbit[trajectory] == i) & (product.stable[trajectory] == stable)
        ):
            way = product.tracks_m[:, :, j] / 1e3
            way = np.where(np.max(np.abs(way), axis=0) <= reach, way, np.nan)
            axes.plot(*way, color=colour, lw=0.35, alpha=0.6)
        axes.plot([], [], [], color=colour, lw=1.2, label=name)
        axes.plot(*orbit, color=PALETTE["black"], lw=0.7, label=product.orbits.labels[i])
        colours = (PALETTE["green"], PALETTE["purple"], PALETTE["orange"], PALETTE["sky"])
        for k, radius in enumerate(spec.cylinders_m):
            ring = radius / 1e3 * np.array([np.cos(angle), np.sin(angle)])
            draw_cylinder(axes, ring, height, colours[k % 4], f"cylinder {radius / 1e3:.4g} km")
        draw_body(axes, product.semi_axes_m, product.prime_meridian_rad)
        finish_space(axes)
